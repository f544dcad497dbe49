"""MAP trajectory through timed waypoints and around obstacles, re-planned from the last plan (li2019, section V-B).

A plan is the most probable trajectory of the power-limited steering model through waypoints, taken as observations with
covariances, that no obstacle blocks (42)-(44). `Planner.plan` starts from the tail of the last plan where it
can, else from a spline pushed out of the obstacles (`camnet.control.planner.starts`), descends
(`camnet.control.planner.solver`), and checks the whole curve; where that fails it tries the next homotopy class,
then a wider berth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from camnet.control.planner.curve import Curve
from camnet.control.planner.obstacles import Obstacle, pack
from camnet.control.planner.settings import PlannerSettings
from camnet.control.planner.solver import Problem, Solution, minimise, objective
from camnet.control.planner.starts import Knots, guesses, states_of
from camnet.control.references import RegionBounds
from camnet.errors import ConfigError
from camnet.estimation.pls import PowerLimitedSteering
from camnet.geometry.regions import Region
from camnet.types import Array

__all__ = ["Plan", "Planner", "Waypoint"]

#: deviation from a waypoint that is accepted, in standard deviations
_GATE = 2.0


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
    iterations : linear solves of the descent that gave the plan
    near : obstacles whose influence the plan felt
    solves : linear solves in all, other starts included
    warm : whether it is the last plan renewed: same horizon, one step later
    level : what the attempt that made it insisted on
    """

    states: Array
    curve: Curve
    clearance_m: float
    depth_m: float
    deviations: Array
    safe: bool
    met: bool
    iterations: int
    solves: int
    near: int
    warm: bool
    level: Level
    solution: Solution


class Planner:
    """Planner of one body.

    Parameters
    ----------
    settings : prior, obstacle likelihood, margins
    region : where the whole curve has to stay (None: anywhere)

    Raises
    ------
    ConfigError
        ``safety_m`` is not below ``margin_m``.
    """

    def __init__(self, settings: PlannerSettings, region: Region | None = None) -> None:
        s = self.settings = settings
        if s.safety_m >= s.margin_m:
            raise ConfigError(
                f"planner.safety_m = {s.safety_m:g} must be below planner.margin_m = {s.margin_m:g}"
            )
        self.region = region
        self._bounds = RegionBounds.of(region)
        self._model = PowerLimitedSteering(
            alpha=s.alpha_per_s,
            beta=s.beta_mps2,
            power_density=s.power_density,
            steering_density=s.steering_density,
            velocity_density=s.velocity_density,
            rest_speed=1e-3 * s.rest_speed_mps,
            rest_density=s.rest_density,
        )

    def plan(
        self,
        p_world: ArrayLike,
        v_world: ArrayLike,
        waypoints: Sequence[Waypoint],
        obstacles: Sequence[Obstacle] = (),
        last: Plan | None = None,
        elapsed_steps: int = 1,
        stop: bool = False,
    ) -> Plan:
        """Plan from ``p_world``, ``v_world`` (3,) to the last waypoint.

        Parameters
        ----------
        waypoints : ascending in time; the horizon ends at the last one
        obstacles : as they are now
        last : the plan in force, ``elapsed_steps`` steps old
        stop : come to rest at the last waypoint
        """
        p, v = np.asarray(p_world, dtype=float), np.asarray(v_world, dtype=float)
        _check(p, v, waypoints)
        rows, n = pack(obstacles), self._length(waypoints)
        s = self.settings
        warm = self._warm(last, elapsed_steps, n, p, v, waypoints)
        extended = not warm or len(last.states) - elapsed_steps < n if last is not None else True
        cold = self._cold(p, v, waypoints, rows, n, stop) if extended else []
        starts = self._ranked([*warm, *cold[:1]], waypoints, rows, stop) + cold[1:]
        renewed = bool(warm) and not extended
        kept = last.solution.statistics.after(elapsed_steps) if last is not None and renewed else None
        level = last.level if last is not None and renewed else Level()
        solves, best = 0, None
        for attempt in range(s.attempts):
            if attempt == 1 and not cold:
                starts += self._cold(p, v, waypoints, rows, n, stop)
            if attempt >= len(starts):
                break
            problem = self._problem(starts[attempt], waypoints, rows, level, stop)
            solution = minimise(
                problem, starts[attempt], s.tolerance_m, s.iterations_max, kept if attempt == 0 else None
            )
            solves += solution.iterations
            made = self._judge(solution, waypoints, rows, level, attempt == 0 and renewed)
            if best is None or _merit(made) < _merit(best):
                best = made
            if made.safe and made.met:
                break
            level = Level(level.berth + (not made.safe), level.insist + (not made.met))
        assert best is not None
        return replace(best, solves=solves)

    def _length(self, waypoints: Sequence[Waypoint]) -> int:
        return max(round(waypoints[-1].t_s / self.settings.dt_s + 0.499), 1) + 1

    def _warm(
        self, last: Plan | None, elapsed: int, n: int, p: Array, v: Array, waypoints: Sequence[Waypoint]
    ) -> list[Array]:
        """Tail of the last plan, extended by a spline to the waypoints beyond its end."""
        if last is None or len(last.states) - elapsed < 2:
            return []
        tail, tau = last.states[elapsed:][:n].copy(), self.settings.dt_s
        tail[0, :3], tail[0, 3:6] = p, v
        missing = n - len(tail)
        if missing > 0:
            end = tau * (len(tail) - 1)
            beyond = [w for w in waypoints if w.t_s > end + 0.5 * tau]
            times = np.array([0.0, *(w.t_s - end for w in beyond)])
            points = np.array([tail[-1, :3], *(w.p_world for w in beyond)])
            spline = Knots(times, points, tail[-1, 3:6]).spline()
            tail = np.concatenate(
                [tail, self._states(spline, tau * np.arange(1, missing + 1, dtype=np.float64))]
            )
        return [tail]

    def _states(self, spline: object, t: Array) -> Array:
        s = self.settings
        return states_of(spline(t), spline(t, 1), spline(t, 2), s.alpha_per_s, s.beta_mps2, s.rest_speed_mps)  # type: ignore[operator]

    def _cold(
        self, p: Array, v: Array, waypoints: Sequence[Waypoint], rows: Array, n: int, stop: bool
    ) -> list[Array]:
        """Return starts from splines around the obstacles, best first."""
        s = self.settings
        times = np.array([0.0, *(w.t_s for w in waypoints)])
        points = np.array([p, *(w.p_world for w in waypoints)])
        splines = guesses(Knots(times, points, v, stop), rows, s.margin_m, s.dt_s, n, s.directions)
        t = s.dt_s * np.arange(n, dtype=np.float64)
        out = []
        for spline in splines[: s.attempts]:
            states = self._states(spline, t)
            states[0, :3], states[0, 3:6] = p, v
            out.append(states)
        return out

    def _ranked(
        self, starts: list[Array], waypoints: Sequence[Waypoint], rows: Array, stop: bool
    ) -> list[Array]:
        """Sort starts by the objective there."""
        if len(starts) < 2:
            return starts
        costs = [objective(self._problem(s, waypoints, rows, Level(), stop), s) for s in starts]
        return [starts[k] for k in np.argsort(costs)]

    def _problem(
        self, guess: Array, waypoints: Sequence[Waypoint], rows: Array, level: Level, stop: bool
    ) -> Problem:
        """Objective of an attempt; a wider berth also weighs more, insisting narrows the berth towards the safety."""
        s, tau, bounds = self.settings, self.settings.dt_s, self._bounds
        rate = s.obstacle_rate_hz * 2.0**level.berth
        berth = 0.5 * s.safety_m * level.berth
        margin = s.safety_m + berth + (s.margin_m - s.safety_m) * 0.5**level.insist
        weight = s.waypoint_weight * 3.0**level.insist
        points = np.empty((len(waypoints), 14))
        for row, w in zip(points, waypoints, strict=True):
            i = min(int(w.t_s / tau + 1e-9), len(guess) - 2)
            row[0], row[1], row[2:5] = i, w.t_s / tau - i, w.p_world
            row[5:] = weight * np.linalg.inv(w.covariance).ravel()
        precision = [s.start_power_sd**-2, *3 * [s.start_turn_sd_radps**-2]]
        start = np.array([*guess[0, 6:10], *precision, 1e4 if stop else 0.0, 1.0 / s.acceleration_density])
        return Problem(
            self._model.parameters, tau, points, start, s.rest_speed_mps, rows,
            np.array([margin, s.softness_m, rate]),
            bounds.planes, bounds.disc, bounds.polygon,
            np.array([s.region_margin_m + margin - s.safety_m, s.softness_m, rate]),
            s.samples_per_step,
        )  # fmt: skip

    def _judge(
        self, solution: Solution, waypoints: Sequence[Waypoint], rows: Array, level: Level, warm: bool
    ) -> Plan:
        s = self.settings
        states = solution.states
        curve = Curve(states[:, :3].copy(), states[:, 3:6].copy(), s.dt_s)
        gaps, _ = curve.clearance(rows)
        clearance = float(gaps.min()) if len(gaps) else np.inf
        depth = np.inf
        if self.region is not None:
            depth = -float(self.region.signed_distance(curve.points(10)).max())
        deviations = np.array([_deviation(curve, w) for w in waypoints])
        safe = clearance >= s.safety_m and depth >= s.region_margin_m - 1e-9
        return Plan(
            states=states,
            curve=curve,
            clearance_m=clearance,
            depth_m=depth,
            deviations=deviations,
            safe=safe,
            met=bool((deviations <= _GATE).all()),
            iterations=solution.iterations,
            solves=solution.iterations,
            near=int(np.sum(gaps < s.margin_m + 8.0 * s.softness_m)),
            warm=warm,
            level=level,
            solution=solution,
        )


def _deviation(curve: Curve, waypoint: Waypoint) -> float:
    away = curve.at(min(waypoint.t_s, curve.duration_s))[0] - waypoint.p_world
    return float(np.sqrt(away @ np.linalg.solve(waypoint.covariance, away)))


def _merit(plan: Plan) -> tuple[bool, bool, float]:
    """Order of plans: safe before met before probable."""
    return (not plan.safe, not plan.met, plan.solution.cost if plan.safe else -plan.clearance_m)


def _check(p: Array, v: Array, waypoints: Sequence[Waypoint]) -> None:
    if p.shape != (3,) or v.shape != (3,) or not np.isfinite([p, v]).all():
        raise ConfigError(f"plan: position {p} and velocity {v} must be three finite numbers each")
    times = [w.t_s for w in waypoints]
    if not times or times[0] <= 0.0 or any(b <= a for a, b in pairwise(times)):
        raise ConfigError(f"plan: waypoint times {times} must be positive and ascending, at least one")
