"""References and sliding-mode command of one agent for one control period, in registers.

The equations are those of `camnet.control.reference_kernel` (C1 references that stay in the region) and of
`camnet.control.sliding_mode`, (4-3) and (4-6); the array versions there are the oracles. Regions are convex here:
half-spaces and at most one upright disc.

| array | row of one agent |
| --- | --- |
| ``motion`` | p, v, a of the reference (3 each), gaze and its rate (2 each): pan and tilt |
| ``planes`` (F, 4) | half-spaces (a, b), those of agent n are the rows from ``ends[n]`` to ``ends[n + 1]`` |
| ``discs`` (N, 3) | x, y, radius of a disc, radius 0: none |
| ``limits`` (5,) | v_max, a_max, k_p, k_v, j_max |
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inlined, outer
from camnet.geometry.triples import Quaternion, Triple, log, multiply, rotate_inverse, size
from camnet.types import Array, IntArray

__all__ = ["command_of", "gaze_motion", "gaze_step", "position_step"]

TOLERANCE = 1e-9


@outer
def clearance(p: Triple, n: int, planes: Array, ends: IntArray, discs: Array) -> float:
    """Depth of ``p`` inside region ``n``; negative outside."""
    depth = math.inf
    for i in range(ends[n], ends[n + 1]):
        away = planes[i, 3] - planes[i, 0] * p[0] - planes[i, 1] * p[1] - planes[i, 2] * p[2]
        depth = min(depth, away)
    if discs[n, 2] > 0.0:
        dx, dy = p[0] - discs[n, 0], p[1] - discs[n, 1]
        depth = min(depth, discs[n, 2] - math.sqrt(dx * dx + dy * dy))
    return depth


@inlined
def _plus(x: Triple, factor: float, y: Triple) -> Triple:
    return x[0] + factor * y[0], x[1] + factor * y[1], x[2] + factor * y[2]


@inlined
def _times(factor: float, x: Triple) -> Triple:
    return factor * x[0], factor * x[1], factor * x[2]


@inlined
def _at_most(x: Triple, largest: float) -> Triple:
    length = size(x[0], x[1], x[2])
    return _times(largest / length, x) if length > largest else x


@inlined
def _approach(a: Triple, goal: Triple, largest_change: float) -> Triple:
    return _plus(a, 1.0, _at_most(_plus(goal, -1.0, a), largest_change))


@inlined
def _wanted_velocity(p: Triple, goal: Triple, v_max: float, a_max: float, k_p: float) -> Triple:
    """Towards the goal: proportional nearby, with room to brake farther away, at most v_max."""
    away = _plus(goal, -1.0, p)
    distance = size(away[0], away[1], away[2])
    if distance < 1e-12:
        return 0.0, 0.0, 0.0
    near = 0.5 * a_max / k_p**2
    speed = k_p * distance if distance < near else math.sqrt(a_max * (distance - 0.5 * near))
    return _times(min(speed, v_max) / distance, away)


@inlined
def stop(p: Triple, v: Triple, a_max: float) -> Triple:
    """Where full braking along ``v`` ends."""
    return _plus(p, size(v[0], v[1], v[2]) * (0.5 / a_max), v)


@inlined
def gentle_stop(p: Triple, v: Triple, a: Triple, a_max: float, j_max: float) -> Triple:
    """Where braking ends about when the jerk is bounded."""
    fade = size(a[0], a[1], a[2]) * (1.0 / j_max)
    v_then = _plus(v, 0.5 * fade, a)
    p_then = _plus(_plus(p, fade, v), fade * fade * (1.0 / 3.0), a)
    return _plus(stop(p_then, v_then, a_max), 0.5 * a_max / j_max, v_then)


@inlined
def _within_speed(v: Triple, a: Triple, v_max: float, dt: float) -> Triple:
    """Cut an acceleration that would carry the speed beyond its bound."""
    ahead = _plus(v, dt, a)
    if size(ahead[0], ahead[1], ahead[2]) <= v_max:
        return a
    return _times(1.0 / dt, _plus(_at_most(ahead, v_max), -1.0, v))


@inlined
def wanted(
    p: Triple, v: Triple, a: Triple, goal: Triple, limits: Array | tuple[float, ...], dt: float
) -> Triple:
    """Acceleration towards the goal within the bounds of acceleration, jerk and speed."""
    lacking = _plus(_wanted_velocity(p, goal, limits[0], limits[1], limits[2]), -1.0, v)
    push = _at_most(_times(min(limits[3], 1.0 / dt), lacking), limits[1])
    return _within_speed(v, _approach(a, push, limits[4] * dt), limits[0], dt)


@inlined
def moved(p: Triple, v: Triple, a: Triple, dt: float) -> tuple[Triple, Triple]:
    """Position and velocity after ``dt`` at the acceleration ``a``."""
    v_next = _plus(v, dt, a)
    return _plus(_plus(p, 0.5 * dt, v), 0.5 * dt, v_next), v_next


@outer
def position_step(
    p: Triple,
    v: Triple,
    a: Triple,
    goal: Triple,
    n: int,
    margin: float,
    planes: Array,
    ends: IntArray,
    discs: Array,
    limits: Array,
    dt: float,
) -> tuple[Triple, Triple, Triple]:
    """Position, velocity, acceleration of a reference after one period towards ``goal``."""
    a_max, j_max = limits[1], limits[4]
    least = margin - TOLERANCE
    push = wanted(p, v, a, goal, limits, dt)
    p_next, v_next = moved(p, v, push, dt)
    inside = clearance(p, n, planes, ends, discs) >= margin - 2 * TOLERANCE
    if not inside:
        return p_next, v_next, push
    if (
        clearance(p_next, n, planes, ends, discs) >= least
        and clearance(stop(p_next, v_next, a_max), n, planes, ends, discs) >= least
        and clearance(gentle_stop(p_next, v_next, push, a_max, j_max), n, planes, ends, discs) >= least
    ):
        return p_next, v_next, push
    speed = size(v[0], v[1], v[2])
    brake = _times(-a_max / speed if speed > 1e-12 else 0.0, v)
    gently = _approach(a, _times(-min(a_max / max(speed, 1e-12), 1.0 / dt), v), j_max * dt)
    gently = _within_speed(v, gently, limits[0], dt)
    for k in range(1, 5):  # gentle braking; then ever harder
        share = 1.0 - 0.25 * (k - 1)
        a_next = _plus(_times(share, gently), 1.0 - share, brake)
        p_next, v_next = moved(p, v, a_next, dt)
        if (
            clearance(p_next, n, planes, ends, discs) >= least
            and clearance(stop(p_next, v_next, a_max), n, planes, ends, discs) >= least
        ):
            return p_next, v_next, a_next
    if speed <= a_max * dt:  # comes to rest within the step
        return stop(p, v, a_max), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return _plus(_plus(p, dt, v), 0.5 * dt * dt, brake), _plus(v, dt, brake), brake


@inlined
def gaze_step(
    gaze: tuple[float, float],
    rate: tuple[float, float],
    goal: tuple[float, float],
    w_max: float,
    a_max: float,
    k_p: float,
    dt: float,
) -> tuple[float, float, float, float]:
    """Pan, tilt and their rates after one period towards ``goal``."""
    x, y = goal[0] - gaze[0], goal[1] - gaze[1]
    distance = math.sqrt(x * x + y * y)
    near = 0.5 * a_max / k_p**2
    speed = k_p * distance if distance < near else math.sqrt(a_max * (distance - 0.5 * near))
    scale = min(speed, w_max) / distance if distance > 1e-12 else 0.0
    gain = min(4.0 * k_p, 1.0 / dt)
    x, y = gain * (x * scale - rate[0]), gain * (y * scale - rate[1])
    length = math.sqrt(x * x + y * y)
    if length > a_max:
        x, y = x * (a_max / length), y * (a_max / length)
    half = 0.5 * dt * dt
    return (
        gaze[0] + dt * rate[0] + half * x,
        gaze[1] + dt * rate[1] + half * y,
        rate[0] + dt * x,
        rate[1] + dt * y,
    )


@inlined
def pointing(
    tx: float,
    ty: float,
    pan_rate: float,
    tilt_rate: float,
    yaw: tuple[float, float],
    half_yaw: tuple[float, float],
) -> tuple[Quaternion, Triple]:
    """Orientation and angular velocity as `gaze_motion`, from the tangents of pan and tilt."""
    dtx, dty = (1.0 + tx * tx) * pan_rate, (1.0 + ty * ty) * tilt_rate
    inverse = 1.0 / math.sqrt(tx * tx + ty * ty + 1.0)
    shrink = (tx * dtx + ty * dty) * inverse * inverse * inverse
    dx, dy, dz = tx * inverse, ty * inverse, -inverse
    ddx, ddy, ddz = dtx * inverse - tx * shrink, dty * inverse - ty * shrink, shrink
    scale = 1.0 / math.sqrt((1.0 - dz) * (1.0 - dz) + dy * dy + dx * dx)
    a, b, c = (1.0 - dz) * scale, dy * scale, -dx * scale
    along = (-a * ddz + b * ddy - c * ddx) * scale
    da, db, dc = -ddz * scale - a * along, ddy * scale - b * along, -ddx * scale - c * along
    cy, sy = half_yaw
    q = (-b * cy - c * sy, a * cy, a * sy, b * sy - c * cy)
    wx, wy, wz = 2.0 * (a * db - b * da), 2.0 * (a * dc - c * da), 2.0 * (c * db - b * dc)
    return q, (yaw[0] * wx + yaw[1] * wy, -(yaw[0] * wy - yaw[1] * wx), -wz)


@outer
def gaze_motion(
    pan: float,
    tilt: float,
    pan_rate: float,
    tilt_rate: float,
    yaw: tuple[float, float],
    half_yaw: tuple[float, float],
) -> tuple[Quaternion, Triple]:
    """Orientation of a camera at moving pan and tilt, and its angular velocity; see the oracle.

    ``yaw`` and ``half_yaw`` are (cosine, sine) of the image's turn at zero gaze and of its half.
    """
    return pointing(math.tan(pan), math.tan(tilt), pan_rate, tilt_rate, yaw, half_yaw)


@outer
def _switch(e: float, code: int, layer: float) -> float:
    if code == 0:
        return 1.0 if e > 0.0 else (-1.0 if e < 0.0 else 0.0)
    if code == 1:
        return min(max(e / layer, -1.0), 1.0)
    return math.tanh(e / layer)


@outer
def command_of(
    p: Triple,
    q: Quaternion,
    p_d: Triple,
    q_d: Quaternion,
    v_d: Triple,
    w_d: Triple,
    gains: Array,
    code: int,
) -> tuple[Triple, Triple, Triple]:
    """u_l, u_a and the position error e_l; ``gains`` is k1, d_bar (linear), d_bar (angular), boundary layer."""
    k1, d_l, d_a, layer = gains[0], gains[1], gains[2], gains[3]
    off = multiply((q_d[0], -q_d[1], -q_d[2], -q_d[3]), q)
    e_a = log(off)
    ahead = rotate_inverse(off, w_d)
    e_l = (p[0] - p_d[0], p[1] - p_d[1], p[2] - p_d[2])  # (4-3)
    u_l = (
        v_d[0] - k1 * e_l[0] - d_l * _switch(e_l[0], code, layer),  # (4-6)
        v_d[1] - k1 * e_l[1] - d_l * _switch(e_l[1], code, layer),
        v_d[2] - k1 * e_l[2] - d_l * _switch(e_l[2], code, layer),
    )
    u_a = (
        ahead[0] - k1 * e_a[0] - d_a * _switch(e_a[0], code, layer),  # (4-6)
        ahead[1] - k1 * e_a[1] - d_a * _switch(e_a[1], code, layer),
        ahead[2] - k1 * e_a[2] - d_a * _switch(e_a[2], code, layer),
    )
    return u_l, u_a, e_l
