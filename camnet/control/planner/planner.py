"""MAP trajectory through timed waypoints and around obstacles, re-planned from the last plan (li2019, section V-B).

A plan is the most probable trajectory of the power-limited steering model through waypoints, taken as observations with
covariances, that no obstacle blocks (42)-(44). `Planner.plan` starts from the tail of the last plan where it
can, else from a spline pushed out of the obstacles (`camnet.control.planner.starts`), descends
(`camnet.control.planner.solver`), and checks the whole curve; where that fails it tries the next homotopy class,
then a wider berth.

**Real-time iteration.** With ``solves_per_plan`` a call solves at most so many linear systems. What is not finished is
carried to the next call, and until its curve passes the check the last plan, which did, stays in force (M. Diehl
et al., "Real-time optimization and nonlinear model predictive control", 2002, for the scheme without obstacles).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from camnet.control.planner.curve import Curve
from camnet.control.planner.obstacles import Obstacle, pack
from camnet.control.planner.plan import GATE, Level, Plan, Waypoint, Work, check, deviation, merit
from camnet.control.planner.settings import PlannerSettings
from camnet.control.planner.solver import Problem, Solution, minimise, objective
from camnet.control.planner.starts import Knots, guesses, states_of
from camnet.control.references import RegionBounds
from camnet.errors import ConfigError
from camnet.estimation.pls import PowerLimitedSteering
from camnet.geometry.regions import Region
from camnet.types import Array

__all__ = ["Plan", "Planner", "Waypoint"]


@dataclass(frozen=True, eq=False, slots=True)
class _Task:
    """One call: from ``p`` with velocity ``v`` (3,) through ``waypoints`` past obstacles ``rows``, ``n`` samples."""

    p: Array
    v: Array
    waypoints: tuple[Waypoint, ...]
    rows: Array
    n: int
    stop: bool


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
        last : the plan in force, ``elapsed_steps`` steps old; it stays in force where it is better than what
            ``settings.solves_per_plan`` linear solves have found
        stop : come to rest at the last waypoint
        """
        p, v = np.asarray(p_world, dtype=float), np.asarray(v_world, dtype=float)
        check(p, v, waypoints)
        rows, n = pack(obstacles), self._length(waypoints)
        task = _Task(p, v, tuple(waypoints), rows, n, stop)
        made = self._work(
            task, self._resumed(task, last, elapsed_steps) or self._new(task, last, elapsed_steps)
        )
        tail = self._tail(task, last, elapsed_steps)
        if tail is None or merit(tail)[:2] >= merit(made)[:2]:
            return made
        return replace(
            tail, iterations=made.iterations, solves=made.solves, steps=made.steps, pending=made.pending
        )

    def _resumed(self, task: _Task, last: Plan | None, elapsed: int) -> Work | None:
        """Work that the last plan left, unless the horizon is a new one."""
        if last is None or last.pending is None or len(last.pending.starts[0]) - elapsed != task.n:
            return None
        return last.pending.after(elapsed, task.p, task.v)

    def _new(self, task: _Task, last: Plan | None, elapsed: int) -> Work:
        """Begin with the last plan renewed; at a new horizon, or without one, also with splines."""
        warm = self._extended(task, last.states, elapsed) if last is not None else []
        if last is not None and len(last.states) - elapsed >= task.n:
            return Work((warm[0],), last.level, statistics=last.statistics.after(elapsed), warm=True)
        if last is not None and last.pending is not None:  # unfinished, but ahead of the plan in force
            warm += self._extended(task, last.pending.starts[0], elapsed)
        cold = self._cold(task)
        return Work((*self._ranked(task, [*warm, *cold[:1]]), *cold[1:]), cold=True)

    def _work(self, task: _Task, work: Work) -> Plan:
        """Descend from start after start until a plan is good, nothing is left, or the call's solves are spent."""
        s = self.settings
        budget = s.solves_per_plan or s.attempts * s.iterations_max
        solves, best = 0, None
        left: Work | None = work
        while left is not None and solves < budget:
            work = left
            problem = self._problem(task, work.starts[0], work.level)
            limit = s.patience if work.spent < s.patience else s.iterations_max
            most = min(limit - work.spent, budget - solves)
            solution = minimise(problem, work.starts[0], s.tolerance_m, most, work.statistics, work.damping)
            solves += solution.iterations
            made = self._judge(task, solution, work)
            if best is None or merit(made) < merit(best):
                best = made
            left = self._next(task, work, solution, made)
        assert best is not None
        return replace(best, solves=solves, pending=left)

    def _next(self, task: _Task, work: Work, solution: Solution, made: Plan) -> Work | None:
        """Say what is left after one descent: to go on with it, the next start with more insistence, or nothing."""
        s, spent = self.settings, work.spent + solution.iterations
        good = made.safe and made.met
        if not solution.converged and spent < (s.iterations_max if good else s.patience):
            starts = (solution.states, *work.starts[1:])
            return replace(
                work, starts=starts, spent=spent, statistics=solution.statistics, damping=solution.damping
            )
        starts = work.starts[1:]
        if good or work.attempt + 1 >= s.attempts:
            return None
        if not work.cold:
            starts += tuple(self._cold(task))
        if made.safe:  # a waypoint is missed: from here, insisting more
            starts = (solution.states, *starts)
        if not starts:
            return None
        level = Level(work.level.berth + (not made.safe), work.level.insist + (not made.met))
        return Work(starts, level, work.attempt + 1, cold=True)

    def _tail(self, task: _Task, last: Plan | None, elapsed: int) -> Plan | None:
        """Judge what is left of the last plan; None without a safe one, or where the body is not on it."""
        if last is None or not last.safe or len(last.states) - elapsed < 2 or elapsed < 1:
            return None
        states = last.states[elapsed:][: task.n].copy()
        if not np.allclose(states[0, :6], [*task.p, *task.v], atol=1e-9):
            return None
        kept = last.statistics.after(elapsed)
        solution = Solution(states, last.cost, 0, last.converged, (), (), kept)
        tail = self._judge(task, solution, Work((states,), last.level))
        return replace(tail, kept=True) if tail.safe else None

    def _length(self, waypoints: Sequence[Waypoint]) -> int:
        return max(round(waypoints[-1].t_s / self.settings.dt_s + 0.499), 1) + 1

    def _extended(self, task: _Task, states: Array, elapsed: int) -> list[Array]:
        """Tail of a trajectory, extended by a spline to the waypoints beyond its end; nothing if it is over."""
        if len(states) - elapsed < 2:
            return []
        tail, tau = states[elapsed:][: task.n].copy(), self.settings.dt_s
        tail[0, :3], tail[0, 3:6] = task.p, task.v
        missing = task.n - len(tail)
        if missing > 0:
            end = tau * (len(tail) - 1)
            beyond = [w for w in task.waypoints if w.t_s > end + 0.5 * tau]
            times = np.array([0.0, *(w.t_s - end for w in beyond)])
            points = np.array([tail[-1, :3], *(w.p_world for w in beyond)])
            spline = Knots(times, points, tail[-1, 3:6]).spline()
            more = self._states(spline, tau * np.arange(1, missing + 1, dtype=np.float64))
            tail = np.concatenate([tail, more])
        return [tail]

    def _states(self, spline: object, t: Array) -> Array:
        s = self.settings
        return states_of(spline(t), spline(t, 1), spline(t, 2), s.alpha_per_s, s.beta_mps2, s.rest_speed_mps)  # type: ignore[operator]

    def _cold(self, task: _Task) -> list[Array]:
        """Return starts from splines around the obstacles, best first."""
        s = self.settings
        times = np.array([0.0, *(w.t_s for w in task.waypoints)])
        points = np.array([task.p, *(w.p_world for w in task.waypoints)])
        knots = Knots(times, points, task.v, task.stop)
        splines = guesses(knots, task.rows, s.margin_m, s.dt_s, task.n, s.directions)
        t = s.dt_s * np.arange(task.n, dtype=np.float64)
        out = []
        for spline in splines[: s.attempts]:
            states = self._states(spline, t)
            states[0, :3], states[0, 3:6] = task.p, task.v
            out.append(states)
        return out

    def _ranked(self, task: _Task, starts: list[Array]) -> list[Array]:
        """Sort starts by the objective there."""
        if len(starts) < 2:
            return starts
        costs = [objective(self._problem(task, s, Level()), s) for s in starts]
        return [starts[k] for k in np.argsort(costs)]

    def _problem(self, task: _Task, guess: Array, level: Level) -> Problem:
        """Objective of an attempt; a wider berth also weighs more, insisting narrows the berth towards the safety."""
        s, tau, bounds = self.settings, self.settings.dt_s, self._bounds
        rate = s.obstacle_rate_hz * 2.0**level.berth
        berth = 0.5 * s.safety_m * level.berth
        margin = s.safety_m + berth + (s.margin_m - s.safety_m) * 0.5**level.insist
        weight = s.waypoint_weight * 3.0**level.insist
        points = np.empty((len(task.waypoints), 14))
        for row, w in zip(points, task.waypoints, strict=True):
            i = min(int(w.t_s / tau + 1e-9), len(guess) - 2)
            row[0], row[1], row[2:5] = i, w.t_s / tau - i, w.p_world
            row[5:] = weight * np.linalg.inv(w.covariance).ravel()
        precision = [s.start_power_sd**-2, *3 * [s.start_turn_sd_radps**-2]]
        start = np.array(
            [*guess[0, 6:10], *precision, 1e4 if task.stop else 0.0, 1.0 / s.acceleration_density]
        )
        return Problem(
            self._model.parameters, tau, points, start, s.rest_speed_mps, task.rows,
            np.array([margin, s.softness_m, rate]),
            bounds.planes, bounds.disc, bounds.polygon,
            np.array([s.region_margin_m + margin - s.safety_m, s.softness_m, rate]),
            s.samples_per_step,
        )  # fmt: skip

    def _judge(self, task: _Task, solution: Solution, work: Work) -> Plan:
        s = self.settings
        states = solution.states
        curve = Curve(states[:, :3].copy(), states[:, 3:6].copy(), s.dt_s)
        gaps, _ = curve.clearance(task.rows)
        clearance = float(gaps.min()) if len(gaps) else np.inf
        depth = np.inf
        if self.region is not None:
            depth = -float(self.region.signed_distance(curve.points(10)).max())
        deviations = np.array([deviation(curve, w) for w in task.waypoints])
        return Plan(
            states=states,
            curve=curve,
            clearance_m=clearance,
            depth_m=depth,
            deviations=deviations,
            safe=clearance >= s.safety_m and depth >= s.region_margin_m - 1e-9,
            met=bool((deviations <= GATE).all()),
            cost=solution.cost,
            steps=solution.steps,
            iterations=solution.iterations,
            solves=solution.iterations,
            converged=solution.converged,
            near=int(np.sum(gaps < s.margin_m + 8.0 * s.softness_m)),
            warm=work.warm and work.attempt == 0,
            level=work.level,
            statistics=solution.statistics,
        )
