"""Which quantities of a simulation are logged, and one row of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camnet.simulation.coordination import Task
from camnet.simulation.instruments import INSTRUMENTS, Instruments
from camnet.simulation.log import RunLog
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.types import Array

__all__ = ["Recorder", "log_columns"]

#: what is logged of an agent that may lose its pose or leave its region
OWN = ("own_x_m", "own_y_m", "own_error_m", "own_sd_m", "own_turn_rad", "own_lost", "outside_s")
_XYZ, _WXYZ = ("x", "y", "z"), ("w", "x", "y", "z")


def _vector(who: str, what: str, unit: str) -> list[str]:
    return [f"{who}.{what}_{axis}_{unit}" for axis in _XYZ]


def _quaternion(who: str, what: str) -> list[str]:
    return [f"{who}.{what}_{axis}" for axis in _WXYZ]


def log_columns(
    agents: Sequence[str],
    targets: Sequence[str],
    filters: Sequence[str],
    lost: Sequence[str] = (),
    unsized: Sequence[str] = (),
    instruments: Sequence[str] = (),
) -> list[str]:
    """Names of the log's columns; positions in m, velocities in m/s, quaternions scalar first, body to world.

    ``<target>.region`` and ``<target>.seen_by`` are indices of regions and cameras (-1: none), ``<agent>.role`` is
    0 loiter, 1 intercept, 2 track. ``<target>.off_left_s`` is how long the target may still stay unseen by the
    certificate of the gap it is in, and ``<target>.off_margin_m`` what the certified bound of the error leaves of the
    view's radius (NaN: seen, or nothing is certified); ``<target>.violations`` counts violations of ``sound`` so far.

    Agents in ``lost`` may lose their external pose or leave their regions: ``<agent>.own_x_m``, ``own_y_m`` is where
    their camera believes to be, ``own_error_m`` how far that is from the truth, ``own_sd_m`` the standard deviation
    that it states, ``own_turn_rad`` the error of its heading, ``own_lost`` 1 without external pose, ``outside_s`` how
    long it is truly outside its region. Of targets in ``unsized``, of unknown size: ``<target>.size`` is what their
    agents take it for, as a share of the true one, and ``size_sd`` its standard deviation as a share. ``instruments``:
    what `camnet.simulation.instruments` logs of each target.
    """
    columns = ["t_s"]
    for target in targets:
        columns += [*_vector(target, "p", "m"), *_quaternion(target, "q"), *_vector(target, "v", "mps")]
        columns += [
            f"{target}.{what}"
            for what in ("region", "seen_by", "lap", "off_left_s", "off_margin_m", "violations")
        ]
        if target in unsized:
            columns += [f"{target}.size", f"{target}.size_sd"]
        for name in filters:
            who = f"{target}.{name}"
            columns += [*_vector(who, "p", "m"), *_quaternion(who, "q"), *_vector(who, "v", "mps")]
            columns += [f"{who}.radius_m"]
        columns += [f"{target}.{what}" for what in instruments]
    for agent in agents:
        columns += [*_vector(agent, "p", "m"), *_quaternion(agent, "q"), *_vector(agent, "v", "mps")]
        columns += [*_vector(agent, "cam_p", "m"), *_quaternion(agent, "cam_q")]
        columns += [*_vector(agent, "set_p", "m"), *_vector(agent, "ref_p", "m"), f"{agent}.role"]
        if agent in lost:
            columns += [f"{agent}.{what}" for what in OWN]
    return columns


class Recorder:
    """Appends one row of a simulation to a `RunLog`."""

    def __init__(self, simulation: NetworkSimulation) -> None:
        self._simulation = simulation
        world = simulation.world
        self._uncertain = sorted({*simulation.network.own_poses, *simulation.network.exits})
        lost = [world.agent_names[j] for j in self._uncertain]
        unsized = [world.target_names[m] for m in simulation.sizes]
        names = (world.agent_names, world.target_names, simulation.filter_names)
        wanted = simulation.network.scenario.run.instruments
        self._instruments = Instruments(simulation) if wanted else None
        self.log = RunLog(log_columns(*names, lost, unsized, INSTRUMENTS if wanted else ()))

    def finish(self) -> None:
        """Fill in what is known only when the run is over."""
        if self._instruments is not None:
            self._instruments.finish(self.log)

    def record(self, setpoints: Setpoints, tasks: Sequence[Task]) -> None:
        """Log the present instant, with the setpoints and tasks just decided."""
        s = self._simulation
        parts: list[Array | list[float]] = [[s.snapshot.t_s]]
        for m in range(s.network.n_targets):
            parts += self._target(m)
        for j in range(s.network.n_agents):
            parts += self._agent(j, setpoints, tasks)
        self.log.append(np.concatenate(parts))

    def _target(self, m: int) -> list[Array | list[float]]:
        s, truth = self._simulation, self._simulation.snapshot
        parts: list[Array | list[float]] = [
            truth.target_p_world[m],
            truth.target_q_world[m],
            truth.target_v_world[m],
            [float(s.target_region[m]), float(s.seen_by(m)), float(s.trackers[m].lap), *self._certificate(m)],
        ]
        if m in s.sizes:
            parts.append([s.sizes[m].scale, s.sizes[m].sd])
        for name in s.filter_names:
            e = s.filters[name][m].estimate
            parts += [e.p_world, e.q_world, e.v_world, [e.radius_m]]
        if self._instruments is not None:
            parts.append(self._instruments.row(m))
        return parts

    def _certificate(self, m: int) -> list[float]:
        now = self._simulation.statistics.dwell[m].certificate(self._simulation.snapshot.t_s)
        known = [float("nan") if x is None else x for x in (now.time_left_s, now.margin_m)]
        return [*known, float(now.violations)]

    def _agent(self, j: int, setpoints: Setpoints, tasks: Sequence[Task]) -> list[Array | list[float]]:
        s, truth = self._simulation, self._simulation.snapshot
        return [
            truth.agent_p_world[j],
            truth.agent_q_world[j],
            truth.agent_v_world[j],
            truth.camera_p_world[j],
            truth.camera_q_world[j],
            setpoints.p_world[j],
            s.reference_p_world(j),
            [float(tasks[j].role)],
            *([self._own(j)] if j in self._uncertain else []),
        ]

    def _own(self, j: int) -> list[float]:
        s = self._simulation
        exits = 0.0 if s.exits is None or j not in s.exits.agents else s.exits.agents[j].outside_s
        x, y = s.believed_p_world[j, :2].tolist()
        if s.own is None:
            return [x, y, 0.0, 0.0, 0.0, 0.0, exits]
        own = s.own
        return [
            x,
            y,
            float(own.error_m[j]),
            own.spread_m(j),
            float(own.turn_rad[j]),
            float(own.lost[j]),
            exits,
        ]
