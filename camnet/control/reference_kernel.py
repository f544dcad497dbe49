"""Compiled steps of the C1 references: position with bounded speed and acceleration in a region, and gaze.

| symbol | name | meaning |
| --- | --- | --- |
| p, v | `p`, `v` | reference position and velocity |
| a_max | `a_max` | bound of ``|v'|`` |
| s | `_stop` | ``p + v norm(v) / (2 a_max)``: where full braking along v ends |
| O(m) | `clearance(...) >= m` | the region shrunk by the margin m |

Invariant: p and s are in O(m), and the segment between them. A step is taken only when it keeps the invariant; full
braking always does, since it moves p along that segment and leaves s where it is. For a convex region the two ends are
enough; for a polygon the distance between segment and border is computed, exactly. Between two steps p runs on a
parabola at most ``a_max dt^2 / 8`` from its chord.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from camnet.geometry.polygon import point_distance
from camnet.geometry.triples import Quaternion, Triple, borrowing
from camnet.types import Array, IntArray

__all__ = [
    "clearance",
    "gaze_motion",
    "gaze_step",
    "move_all",
    "position_step",
    "same",
    "segment_inside",
    "step_all",
    "turn_all",
]

_TOLERANCE = 1e-9

#: three numbers, however they are kept
Vector = Array | Triple
Pair = tuple[float, float]


@borrowing
def clearance(p: Vector, planes: Array, disc: Array, polygon: Array) -> float:
    """Depth of ``p`` (3,) inside the intersection of half-spaces (F,4: a, b), a disc (3,: x, y, r) and a polygon.

    Negative outside; an empty polygon and a disc of radius 0 bound nothing.
    """
    depth = math.inf
    for i in range(planes.shape[0]):
        away = planes[i, 3] - planes[i, 0] * p[0] - planes[i, 1] * p[1] - planes[i, 2] * p[2]
        depth = min(depth, away)
    if disc[2] > 0.0:
        depth = min(depth, disc[2] - math.hypot(p[0] - disc[0], p[1] - disc[1]))
    if polygon.shape[0] > 0:
        depth = min(depth, -point_distance(p[0], p[1], polygon))
    return depth


@borrowing
def _crosses(a: Vector, b: Vector, c: Array, d: Array) -> bool:
    """Whether the plane segments a-b and c-d cross at an inner point."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    side_c = ux * (c[1] - a[1]) - uy * (c[0] - a[0])
    side_d = ux * (d[1] - a[1]) - uy * (d[0] - a[0])
    side_a = vx * (a[1] - c[1]) - vy * (a[0] - c[0])
    side_b = vx * (b[1] - c[1]) - vy * (b[0] - c[0])
    return bool(side_c * side_d < 0.0 and side_a * side_b < 0.0)


@borrowing
def segment_inside(a: Vector, b: Vector, margin: float, planes: Array, disc: Array, polygon: Array) -> bool:
    """Whether the segment a-b (ends (3,)) lies ``margin`` inside the region."""
    if clearance(a, planes, disc, polygon) < margin - _TOLERANCE:
        return False
    if clearance(b, planes, disc, polygon) < margin - _TOLERANCE:
        return False
    ux, uy = b[0] - a[0], b[1] - a[1]
    length2 = ux * ux + uy * uy
    if polygon.shape[0] == 0 or length2 == 0.0:
        return True
    # both ends are far enough from every edge: what is left are corners beside the segment, and edges across it
    for k in range(polygon.shape[0]):
        wx, wy = polygon[k, 0] - a[0], polygon[k, 1] - a[1]
        t = min(max((wx * ux + wy * uy) / length2, 0.0), 1.0)
        if math.hypot(wx - t * ux, wy - t * uy) < margin - _TOLERANCE:
            return False
        if _crosses(a, b, polygon[k], polygon[(k + 1) % polygon.shape[0]]):
            return False
    return True


@borrowing
def _length(x: Vector) -> float:
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@borrowing
def _plus(x: Vector, factor: float, y: Vector) -> Triple:
    """Return ``x + factor y``; three numbers, since a small array costs more than all the arithmetic on it."""
    return x[0] + factor * y[0], x[1] + factor * y[1], x[2] + factor * y[2]


@borrowing
def _times(factor: float, x: Vector) -> Triple:
    return factor * x[0], factor * x[1], factor * x[2]


@borrowing
def _set(x: Array, value: Vector) -> None:
    x[0], x[1], x[2] = value[0], value[1], value[2]


@borrowing
def _wanted_velocity(p: Vector, goal: Vector, v_max: float, a_max: float, k_p: float) -> Triple:
    """Towards the goal: proportional nearby, with room to brake farther away, at most v_max."""
    away = _plus(goal, -1.0, p)
    distance = _length(away)
    if distance < 1e-12:
        return (0.0, 0.0, 0.0)
    # the speed from which a constant deceleration a_max/2 reaches the proportional part without a jump
    near = 0.5 * a_max / k_p**2
    speed = k_p * distance if distance < near else math.sqrt(a_max * (distance - 0.5 * near))
    return _times(min(speed, v_max) / distance, away)


@borrowing
def _at_most(x: Vector, size: float) -> Triple:
    length = _length(x)
    return _times(size / length if length > size else 1.0, x)


@borrowing
def _approach(a: Vector, goal: Vector, largest_change: float) -> Triple:
    """Go from ``a`` towards ``goal``, at most by ``largest_change``."""
    return _plus(a, 1.0, _at_most(_plus(goal, -1.0, a), largest_change))


@borrowing
def _stop(p: Vector, v: Vector, a_max: float) -> Triple:
    """Where full braking along ``v`` ends."""
    return _plus(p, _length(v) / (2.0 * a_max), v)


@borrowing
def _gentle_stop(p: Vector, v: Vector, a: Vector, a_max: float, j_max: float) -> Triple:
    """Where braking ends about when the jerk is bounded: ``a`` fades first, then the braking sets in."""
    fade = _length(a) / j_max
    v_then = _plus(v, 0.5 * fade, a)
    p_then = _plus(_plus(p, fade, v), fade * fade / 3.0, a)
    return _plus(_stop(p_then, v_then, a_max), 0.5 * a_max / j_max, v_then)


@borrowing
def _within_speed(v: Vector, a: Vector, v_max: float, dt: float) -> Triple:
    """Cut an acceleration that would carry the speed beyond its bound, as one of bounded jerk can."""
    ahead = _plus(v, dt, a)
    if _length(ahead) <= v_max:
        return a[0], a[1], a[2]
    return _times(1.0 / dt, _plus(_at_most(ahead, v_max), -1.0, v))


@borrowing
def _wanted_acceleration(p: Vector, v: Vector, a: Vector, goal: Vector, limits: Array, dt: float) -> Triple:
    """Towards the wanted velocity, within the bounds of acceleration, jerk and speed."""
    v_max, a_max, k_p, k_v, j_max = limits[0], limits[1], limits[2], limits[3], limits[4]
    lacking = _plus(_wanted_velocity(p, goal, v_max, a_max, k_p), -1.0, v)
    wanted = _approach(a, _at_most(_times(min(k_v, 1.0 / dt), lacking), a_max), j_max * dt)
    return _within_speed(v, wanted, v_max, dt)


@borrowing
def position_step(
    p: Array,
    v: Array,
    goal: Array,
    margin: float,
    planes: Array,
    disc: Array,
    polygon: Array,
    limits: Array,
    dt: float,
    a: Array,
) -> None:
    """Move ``p``, ``v``, ``a`` (3,), in place, one step towards ``goal`` (3,).

    ``limits`` is v_max, a_max, k_p, k_v, j_max. The jerk stays below j_max, except where the region or the
    speed bound asks for more.
    """
    a_max, j_max = limits[1], limits[4]
    wanted = _wanted_acceleration(p, v, a, goal, limits, dt)
    speed = _length(v)
    brake = _times(-a_max / speed if speed > 1e-12 else 0.0, v)
    gently = _approach(a, _times(-min(a_max / max(speed, 1e-12), 1.0 / dt), v), j_max * dt)
    gently = _within_speed(v, gently, limits[0], dt)
    inside = clearance(p, planes, disc, polygon) >= margin - 2 * _TOLERANCE
    for k in range(5):
        # as wanted, if a bounded jerk can still brake afterwards; gentle braking; then ever harder
        share = 1.0 if k < 2 else 1.0 - 0.25 * (k - 1)
        a_next = _plus(_times(share, wanted if k == 0 else gently), 1.0 - share, brake)
        v_next = _plus(v, dt, a_next)
        p_next = _plus(_plus(p, 0.5 * dt, v), 0.5 * dt, v_next)
        kept = segment_inside(p_next, _stop(p_next, v_next, a_max), margin, planes, disc, polygon)
        if kept and k == 0:
            gentle = _gentle_stop(p_next, v_next, a_next, a_max, j_max)
            kept = segment_inside(p_next, gentle, margin, planes, disc, polygon)
        if kept or not inside:
            _set(p, p_next)
            _set(v, v_next)
            _set(a, a_next)
            return
    if speed <= a_max * dt:  # comes to rest within the step
        _set(p, _stop(p, v, a_max))
        _set(v, (0.0, 0.0, 0.0))
        _set(a, (0.0, 0.0, 0.0))
    else:
        _set(a, brake)
        _set(p, _plus(_plus(p, dt, v), 0.5 * dt * dt, brake))
        _set(v, _plus(v, dt, brake))


@borrowing
def _gaze_step(row: Array, look: Pair, w_max: float, a_max: float, k_p: float, dt: float) -> None:
    """Move pan and tilt and their rates, columns 9-12, towards ``look``: bounded rate and acceleration."""
    x, y = look[0] - row[9], look[1] - row[10]
    distance = math.hypot(x, y)
    near = 0.5 * a_max / k_p**2
    speed = k_p * distance if distance < near else math.sqrt(a_max * (distance - 0.5 * near))
    scale = min(speed, w_max) / distance if distance > 1e-12 else 0.0
    gain = min(4.0 * k_p, 1.0 / dt)
    x, y = gain * (x * scale - row[11]), gain * (y * scale - row[12])
    size = math.hypot(x, y)
    if size > a_max:
        x, y = x * (a_max / size), y * (a_max / size)
    row[9] += dt * row[11] + 0.5 * dt * dt * x
    row[10] += dt * row[12] + 0.5 * dt * dt * y
    row[11] += dt * x
    row[12] += dt * y


def gaze_step(
    gaze: Array, rate: Array, goal: Array, w_max: float, a_max: float, k_p: float, dt: float
) -> None:
    """Move pan and tilt (2,) and their rates, in place, towards ``goal`` (2,): bounded rate and acceleration."""
    row = np.zeros(20)
    row[9:11], row[11:13] = gaze, rate
    _gaze_step(row, (float(goal[0]), float(goal[1])), w_max, a_max, k_p, dt)
    gaze[:], rate[:] = row[9:11], row[11:13]


@borrowing
def _gaze_motion(pan: float, tilt: float, rate: Pair, yaw: float) -> tuple[Quaternion, Triple]:
    """Orientation and angular velocity of a camera at moving pan and tilt, towards world x and y.

    The optical axis d is that of ``nadir_gaze(pan, tilt)``; at zero the image is turned by ``yaw``, which is constant:
    ``q = q_swing(d) q_yaw q_down``. With n = [1 - d_z, d_y, -d_x, 0], q_swing = n/|n|:
    q' = (n' - q (q.n')) / |n|, w = 2 vec(q* q'), seen after the yaw and the straight-down turn (x, -y, -z).
    """
    tx, ty = math.tan(pan), math.tan(tilt)
    dtx, dty = (1.0 + tx * tx) * rate[0], (1.0 + ty * ty) * rate[1]
    size = math.sqrt(tx * tx + ty * ty + 1.0)
    shrink = (tx * dtx + ty * dty) / size**3
    dx, dy, dz = tx / size, ty / size, -1.0 / size
    ddx, ddy, ddz = dtx / size - tx * shrink, dty / size - ty * shrink, shrink
    norm = math.sqrt((1.0 - dz) ** 2 + dy * dy + dx * dx)
    a, b, c = (1.0 - dz) / norm, dy / norm, -dx / norm
    along = (-a * ddz + b * ddy - c * ddx) / norm
    da, db, dc = -ddz / norm - a * along, ddy / norm - b * along, -ddx / norm - c * along
    # q_yaw q_down = (0, cy, sy, 0)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    q = (-b * cy - c * sy, a * cy, a * sy, b * sy - c * cy)
    # conj(a, b, c, 0) (da, db, dc, 0)
    wx, wy, wz = 2.0 * (a * db - b * da), 2.0 * (a * dc - c * da), 2.0 * (c * db - b * dc)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return q, (cy * wx + sy * wy, -(cy * wy - sy * wx), -wz)


def gaze_motion(gaze: Array, rate: Array, yaw: float) -> Array:
    """Orientation and angular velocity (7,) at ``gaze`` (2,), rad, that moves at ``rate`` (2,), rad/s."""
    q, w = _gaze_motion(float(gaze[0]), float(gaze[1]), (float(rate[0]), float(rate[1])), float(yaw))
    return np.array([*q, *w])


@borrowing
def move_all(
    rows: Array,
    goals: Array,
    looks: Array,
    planes: Array,
    plane_ends: IntArray,
    discs: Array,
    polygons: Array,
    polygon_ends: IntArray,
    margin: float,
    limits: Array,
    gaze_limits: Array,
    dt: float,
    yaw: Array,
) -> None:
    """Step all references in place: rows (N,20) are p, v, a (3 each), gaze, gaze rate (2 each), then q (4), w (3).

    ``goals`` (N,3), ``looks`` (N,2); the half-spaces and polygon corners of agent n are the rows between
    ``plane_ends[n]`` and ``plane_ends[n + 1]``, and so on. ``gaze_limits`` is rate, acceleration, gain, largest angle.
    """
    most = gaze_limits[3]
    for n in range(rows.shape[0]):
        row = rows[n]
        own_planes = planes[plane_ends[n] : plane_ends[n + 1]]
        own_polygon = polygons[polygon_ends[n] : polygon_ends[n + 1]]
        p, v, a = row[0:3], row[3:6], row[6:9]
        position_step(p, v, goals[n], margin, own_planes, discs[n], own_polygon, limits, dt, a)
        look = (min(max(looks[n, 0], -most), most), min(max(looks[n, 1], -most), most))
        _gaze_step(row, look, gaze_limits[0], gaze_limits[1], gaze_limits[2], dt)
    turn_all(rows, yaw)


def step_all(motion: Array, *asked: Any) -> Array:  # noqa: ANN401 - arguments of `move_all`
    """Return the references (N,20) one step after ``motion``; what is asked as in `move_all`."""
    out = motion.copy()
    move_all(out, *asked)
    return out


@borrowing
def turn_all(motion: Array, yaw: Array) -> None:
    """Fill in orientation and angular velocity of all rows (N,20) by `gaze_motion`."""
    for n in range(motion.shape[0]):
        rate = (motion[n, 11], motion[n, 12])
        q, w = _gaze_motion(motion[n, 9], motion[n, 10], rate, yaw[n])
        for i in range(4):
            motion[n, 13 + i] = q[i]
        for i in range(3):
            motion[n, 17 + i] = w[i]


@borrowing
def same(a: Array, b: Array) -> bool:
    """Whether two arrays (N,3) hold the same numbers."""
    for n in range(a.shape[0]):
        for i in range(3):
            if a[n, i] != b[n, i]:
                return False
    return True
