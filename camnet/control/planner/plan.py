"""What a plan is: waypoints asked for, the trajectory found, and the work that is left for the next call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from camnet.control.planner.curve import Curve
from camnet.control.planner.solver import Statistics
from camnet.errors import ConfigError
from camnet.types import Array

__all__ = ["Level", "Plan", "Waypoint", "Work", "check", "deviation", "merit"]

#: deviation from a waypoint that is accepted, in standard deviations
GATE = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class Waypoint:
    """Be at ``p_world`` (3,) m at ``t_s`` after the plan's start, with covariance (3,3) m^2."""

    t_s: float
    p_world: Array
    covariance: Array


class Level(NamedTuple):
    """How often an attempt was repeated with a wider berth, and how often insisting more on the waypoints."""

    berth: int = 0
    insist: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class Work:
    """A descent and those still to try after it.

    Attributes
    ----------
    starts : trajectories (n,10): where the present descent stands, then the starts of the next attempts
    level : what the present attempt insists on
    attempt : number of the present attempt
    spent : linear solves of the present descent so far
    statistics, damping : of the present descent (None: to be taken about its start)
    warm : whether the first start was the last plan renewed
    cold : whether the starts from splines are among ``starts`` or were already tried
    """

    starts: tuple[Array, ...]
    level: Level = field(default_factory=Level)
    attempt: int = 0
    spent: int = 0
    statistics: Statistics | None = None
    damping: float = 0.0
    warm: bool = False
    cold: bool = False

    def after(self, steps: int, p: Array, v: Array) -> Work:
        """Return the same work ``steps`` steps later, for a body that is at ``p`` with velocity ``v`` (3,)."""
        starts = tuple(start[steps:].copy() for start in self.starts)
        for start in starts:
            start[0, :3], start[0, 3:6] = p, v
        kept = self.statistics.after(steps) if self.statistics is not None else None
        return replace(self, starts=starts, statistics=kept)


@dataclass(frozen=True, eq=False, slots=True)
class Plan:
    """A planned trajectory.

    Attributes
    ----------
    states : (n,10) x, v, p, cT at the samples
    curve : C1 curve through them
    clearance_m : certified smallest distance of the curve to any obstacle (inf: none)
    depth_m : smallest depth of the curve in the region (inf: no region)
    deviations : (m,) Mahalanobis distances at the waypoints
    safe : clearance and depth are those asked for
    met : every waypoint is within two standard deviations
    cost : of the objective
    steps : (k,) largest moves of a sample by the linear solves of the descent in this call, m
    iterations : linear solves of the call in the descent that gave the plan
    solves : linear solves of the call in all, other starts included
    converged : whether the descent is at its end
    near : obstacles whose influence the plan felt
    warm : whether it is the last plan renewed: same horizon, one step later
    kept : whether it is the tail of the last plan, because the descent has nothing better yet
    level : what the attempt that made it insisted on
    statistics : process covariances of the descent
    pending : what is left to do at the next call (None: nothing)
    """

    states: Array
    curve: Curve
    clearance_m: float
    depth_m: float
    deviations: Array
    safe: bool
    met: bool
    cost: float
    steps: tuple[float, ...]
    iterations: int
    solves: int
    converged: bool
    near: int
    warm: bool
    level: Level
    statistics: Statistics
    kept: bool = False
    pending: Work | None = None


def deviation(curve: Curve, waypoint: Waypoint) -> float:
    """Mahalanobis distance of a curve from a waypoint at its time."""
    away = curve.at(min(waypoint.t_s, curve.duration_s))[0] - waypoint.p_world
    return float(np.sqrt(away @ np.linalg.solve(waypoint.covariance, away)))


def merit(plan: Plan) -> tuple[bool, tuple[bool, ...], float]:
    """Order of plans: safe, then meeting the first waypoint, the second, ..., then probable."""
    missed = tuple(not d <= GATE for d in plan.deviations.tolist())
    return (not plan.safe, missed, plan.cost if plan.safe else -plan.clearance_m)


def check(p: Array, v: Array, waypoints: Sequence[Waypoint]) -> None:
    """Refuse what no plan can start from.

    Raises
    ------
    ConfigError
        Position or velocity is not three finite numbers; the waypoints' times are not positive and ascending.
    """
    if p.shape != (3,) or v.shape != (3,) or not np.isfinite([p, v]).all():
        raise ConfigError(f"plan: position {p} and velocity {v} must be three finite numbers each")
    times = [w.t_s for w in waypoints]
    if not times or times[0] <= 0.0 or any(b <= a for a, b in pairwise(times)):
        raise ConfigError(f"plan: waypoint times {times} must be positive and ascending, at least one")
