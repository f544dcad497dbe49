"""What every column of the log means: its name, its unit and a sentence.

Names are ``<who>.<quantity>_<unit>``: ``robot.p_x_m``, ``robot.learned.p_x_m``, ``camera_0.ref_p_x_m``. The same
records make the columns that are written, the metadata of ``log.parquet``, ``camnet log --describe`` and
``docs/log.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from camnet.config.models import Scenario

__all__ = ["INSTRUMENT_WORDS", "LogColumn", "columns_of", "describe_columns"]

_XYZ, _WXYZ = ("x", "y", "z"), ("w", "x", "y", "z")
#: of an agent that may lose its pose or leave its region
_OWN = {
    "own_x_m": ("m", "where the camera of {} believes to be; world frame, x"),
    "own_y_m": ("m", "where the camera of {} believes to be; world frame, y"),
    "own_error_m": ("m", "how far that belief of {} is from the truth"),
    "own_sd_m": ("m", "standard deviation that {} states for it"),
    "own_turn_rad": ("rad", "error of the heading that {} believes to have"),
    "own_lost": ("1", "1 while {} has no external pose, else 0"),
    "outside_s": ("s", "how long {} is truly outside its region"),
}
#: of a target of unknown size
_SIZE = {
    "size": ("1", "what the agents take {} for, as a share of its true size"),
    "size_sd": ("1", "standard deviation of the size of {}, as a share"),
}
#: of every target, on request (`camnet.simulation.instruments`): the estimator in charge and its model in force
INSTRUMENT_WORDS = {
    "V": ("1", "Lyapunov function of the estimator in charge of {}, harris2020 (3-25), (4-28)"),
    "V_pose": ("1", "part of V that is the pose of {}"),
    "W_hat": ("1", "Frobenius norm of the weights in force, {}"),
    "psi_min_s2": ("s^2", "least eigenvalue of the history stack, {}, harris2020 (3-19)"),
    "psi_min_visited_s2": ("s^2", "the same over the kernels that data has reached, {}"),
    "sigma_f": ("1", "1 with feedback on {}, else 0"),
    "sigma_d": ("1", "1 where the stack is excited, {}, else 0"),
    "sigma_h": ("1", "1 where the stack was excited before, {}, else 0"),
}


@dataclass(frozen=True, slots=True)
class LogColumn:
    """One column.

    Attributes
    ----------
    name : in the log
    unit : of its numbers; ``1`` for what has none: counts, indices, codes, parts of quaternions
    description : what they are
    """

    name: str
    unit: str
    description: str


def columns_of(scenario: Scenario, filters: Sequence[str]) -> list[LogColumn]:
    """Return the columns of a run of ``scenario`` with these estimators."""
    return describe_columns(
        [a.name for a in scenario.agents],
        [t.name for t in scenario.targets],
        filters,
        [a.name for a in scenario.agents if a.pose.may_be_lost or a.exit_budget_s > 0.0],
        [t.name for t in scenario.targets if t.assumed_size is not None],
        tuple(INSTRUMENT_WORDS) if scenario.run.instruments else (),
    )


def describe_columns(
    agents: Sequence[str],
    targets: Sequence[str],
    filters: Sequence[str],
    lost: Sequence[str] = (),
    unsized: Sequence[str] = (),
    instruments: Sequence[str] = (),
) -> list[LogColumn]:
    """Return the log's columns in order, for agents, targets and estimators of these names.

    Agents in ``lost`` may lose their external pose or leave their regions, targets in ``unsized`` are of unknown size;
    ``instruments`` are those of `camnet.simulation.instruments`.
    """
    columns = [LogColumn("t_s", "s", "simulated time")]
    for target in targets:
        columns += _motion(target, f"target {target}, the truth")
        columns += _of_target(target)
        if target in unsized:
            columns += [_described(target, "target", name, *words) for name, words in _SIZE.items()]
        for name in filters:
            who = f"{target}.{name}"
            columns += _motion(who, f"target {target} as estimator {name} has it")
            words = f"what estimator {name} allows for its position error, target {target}"
            columns += [LogColumn(f"{who}.radius_m", "m", words)]
        columns += [_described(target, "target", name, *INSTRUMENT_WORDS[name]) for name in instruments]
    for agent in agents:
        columns += _motion(agent, f"agent {agent}, its body, the truth")
        columns += [
            *_vector(agent, "cam_p", "m", "m", f"position of the camera of agent {agent}, the truth"),
            *_quaternion(agent, "cam_q", f"orientation of the camera of agent {agent}, camera to world"),
            *_vector(agent, "set_p", "m", "m", f"setpoint of agent {agent}: where its camera is asked to be"),
            *_vector(
                agent, "ref_p", "m", "m", f"smooth reference that the controller of agent {agent} follows"
            ),
            LogColumn(f"{agent}.role", "1", f"task of agent {agent}: 0 loiter, 1 intercept, 2 track"),
        ]
        if agent in lost:
            columns += [_described(agent, "agent", name, *words) for name, words in _OWN.items()]
    return columns


def _described(who: str, kind: str, name: str, unit: str, words: str) -> LogColumn:
    return LogColumn(f"{who}.{name}", unit, words.format(f"{kind} {who}"))


def _motion(who: str, words: str) -> list[LogColumn]:
    return [
        *_vector(who, "p", "m", "m", f"position of {words}"),
        *_quaternion(who, "q", f"orientation of {words}, body to world"),
        *_vector(who, "v", "mps", "m/s", f"velocity of {words}"),
    ]


def _vector(who: str, what: str, ending: str, unit: str, words: str) -> list[LogColumn]:
    return [LogColumn(f"{who}.{what}_{k}_{ending}", unit, f"{words}; world frame, {k}") for k in _XYZ]


def _quaternion(who: str, what: str, words: str) -> list[LogColumn]:
    return [LogColumn(f"{who}.{what}_{k}", "1", f"{words}; unit quaternion, part {k}") for k in _WXYZ]


def _of_target(target: str) -> list[LogColumn]:
    """Return what the log says of a target beside its motion."""
    columns = (
        ("region", "1", "index of the region that {} is in (agents' first, as in the world file); -1: none"),
        ("seen_by", "1", "index of a camera that truly sees {} (agents' first); -1: nobody does"),
        ("lap", "1", "lap of {}, from 1: a new one begins where the first visited region is visited again"),
        (
            "off_left_s",
            "s",
            "how long {} may still stay unseen by the certificate of the gap it is in; "
            "empty: it is seen, or nothing is certified",
        ),
        (
            "off_margin_m",
            "m",
            "what the certified bound of the error of {} leaves of the view's radius; "
            "empty: it is seen, or nothing is certified",
        ),
        ("violations", "1", "violations of the certificate 'sound' by {} so far"),
    )
    return [
        LogColumn(f"{target}.{name}", unit, words.format(f"target {target}")) for name, unit, words in columns
    ]
