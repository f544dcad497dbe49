"""Gauss-Newton with Levenberg-Marquardt damping on the block-tridiagonal system of a plan, by banded Cholesky."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from camnet.control.planner.distance_kernel import ROW
from camnet.control.planner.objective import BAND, evaluate, system, weights
from camnet.types import Array

__all__ = ["Problem", "Solution", "minimise"]

_DAMPING_MAX = 1e8
#: smallest relative decrease that counts as progress
_FLAT = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """Everything in the objective but the trajectory; the fields are the arguments of `objective.evaluate`."""

    parameters: Array
    tau: float
    points: Array
    start: Array
    rows: Array = field(default_factory=lambda: np.zeros((0, ROW)))
    shape: Array = field(default_factory=lambda: np.ones(3))
    planes: Array = field(default_factory=lambda: np.zeros((0, 4)))
    disc: Array = field(default_factory=lambda: np.zeros(3))
    polygon: Array = field(default_factory=lambda: np.zeros((0, 2)))
    edge: Array = field(default_factory=lambda: np.ones(3))
    samples: int = 6


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """Trajectory (n,10), objective, linear solves, whether it converged, and the steps (m) of the iterations."""

    states: Array
    cost: float
    iterations: int
    converged: bool
    steps: tuple[float, ...]
    costs: tuple[float, ...]


def minimise(problem: Problem, guess: Array, tolerance_m: float, iterations_max: int) -> Solution:
    """Trajectory (n,10) of least objective near ``guess``, whose first position and velocity are held.

    Converged: a step of full length moves no sample by more than ``tolerance_m``, or nothing decreases any more.
    """
    s, n = np.array(guess, dtype=float), len(guess)
    resting = np.zeros(n - 1, dtype=np.bool_)
    fixed = problem
    weight = weights(fixed.parameters, fixed.tau, s, resting)
    g, ab = np.empty(10 * n), np.empty((BAND, 10 * n))

    def at(states: Array, build: bool) -> float:
        return float(
            evaluate(
                fixed.parameters, fixed.tau, states, weight, resting, fixed.points, fixed.start, fixed.rows,
                fixed.shape, fixed.planes, fixed.disc, fixed.polygon, fixed.edge, fixed.samples, g, ab, build,
            )
        )  # fmt: skip

    damping, steps = 0.0, []
    cost = at(s, True)
    costs, converged = [cost], False
    while len(steps) < iterations_max and not converged:
        system(g, ab)
        gradient, band = g.copy(), ab.copy()
        while True:
            trial = _step(band, gradient, damping, n)
            new = at(s + trial, True) if trial is not None else np.inf
            if new <= cost + 1e-12 * abs(cost):
                break
            damping = max(4.0 * damping, 1e-3)
            if damping > _DAMPING_MAX:
                return Solution(s, cost, len(steps) + 1, True, (*steps, 0.0), tuple(costs))
        assert trial is not None
        s = s + trial
        steps.append(float(np.linalg.norm(trial[:, :3], axis=1).max()))
        converged = steps[-1] <= tolerance_m * (1.0 if damping < 1.0 else 0.0) or cost - new <= _FLAT * abs(cost)
        cost = new
        costs.append(cost)
        damping = 0.25 * damping if damping > 1e-3 else 0.0
    return Solution(s, cost, len(steps), converged, tuple(steps), tuple(costs))


def _step(band: Array, gradient: Array, damping: float, n: int) -> Array | None:
    damped = band.copy()
    damped[0] *= 1.0 + damping
    try:
        return np.asarray(-solveh_banded(damped, gradient, lower=True, check_finite=False)).reshape(n, 10)
    except LinAlgError:
        return None
