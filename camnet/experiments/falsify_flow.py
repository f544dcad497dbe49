"""Hostile targets of the vector-field class: they try to leave the tube of the ``learned`` certificate.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| p' = phi_hat(p) + d, norm(d) <= e_v, norm(p') <= v_max | ``_fly`` | m/s | all motions of the class |
| d along p - p_hat | bang-bang | | the greedy worst case |
| d at angles theta_1 .. theta_k | random, optimised | rad | held for equal times; optimised by differential evolution |

Each exit of the learned flow is attacked from every side of its start disc. A trial breaks the certificate if the
target leaves the tube, or misses a view that is certified to see it. ``closest`` is the largest share of the tube's
radius that any target reached at the time at which it is seen again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from camnet.certification.crossing import Crossing, certify_crossing, meeting
from camnet.certification.flow_network import FlowExit, flow_exits
from camnet.certification.growth import PlanarField, Tube, error_tube
from camnet.certification.reachable import TubeReach
from camnet.compiled import cached_njit
from camnet.experiments.certify_flow import FlowCase
from camnet.processes.crew import Crew
from camnet.processes.place import in_order
from camnet.types import Array, BoolArray

__all__ = ["Attack", "attack_flow", "search", "shares", "velocities"]

#: share of the trials by kind: the rest is optimised
_RANDOM, _BANG = 0.4, 0.4
#: number of angles that a trial consists of, and members of the optimiser's population per angle
_ANGLES, _POPULATION = 8, 4
#: rounding of the flight and of the tube's path, m
_TOLERANCE_M = 1e-6
#: squared distance, in standard deviations, beyond which a kernel is left out
_FAR = 36.0
#: targets are followed for at most this long, s
_LONGEST_S = 30.0


@dataclass(slots=True)
class Attack:
    """What the trials came to.

    Attributes
    ----------
    trials : number of simulated targets
    violations : those that broke a claim
    closest : largest share of the bound that was reached
    lost : targets out of view for longer than allowed (after exits that are not certified: no violation)
    by_exit : one record for each exit
    """

    trials: int = 0
    violations: int = 0
    closest: float = 0.0
    lost: int = 0
    by_exit: list[dict[str, object]] = field(default_factory=list)

    def add(self, other: Attack) -> None:
        """Count the trials of another attack in."""
        self.trials += other.trials
        self.violations += other.violations
        self.closest = max(self.closest, other.closest)
        self.lost += other.lost
        self.by_exit += other.by_exit


@dataclass(frozen=True, eq=False)
class _Scene:
    """One exit under attack: the tube, what is claimed of it, and when it is looked at."""

    case: FlowCase
    field: PlanarField
    leave: FlowExit
    tube: Tube
    claim: Crossing
    steps: int
    look: int


def attack_flow(
    case: FlowCase,
    trials: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] | None = None,
    crew: Crew | None = None,
) -> Attack:
    """Attack every exit of the learned flow with an equal share of the trials.

    Each exit has a generator of its own, so figures do not depend on who attacks it (``crew``; None: this process).
    """
    exits = flow_exits(case.fields, case.ground, case.start, case.duration_s)
    tasks = list(zip(exits, shares(trials, len(exits)), rng.spawn(len(exits)), strict=True)) if exits else []
    attack = Attack()
    for part in in_order(crew, partial(_attack_exit, case), tasks, progress):
        attack.add(part)
    return attack


def shares(trials: int, parts: int) -> list[int]:
    """Divide ``trials`` into ``parts`` as equal as can be."""
    return [trials // parts + (k < trials % parts) for k in range(parts)]


def _scene(case: FlowCase, leave: FlowExit) -> _Scene:
    chosen, target = case.fields[leave.view], case.target
    horizon = case.off_max_s + case.step_s
    tube = error_tube(
        chosen,
        leave.point,
        target.e0_m + target.spread_m,
        target.model_error_mps,
        target.v_max_mps,
        horizon,
        case.step_s,
        tolerance=1e-2,
        max_cells=600,
        stop_radius_m=max(g.radius_m for g in case.ground),
    )
    views = [g.view for g in case.ground]
    claim = certify_crossing(TubeReach(tube), views, tube.t_s, case.off_max_s, 0.0, target.v_max_mps)
    if claim.verdict == "certified" and case.agents is not None:
        claim = meeting(TubeReach(tube), claim, case.agents, case.off_max_s)
    again = np.any([v.depth(tube.centre_m) >= 0.0 for v in views], axis=0)
    out = np.flatnonzero(~again)
    later = np.flatnonzero(again & (np.arange(len(again)) > (out[0] if len(out) else 0)))
    look = int(np.argmin(np.abs(tube.t_s - claim.time_s))) if math.isfinite(claim.time_s) else 0
    if look == 0:
        look = int(later[0]) if len(later) else len(tube.t_s) - 1
    steps = round(min(case.off_max_s, _LONGEST_S) / float(tube.t_s[1]))
    return _Scene(case, chosen, leave, tube, claim, max(steps, look), look)


def _attack_exit(case: FlowCase, task: tuple[FlowExit, int, np.random.Generator]) -> Attack:
    leave, trials, rng = task
    scene, attack, closest = _scene(case, leave), Attack(), 0.0
    n_random, n_bang = round(_RANDOM * trials), round(_BANG * trials)
    plans = rng.uniform(0.0, 2.0 * math.pi, (n_random, _ANGLES + 1))
    closest = max(closest, _judge(scene, plans, False, attack))
    starts = rng.uniform(0.0, 2.0 * math.pi, (n_bang, _ANGLES + 1))
    closest = max(closest, _judge(scene, starts, True, attack))
    left = trials - n_random - n_bang
    if left > 0:
        closest = max(closest, _optimise(scene, left, rng, attack))
    attack.closest = closest
    attack.by_exit.append(
        {
            "from": scene.case.ground[scene.leave.view].name,
            "verdict": scene.claim.verdict,
            "trials": trials,
            "violations": attack.violations,
            "lost": attack.lost,
            "closest_fraction": closest,
            "bound_m": float(scene.tube.radius_m[scene.look]),
            "at_s": float(scene.tube.t_s[scene.look]),
        }
    )
    return attack


def _optimise(scene: _Scene, trials: int, rng: np.random.Generator, attack: Attack) -> float:
    """Let differential evolution look for the plan that comes closest to the bound."""
    best = 0.0
    spent = 0

    def cost(angles: Array) -> Array:
        nonlocal best, spent
        plans = np.atleast_2d(angles.T)[: max(trials - spent, 0)]
        shares = np.zeros(angles.shape[1])
        if len(plans):
            spent += len(plans)
            shares[: len(plans)] = _shares(scene, plans, False, attack)
            best = max(best, float(shares.max()))
        return -shares

    search(cost, _ANGLES + 1, 2.0 * math.pi, trials, rng)
    return best


def search(
    cost: Callable[[Array], Array], size: int, top: float, trials: int, rng: np.random.Generator
) -> None:
    """Spend ``trials`` evaluations of ``cost`` (columns of plans in [0, top]^size) on differential evolution."""
    evolve: Any = differential_evolution  # its stubs do not know the vectorised form
    evolve(
        cost,
        [(0.0, top)] * size,
        popsize=_POPULATION,
        maxiter=max(1, trials // (_POPULATION * size)),
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )


def _judge(scene: _Scene, plans: Array, greedy: bool, attack: Attack) -> float:
    return float(_shares(scene, plans, greedy, attack).max(initial=0.0)) if len(plans) else 0.0


def _shares(scene: _Scene, plans: Array, greedy: bool, attack: Attack) -> Array:
    """Fly the plans, count what they broke, and return the share of the radius that each reached when looked at."""
    paths = _fly(scene, plans, greedy)
    tube = scene.tube
    n = min(len(tube.t_s), len(paths))
    away = np.linalg.norm(paths[:n] - tube.centre_m[:n, None], axis=-1)
    broken: BoolArray = np.asarray((away > tube.radius_m[:n, None] + _TOLERANCE_M).any(axis=0))
    seen = np.any([g.view.depth(paths[1:]) >= 0.0 for g in scene.case.ground], axis=0)
    # leaving takes the target's own time: it counts as out of view from its first moment out on
    out = np.maximum.accumulate(~seen, axis=0)
    again = (seen & out).any(axis=0)
    if scene.claim.verdict == "certified":
        view = scene.case.ground[scene.claim.view].view
        broken |= view.depth(paths[scene.look]) < -_TOLERANCE_M
    attack.trials += len(plans)
    attack.violations += int(broken.sum())
    if scene.case.off_max_s <= _LONGEST_S:
        attack.lost += int((~again).sum())
    return np.asarray(away[min(scene.look, n - 1)] / tube.radius_m[min(scene.look, n - 1)])


def _fly(scene: _Scene, plans: Array, greedy: bool) -> Array:
    """Return paths (steps + 1, n, 2) from the border of the start disc; the first angle says where on it."""
    target, h = scene.case.target, float(scene.tube.t_s[1])
    start = target.e0_m + target.spread_m
    p = scene.leave.point + start * np.c_[np.cos(plans[:, 0]), np.sin(plans[:, 0])]
    p_hat = scene.leave.point.copy()
    out = [p]
    push = np.stack([np.cos(plans[:, 1:]), np.sin(plans[:, 1:])], axis=-1)
    for k in range(scene.steps):
        if greedy:
            away = p - p_hat
            d = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        else:
            d = push[:, min(k * _ANGLES // max(scene.look, 1), _ANGLES - 1)]
        p = _step(scene.field, p, target.model_error_mps * d, h, target.v_max_mps)
        p_hat = _step(scene.field, p_hat[None], np.zeros((1, 2)), h, math.inf)[0]
        out.append(p)
    return np.array(out)


def _step(learned: PlanarField, p: Array, d: Array, h: float, v_max_mps: float) -> Array:
    """Advance by the classical Runge-Kutta method, the velocity within its bound at every stage."""

    def velocity(x: Array) -> Array:
        v = velocities(x, learned.centres, learned.precision, learned.weights) + d
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        return np.asarray(v * np.minimum(1.0, v_max_mps / np.maximum(speed, 1e-12)))

    k1 = velocity(p)
    k2 = velocity(p + 0.5 * h * k1)
    k3 = velocity(p + 0.5 * h * k2)
    k4 = velocity(p + h * k3)
    return np.asarray(p + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))


@cached_njit
def velocities(x: Array, centres: Array, precision: Array, weights: Array) -> Array:
    """Return ``PlanarField.velocity`` of points (n, 2), kernels further than six standard deviations left out."""
    out = np.zeros(x.shape)
    for i in range(x.shape[0]):
        for k in range(centres.shape[0]):
            a, b = x[i, 0] - centres[k, 0], x[i, 1] - centres[k, 1]
            quad = a * a * precision[k, 0, 0] + 2.0 * a * b * precision[k, 0, 1] + b * b * precision[k, 1, 1]
            if quad < _FAR:
                sigma = math.exp(-0.5 * quad)
                out[i, 0] += sigma * weights[k, 0]
                out[i, 1] += sigma * weights[k, 1]
    return out
