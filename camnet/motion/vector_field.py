"""A differential-drive robot that steers along a planar vector field (the target of parikh2018, experiment 1).

| symbol | name | unit |
| --- | --- | --- |
| (x, y), theta | position and heading | m, rad |
| psi(x, y), s(x, y) | direction and speed that the field wants | rad, m/s |
| k | heading gain | 1/s |
| v, w | forward and turning speed: ``x' = v cos theta``, ``y' = v sin theta``, ``theta' = w`` | m/s, rad/s |
| b | distance between the wheels; their rims run at ``v -+ w b/2`` | m |

``v = s`` and ``w = k (psi - theta) + grad psi . (x', y')``. The second term makes ``theta = psi`` an invariant set: the
heading error obeys ``e' = -k e`` exactly, and once it has died the velocity is a function of position alone, which is
what the published estimator learns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry import rotations
from camnet.motion.fields import LoopField, PlanarField, loop_guide
from camnet.motion.protocol import TargetState, planar_state
from camnet.types import Array, Twist

__all__ = ["Drive", "VectorFieldMotion"]


@dataclass(frozen=True, slots=True)
class Drive:
    """What the robot's drive can do.

    Attributes
    ----------
    v_max_mps, w_max_radps : bounds on forward and turning speed
    wheel_base_m : distance between the wheels
    wheel_max_mps : fastest that a wheel's rim can run
    lag_s : time constant of the motors; 0 is none
    """

    v_max_mps: float
    w_max_radps: float
    wheel_base_m: float
    wheel_max_mps: float
    lag_s: float

    def limited(self, v: float, w: float) -> tuple[float, float]:
        """Return the nearest speeds that the drive can run, keeping the curvature when the wheels are the limit."""
        v = min(v, self.v_max_mps)
        w = min(max(w, -self.w_max_radps), self.w_max_radps)
        fastest = abs(v) + abs(w) * 0.5 * self.wheel_base_m
        if fastest > self.wheel_max_mps:
            v, w = v * self.wheel_max_mps / fastest, w * self.wheel_max_mps / fastest
        return v, w


@dataclass(frozen=True, eq=False, slots=True)
class VectorFieldMotion:
    """The robot; ``internal`` holds heading (not wrapped), v and w.

    Attributes
    ----------
    field : the vector field
    drive : limits of the robot
    heading_gain_per_s : k
    start : (x, y) m, or None to draw one of ``start_points``
    start_heading_rad : heading at time 0, or None for the field's
    start_points : (m, 2) points along the path, m
    """

    field: PlanarField
    drive: Drive
    heading_gain_per_s: float
    start: tuple[float, float] | None
    start_heading_rad: float | None
    start_points: Array

    @property
    def v_max_mps(self) -> float:
        """Bound on the linear speed, m/s."""
        return self.drive.v_max_mps

    @property
    def w_max_radps(self) -> float:
        """Bound on the angular speed, rad/s."""
        return self.drive.w_max_radps

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Return the state at time 0: at the given start, or drawn from the start points."""
        if self.start is None:
            x, y = self.start_points[int(rng.integers(len(self.start_points)))].tolist()
        else:
            x, y = self.start
        heading = self.start_heading_rad
        theta = self.field.guide(x, y).direction if heading is None else heading
        v, w = self.command(x, y, theta)
        return planar_state(x, y, 0.0, theta, v, w, (theta, v, w))

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Advance by the midpoint rule (second order); motors, if they lag, by their exact first-order response."""
        x, y, _ = state.p_world.tolist()
        theta, v, w = state.internal.tolist()
        if isinstance(self.field, LoopField):
            c, f = self.field.curve, self.field
            end = _step_on_loop(
                (x, y, theta, v, w),
                dt_s,
                self._limits(),
                c.knots,
                c.coefficients,
                c.samples,
                c.sample_u,
                (f.attraction_per_m, f.speed_mps, f.modulation),
            )
            return planar_state(end[0], end[1], 0.0, end[2], end[3], end[4], end[2:])
        return self._step(x, y, theta, v, w, dt_s)

    def states_ahead(self, state: TargetState, dt_s: float, count: int) -> Array:
        """Return ``count`` states ahead, as `step` makes them: rows of p, q, v, w and ``internal``, (count, 16)."""
        x, y, _ = state.p_world.tolist()
        theta, v, w = state.internal.tolist()
        if isinstance(self.field, LoopField):
            c, f = self.field.curve, self.field
            shape = (f.attraction_per_m, f.speed_mps, f.modulation)
            curve = (c.knots, c.coefficients, c.samples, c.sample_u)
            return np.asarray(_path_on_loop((x, y, theta, v, w), dt_s, self._limits(), *curve, shape, count))
        rows = np.empty((count, 16))
        for row in rows:
            x, y, _ = state.p_world.tolist()
            theta, v, w = state.internal.tolist()
            state = self._step(x, y, theta, v, w, dt_s)
            parts = (state.p_world, state.q_world, state.v_world, state.w_body, state.internal)
            row[:] = np.concatenate(parts)
        return rows

    def _step(self, x: float, y: float, theta: float, v: float, w: float, dt_s: float) -> TargetState:
        """Do it for any field, readably; `_step_on_loop` is the compiled twin for loops."""
        if self.drive.lag_s > 0.0:
            v_goal, w_goal = self.command(x, y, theta)
            gain = -math.expm1(-dt_s / self.drive.lag_s)
            v_next, w_next = v + gain * (v_goal - v), w + gain * (w_goal - w)
            v_mid, w_mid = 0.5 * (v + v_next), 0.5 * (w + w_next)
            theta_mid = theta + 0.25 * dt_s * (w + w_mid)
        else:
            half = 0.5 * dt_s
            theta_mid = theta + half * w
            x_mid, y_mid = x + half * v * math.cos(theta), y + half * v * math.sin(theta)
            v_mid, w_mid = self.command(x_mid, y_mid, theta_mid)
        x += dt_s * v_mid * math.cos(theta_mid)
        y += dt_s * v_mid * math.sin(theta_mid)
        theta += dt_s * w_mid
        if self.drive.lag_s <= 0.0:
            v_next, w_next = self.command(x, y, theta)
        return planar_state(x, y, 0.0, theta, v_next, w_next, (theta, v_next, w_next))

    def _limits(self) -> tuple[float, float, float, float, float, float]:
        d = self.drive
        return (
            d.v_max_mps,
            d.w_max_radps,
            d.wheel_base_m,
            d.wheel_max_mps,
            d.lag_s,
            self.heading_gain_per_s,
        )

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return the velocity that the robot has at a pose; None if its motors lag, for then it has a memory."""
        if self.drive.lag_s > 0.0:
            return None
        theta = float(rotations.yaw_of(q_world))
        v, w = self.command(float(p_world[0]), float(p_world[1]), theta)
        return Twist(np.array([v * math.cos(theta), v * math.sin(theta), 0.0]), np.array([0.0, 0.0, w]))

    def command(self, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return forward and turning speed, m/s and rad/s, that the robot wants at a pose."""
        psi, grad_x, grad_y, s = self.field.guide(x, y)
        s = min(s, self.drive.v_max_mps)
        feed_forward = s * (grad_x * math.cos(theta) + grad_y * math.sin(theta))
        error = math.remainder(psi - theta, 2.0 * math.pi)
        return self.drive.limited(s, self.heading_gain_per_s * error + feed_forward)


@cached_njit
def _command_on_loop(
    x: float,
    y: float,
    theta: float,
    limits: tuple[float, float, float, float, float, float],
    knots: Array,
    coefficients: Array,
    samples: Array,
    sample_u: Array,
    shape: tuple[float, float, float],
) -> tuple[float, float]:
    """`VectorFieldMotion.command` and `Drive.limited` on a loop."""
    v_max, w_max, wheel_base, wheel_max, _, gain = limits
    psi, grad_x, grad_y, s = loop_guide(x, y, knots, coefficients, samples, sample_u, shape)
    v = min(s, v_max)
    turn = psi - theta
    turn -= 2.0 * math.pi * np.round(turn / (2.0 * math.pi))
    w = gain * turn + v * (grad_x * math.cos(theta) + grad_y * math.sin(theta))
    w = min(max(w, -w_max), w_max)
    fastest = abs(v) + abs(w) * 0.5 * wheel_base
    if fastest > wheel_max:
        return v * wheel_max / fastest, w * wheel_max / fastest
    return v, w


@cached_njit
def _step_on_loop(
    now: tuple[float, float, float, float, float],
    dt: float,
    limits: tuple[float, float, float, float, float, float],
    knots: Array,
    coefficients: Array,
    samples: Array,
    sample_u: Array,
    shape: tuple[float, float, float],
) -> tuple[float, float, float, float, float]:
    """`VectorFieldMotion._step` on a loop: x, y, heading, v, w after ``dt``."""
    x, y, theta, v, w = now
    lag = limits[4]
    v_next, w_next = v, w
    if lag > 0.0:
        v_goal, w_goal = _command_on_loop(x, y, theta, limits, knots, coefficients, samples, sample_u, shape)
        gain = -math.expm1(-dt / lag)
        v_next, w_next = v + gain * (v_goal - v), w + gain * (w_goal - w)
        v_mid, w_mid = 0.5 * (v + v_next), 0.5 * (w + w_next)
        theta_mid = theta + 0.25 * dt * (w + w_mid)
    else:
        half = 0.5 * dt
        theta_mid = theta + half * w
        x_mid, y_mid = x + half * v * math.cos(theta), y + half * v * math.sin(theta)
        v_mid, w_mid = _command_on_loop(
            x_mid, y_mid, theta_mid, limits, knots, coefficients, samples, sample_u, shape
        )
    x += dt * v_mid * math.cos(theta_mid)
    y += dt * v_mid * math.sin(theta_mid)
    theta += dt * w_mid
    if lag <= 0.0:
        v_next, w_next = _command_on_loop(x, y, theta, limits, knots, coefficients, samples, sample_u, shape)
    return x, y, theta, v_next, w_next


@cached_njit
def _path_on_loop(
    now: tuple[float, float, float, float, float],
    dt: float,
    limits: tuple[float, float, float, float, float, float],
    knots: Array,
    coefficients: Array,
    samples: Array,
    sample_u: Array,
    shape: tuple[float, float, float],
    count: int,
) -> Array:
    """States after 1 ... ``count`` steps: `camnet.motion.protocol.planar_state` in rows, (count, 16)."""
    rows = np.zeros((count, 16))
    for row in rows:
        now = _step_on_loop(now, dt, limits, knots, coefficients, samples, sample_u, shape)
        x, y, theta, v, w = now
        row[0], row[1] = x, y
        row[3], row[6] = math.cos(0.5 * theta), math.sin(0.5 * theta)
        row[7], row[8], row[12] = v * math.cos(theta), v * math.sin(theta), w
        row[13], row[14], row[15] = theta, v, w
    return rows
