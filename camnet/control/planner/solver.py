"""Gauss-Newton with Levenberg-Marquardt damping on the block-tridiagonal system of a plan, by banded Cholesky."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from camnet.control.planner.distance_kernel import ROW
from camnet.control.planner.objective import BAND, evaluate, system, weights
from camnet.types import Array, BoolArray

__all__ = ["Problem", "Solution", "Statistics", "minimise", "objective"]

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
    rest_speed: float
    rows: Array = field(default_factory=lambda: np.zeros((0, ROW)))
    shape: Array = field(default_factory=lambda: np.ones(3))
    planes: Array = field(default_factory=lambda: np.zeros((0, 4)))
    disc: Array = field(default_factory=lambda: np.zeros(3))
    polygon: Array = field(default_factory=lambda: np.zeros((0, 2)))
    edge: Array = field(default_factory=lambda: np.ones(3))
    samples: int = 6


@dataclass(frozen=True, eq=False, slots=True)
class Statistics:
    """Inverse process covariances ``weight`` (n-1,10,10) and where the model rests (n-1,), frozen during a descent."""

    weight: Array
    resting: BoolArray

    def after(self, steps: int) -> Statistics:
        """Those of the trajectory's tail."""
        return Statistics(self.weight[steps:], self.resting[steps:])


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """Result of a descent: trajectory (n,10), objective, linear solves (rejected ones too), whether it converged.

    ``steps`` (m) and ``costs`` are those on the way; ``damping`` is what a continued descent starts with.
    """

    states: Array
    cost: float
    iterations: int
    converged: bool
    steps: tuple[float, ...]
    costs: tuple[float, ...]
    statistics: Statistics
    damping: float = 0.0


def objective(problem: Problem, states: Array) -> float:
    """Objective at a trajectory (n,10), its own process covariances in force."""
    return _Objective(problem, states, None)(states)


class _Objective:
    """The objective, the process covariances frozen about ``states``; calling it also fills ``g`` and ``ab``."""

    def __init__(self, problem: Problem, states: Array, kept: Statistics | None) -> None:
        n = len(states)
        self._problem = problem
        if kept is not None and len(kept.weight) == n - 1:
            self._weight, self._resting = kept.weight, kept.resting
        else:
            self._resting = np.zeros(n - 1, dtype=np.bool_)
            self._weight = weights(problem.parameters, problem.tau, states, problem.rest_speed, self._resting)
        self.statistics = Statistics(self._weight, self._resting)
        self.g, self.ab = np.empty(10 * n), np.empty((BAND, 10 * n))

    def __call__(self, states: Array) -> float:
        q = self._problem
        bounds = (q.rows, q.shape, q.planes, q.disc, q.polygon, q.edge, q.samples)
        return float(
            evaluate(
                q.parameters, q.tau, states, self._weight, self._resting, q.points, q.start, *bounds,
                self.g, self.ab, True,
            )
        )  # fmt: skip


def minimise(
    problem: Problem,
    guess: Array,
    tolerance_m: float,
    solves_max: int,
    kept: Statistics | None = None,
    damping: float = 0.0,
) -> Solution:
    """Trajectory (n,10) of least objective near ``guess``, whose first position and velocity are held.

    ``kept`` and ``damping`` are those of the descent that ``guess`` continues (statistics None: taken about the
    guess). Converged: a step of full length moves no sample by more than ``tolerance_m``, or nothing decreases any
    more. At most ``solves_max`` linear systems are solved.
    """
    s, n = np.array(guess, dtype=float), len(guess)
    at = _Objective(problem, s, kept)
    steps: list[float] = []
    cost, solves = at(s), 0
    costs, converged = [cost], False
    while solves < solves_max and not converged:
        system(at.g, at.ab)
        gradient, band = at.g.copy(), at.ab.copy()
        trial, new = None, np.inf
        while solves < solves_max and damping <= _DAMPING_MAX:
            solves += 1
            trial = _step(band, gradient, damping, n)
            new = at(s + trial) if trial is not None else np.inf
            if new <= cost + 1e-12 * abs(cost):
                break
            trial, damping = None, max(4.0 * damping, 1e-3)
        if trial is None:  # nothing decreases, or the solves are spent
            converged, damping = damping > _DAMPING_MAX, min(damping, _DAMPING_MAX)
            break
        s = s + trial
        steps.append(float(np.linalg.norm(trial[:, :3], axis=1).max()))
        converged = (damping < 1.0 and steps[-1] <= tolerance_m) or cost - new <= _FLAT * abs(cost)
        cost = new
        costs.append(cost)
        damping = 0.25 * damping if damping > 1e-3 else 0.0
    return Solution(s, cost, solves, converged, tuple(steps), tuple(costs), at.statistics, damping)


def _step(band: Array, gradient: Array, damping: float, n: int) -> Array | None:
    damped = band.copy()
    damped[0] *= 1.0 + damping
    try:
        return np.asarray(-solveh_banded(damped, gradient, lower=True, check_finite=False)).reshape(n, 10)
    except LinAlgError:
        return None
