"""One agent's reference among obstacles inside its operating region: straight on where the way is free, else a plan.

The way around is found in three stages: a taut polyline of a road map (`route`), a plan through its corners as timed
waypoints (`planner`), and, should that not keep all bounds, the polyline itself with a stop at every corner. So an
agent stays where it is only when there is no way, up to the road map's spacing.

Invariant: in straight flight the segment on which full braking ends keeps ``obstacle_margin_m`` from every
obstacle; a step that would break it is replaced by braking, which moves along that segment. A plan is taken up
only when its whole curve keeps the margins, within the bounds of speed and acceleration, and ends at rest. So the
position and velocity handed out are continuous and clear of obstacles at all times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from camnet.control.planner.curve import Curve
from camnet.control.planner.distance_kernel import segment_clearance, signed_distance
from camnet.control.planner.obstacles import Obstacle, from_shape, pack
from camnet.control.planner.plan import Waypoint
from camnet.control.planner.planner import Planner
from camnet.control.planner.route import RoadMap
from camnet.control.planner.settings import PlannerSettings
from camnet.control.settings import ControllerSettings
from camnet.geometry.regions import BoxRegion, Region
from camnet.geometry.settings import Shape
from camnet.types import Array

__all__ = ["Pilot", "pilots", "planner_settings"]

#: a plan is renewed when the goal has moved by this (m), at most this often (s)
_MOVED_M, _RENEW_S = 0.2, 0.5
#: factors of the first guess of a plan's duration
_SLOWER = (1.0, 1.5)
_GOAL_SD_M, _CORNER_SD_M = 0.01, 0.3
#: room about the obstacles of an agent without a region, m
_AROUND_M = 5.0


def planner_settings(s: ControllerSettings) -> PlannerSettings:
    """Planner for the speeds and margins of a controller: the prior scaled with its speed and acceleration."""
    v, a = s.reference_v_max_mps, s.reference_a_max_mps2
    return PlannerSettings(
        dt_s=0.25,
        beta_mps2=0.1 * a,
        power_density=(a * v) ** 2 / 4.0,
        steering_density=0.5,
        velocity_density=0.5 * a * a / 4.0,
        acceleration_density=0.25 * a * a / 4.0,
        rest_speed_mps=0.3 * v,
        rest_density=0.5 * a * a / 4.0,
        safety_m=s.obstacle_margin_m,
        margin_m=s.obstacle_margin_m + 0.1,
        softness_m=0.04,
        obstacle_rate_hz=20.0,
        samples_per_step=3,
        region_margin_m=s.region_margin_m,
        tolerance_m=0.01,
        iterations_max=20,
        patience=12,
        attempts=2,
    )


def pilots(
    settings: ControllerSettings, regions: Sequence[Region | None], occluders: Sequence[Shape], dt_s: float
) -> dict[int, Pilot]:
    """Pilots of the agents (by number) with an occluder within their region or close beside it."""
    solids = [from_shape(shape) for shape in occluders]
    reach = settings.obstacle_margin_m
    out: dict[int, Pilot] = {}
    for i, region in enumerate(regions):
        near = [o for o in solids if region is None or _meets(region, o, reach - settings.region_margin_m)]
        if near:
            out[i] = Pilot(settings, region, near, dt_s)
    return out


def _meets(region: Region, obstacle: Obstacle, reach: float) -> bool:
    """Whether the boxes around a region and an obstacle come within ``reach``."""
    turn, half = obstacle.row[7:16].reshape(3, 3), obstacle.row[16:19]
    extent = np.abs(turn) @ half + reach
    low, high = region.bounds
    return bool(((obstacle.center + extent > low) & (obstacle.center - extent < high)).all())


def _around(obstacles: Sequence[Obstacle]) -> Region:
    centers = np.array([o.center for o in obstacles])
    reach = max(float(np.linalg.norm(o.row[16:19])) for o in obstacles) + _AROUND_M
    return BoxRegion("around", centers.min(axis=0) - reach, centers.max(axis=0) + reach)


class Pilot:
    """Reference of one agent in ``region`` among ``obstacles``, renewed every ``dt_s``."""

    def __init__(
        self, settings: ControllerSettings, region: Region | None, obstacles: Sequence[Obstacle], dt_s: float
    ) -> None:
        self._settings, self._region, self._dt = settings, region, dt_s
        self._obstacles, self._rows = tuple(obstacles), pack(obstacles)
        self._planner = Planner(planner_settings(settings), region)
        self._map = RoadMap(
            region or _around(obstacles), self._rows, settings.region_margin_m, settings.obstacle_margin_m
        )
        self.reset()

    def reset(self) -> None:
        """Forget the plan."""
        self._curve: Curve | None = None
        self._t, self._wait = 0.0, 0.0
        self._goal, self._asked = np.full(3, np.nan), np.full(3, np.nan)

    def _clear(self, start: Array, end: Array) -> bool:
        least = self._settings.obstacle_margin_m - 1e-6
        return all(segment_clearance(row, start, end, 0.0) >= least for row in self._rows)

    def _stop(self, p: Array, v: Array) -> Array:
        return p + v * (float(np.linalg.norm(v)) / (2.0 * self._settings.reference_a_max_mps2))

    def _reachable(self, goal: Array) -> Array:
        """Nearest point found to ``goal`` (3,) that keeps the margins of region and obstacles."""
        out, normal = goal.copy(), np.empty(3)
        wanted = self._planner.settings.margin_m + 0.1
        for _ in range(10):
            short = False
            for row in self._rows:
                lack = wanted - signed_distance(row, out, 0.0, normal)
                if lack > 1e-6:
                    out, short = out + lack * normal, True
            if self._region is not None:
                out = self._region.project(out, self._settings.region_margin_m + 0.1)
            if not short:
                break
        return out

    def goal(self, goal: Array) -> Array:
        """Where to go instead of ``goal`` (3,), which may lie in an obstacle."""
        if not np.array_equal(goal, self._asked):
            self._asked = goal.copy()
            near = any(
                signed_distance(r, goal, 0.0, np.empty(3)) < self._planner.settings.margin_m
                for r in self._rows
            )
            self._goal = self._reachable(goal) if near else goal.copy()
        return self._goal

    def step(self, before: Array, straight: Array, goal: Array) -> Array:
        """Next motion (9,): p, v, a; ``straight`` is the step that a free way allows, ``before`` the present one."""
        self._wait = max(self._wait - self._dt, 0.0)
        p, v = straight[:3], straight[3:6]
        if self._curve is None or self._t >= self._curve.duration_s:
            self._curve = None
            safe = self._clear(p, self._stop(p, v))
            if safe and self._clear(p, goal):
                return straight
            self._take_up(before, goal)
            if self._curve is None:
                return self._brake(before)
        elif self._clear(before[:3], goal) and self._clear(p, self._stop(p, v)) and self._inside(p, v):
            self._curve = None
            return straight
        elif np.linalg.norm(goal - self._curve.x[-1]) > _MOVED_M:
            self._take_up(before, goal)
        self._t += self._dt
        return np.concatenate(self._curve.at(self._t))

    def _inside(self, p: Array, v: Array) -> bool:
        if self._region is None:
            return True
        ends = np.stack([p, self._stop(p, v)])
        return bool((self._region.signed_distance(ends) <= -self._settings.region_margin_m).all())

    def _brake(self, before: Array) -> Array:
        p, v, dt = before[:3], before[3:6], self._dt
        speed, a_max = float(np.linalg.norm(v)), self._settings.reference_a_max_mps2
        if speed <= a_max * dt:
            return np.concatenate([self._stop(p, v), np.zeros(6)])
        a = -a_max / speed * v
        return np.concatenate([p + dt * v + 0.5 * dt * dt * a, v + dt * a, a])

    def _take_up(self, before: Array, goal: Array) -> None:
        """Find a way from the present motion to ``goal``; what is in force stays when there is none."""
        if self._wait > 0.0:
            return
        self._wait = _RENEW_S
        p, v = before[:3], before[3:6]
        corners = self._map.route(p, goal)
        if corners is None:
            return
        curve = self._smooth(p, v, corners)
        if curve is None and self._curve is None:
            if float(np.linalg.norm(v)) > 1e-9:  # come to rest first
                self._wait = 0.0
                return
            curve = self._stop_and_go(corners)
        if curve is not None:
            self._curve, self._t = curve, 0.0

    def _smooth(self, p: Array, v: Array, corners: Array) -> Curve | None:
        """Plan along a route (k,3) that keeps margins, speed and acceleration; None if there is none."""
        s, tau = self._settings, self._planner.settings.dt_s
        lengths = np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))
        pace, ends = 0.55 * s.reference_v_max_mps, s.reference_v_max_mps / s.reference_a_max_mps2
        for slower in _SLOWER:
            times = slower * (lengths / pace + 0.5 * ends)
            duration = tau * max(math.ceil((times[-1] + 0.5 * slower * ends) / tau), 4)
            plan = self._planner.plan(p, v, self._timed(corners, times, duration), self._obstacles, stop=True)
            speed, acceleration = plan.curve.fastest()
            arrives = float(np.linalg.norm(plan.curve.x[-1] - corners[-1])) < _MOVED_M
            if (
                plan.safe
                and arrives
                and speed <= s.reference_v_max_mps
                and acceleration <= s.reference_a_max_mps2
            ):
                return plan.curve
        return None

    def _timed(self, corners: Array, times: Array, duration: float) -> list[Waypoint]:
        """Corners of a route as loose waypoints, its end as a tight one."""
        tau, out = self._planner.settings.dt_s, []
        last = 0.0
        for t, corner in zip(times[:-1], corners[1:-1], strict=True):
            if t - last >= 2.0 * tau and duration - t >= 2.0 * tau:
                out.append(Waypoint(float(t), corner, _CORNER_SD_M**2 * np.eye(3)))
                last = float(t)
        return [*out, Waypoint(duration, corners[-1], _GOAL_SD_M**2 * np.eye(3))]

    def _stop_and_go(self, corners: Array) -> Curve:
        """Fly a route (k,3) leg by leg, at rest at every corner: cubic in time, peaks 1.5 L/T and 6 L/T^2."""
        s, tau = self._settings, self._planner.settings.dt_s
        xs, vs = [corners[:1]], [np.zeros((1, 3))]
        for a, b in pairwise(corners):
            size = float(np.linalg.norm(b - a))
            least = max(1.5 * size / s.reference_v_max_mps, math.sqrt(6.0 * size / s.reference_a_max_mps2))
            steps = max(math.ceil(least / tau), 1)
            u = np.arange(1, steps + 1)[:, None] / steps
            xs.append(a + u * u * (3.0 - 2.0 * u) * (b - a))
            vs.append(6.0 * u * (1.0 - u) * (b - a) / (steps * tau))
        return Curve(np.concatenate(xs), np.concatenate(vs), tau)
