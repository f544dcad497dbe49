"""Compiled steps of the C1 references: position with bounded speed and acceleration in a region, and gaze.

| symbol | name | meaning |
| --- | --- | --- |
| p, v | `p`, `v` | reference position and velocity |
| a_max | `a_max` | bound of ``|v'|`` |
| s | `_stop` | ``p + v norm(v) / (2 a_max)``: where full braking along v ends |
| O(m) | `_clearance(...) >= m` | the region shrunk by the margin m |

Invariant: p and s are in O(m), and the segment between them. A step is taken only when it keeps the invariant; full
braking always does, since it moves p along that segment and leaves s where it is. For a convex region the two ends are
enough; for a polygon with reflex corners points of the segment are tested every ``_SPACING_M``, which leaves at
most ``_SPACING_M^2 / (8 m)`` beyond the margin beside a reflex corner.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.geometry.polygon import signed_distance
from camnet.types import Array

__all__ = ["clearance", "gaze_motion", "gaze_step", "position_step", "segment_inside"]

_TOLERANCE = 1e-9
_SPACING_M = 0.05


@njit(cache=True)
def clearance(p: Array, planes: Array, disc: Array, polygon: Array) -> float:
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
        depth = min(depth, -signed_distance(p.reshape(1, 3), polygon)[0])
    return depth


@njit(cache=True)
def segment_inside(a: Array, b: Array, margin: float, planes: Array, disc: Array, polygon: Array) -> bool:
    """Whether the segment a-b lies ``margin`` inside the region (polygons: sampled)."""
    if clearance(a, planes, disc, polygon) < margin - _TOLERANCE:
        return False
    if clearance(b, planes, disc, polygon) < margin - _TOLERANCE:
        return False
    if polygon.shape[0] == 0:
        return True
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    count = int(length / _SPACING_M)
    for k in range(1, count + 1):
        if clearance(a + (b - a) * (k / (count + 1)), planes, disc, polygon) < margin - _TOLERANCE:
            return False
    return True


@njit(cache=True)
def _length(x: Array) -> float:
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@njit(cache=True)
def _wanted_velocity(p: Array, goal: Array, v_max: float, a_max: float, k_p: float) -> Array:
    """Towards the goal: proportional nearby, with room to brake farther away, at most v_max."""
    away = goal - p
    distance = _length(away)
    if distance < 1e-12:
        return np.zeros(3)
    # the speed from which a constant deceleration a_max/2 reaches the proportional part without a jump
    near = 0.5 * a_max / k_p**2
    speed = k_p * distance if distance < near else math.sqrt(a_max * (distance - 0.5 * near))
    return away * (min(speed, v_max) / distance)


@njit(cache=True)
def _at_most(x: Array, size: float) -> Array:
    length = _length(x)
    return x * (size / length) if length > size else x


@njit(cache=True)
def _approach(a: Array, goal: Array, largest_change: float) -> Array:
    """Go from ``a`` towards ``goal``, at most by ``largest_change``."""
    return a + _at_most(goal - a, largest_change)


@njit(cache=True)
def _stop(p: Array, v: Array, a_max: float) -> Array:
    """Where full braking along ``v`` ends."""
    return p + v * (_length(v) / (2.0 * a_max))


@njit(cache=True)
def _gentle_stop(p: Array, v: Array, a: Array, a_max: float, j_max: float) -> Array:
    """Where braking ends about when the jerk is bounded: ``a`` fades first, then the braking sets in."""
    fade = _length(a) / j_max
    v_then = v + a * (0.5 * fade)
    p_then = p + v * fade + a * (fade * fade / 3.0)
    return _stop(p_then, v_then, a_max) + v_then * (0.5 * a_max / j_max)


@njit(cache=True)
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

    ``limits`` is v_max, a_max, k_p, k_v, j_max. The jerk stays below j_max but where the region asks for braking.
    """
    v_max, a_max, k_p, k_v, j_max = limits[0], limits[1], limits[2], limits[3], limits[4]
    wanted = (_wanted_velocity(p, goal, v_max, a_max, k_p) - v) * min(k_v, 1.0 / dt)
    wanted = _approach(a, _at_most(wanted, a_max), j_max * dt)
    ahead = _length(v + dt * wanted)
    if ahead > v_max:  # the bounded jerk must not carry the speed beyond its bound
        wanted = ((v + dt * wanted) * (v_max / ahead) - v) / dt
    speed = _length(v)
    brake = -v * (a_max / speed) if speed > 1e-12 else np.zeros(3)
    gently = _approach(a, -v * min(a_max / speed, 1.0 / dt) if speed > 1e-12 else np.zeros(3), j_max * dt)
    inside = clearance(p, planes, disc, polygon) >= margin - 2 * _TOLERANCE
    for k in range(5):
        # as wanted, if a bounded jerk can still brake afterwards; gentle braking; then ever harder
        share = 1.0 if k < 2 else 1.0 - 0.25 * (k - 1)
        a_next = share * (wanted if k == 0 else gently) + (1.0 - share) * brake
        v_next = v + dt * a_next
        p_next = p + 0.5 * dt * (v + v_next)
        stop = _stop(p_next, v_next, a_max)
        if k == 0:
            stop = _gentle_stop(p_next, v_next, a_next, a_max, j_max)
        if not inside or segment_inside(p_next, stop, margin, planes, disc, polygon):
            p[:], v[:], a[:] = p_next, v_next, a_next
            return
    if speed <= a_max * dt:  # comes to rest within the step
        p += v * (speed / (2.0 * a_max))
        v[:] = 0.0
        a[:] = 0.0
    else:
        a[:] = brake
        p += dt * v + 0.5 * dt * dt * brake
        v += dt * brake


@njit(cache=True)
def gaze_step(
    gaze: Array, rate: Array, goal: Array, w_max: float, a_max: float, k_p: float, dt: float
) -> None:
    """Move pan and tilt (2,) and their rates, in place, towards ``goal`` (2,): bounded rate and acceleration."""
    away = goal - gaze
    distance = math.hypot(away[0], away[1])
    near = 0.5 * a_max / k_p**2
    speed = k_p * distance if distance < near else math.sqrt(a_max * (distance - 0.5 * near))
    scale = min(speed, w_max) / distance if distance > 1e-12 else 0.0
    change = (away * scale - rate) * min(4.0 * k_p, 1.0 / dt)
    size = math.hypot(change[0], change[1])
    if size > a_max:
        change *= a_max / size
    gaze += dt * rate + 0.5 * dt * dt * change
    rate += dt * change


@njit(cache=True)
def gaze_motion(gaze: Array, rate: Array, yaw: float) -> Array:
    """Orientation and angular velocity (7,) of a camera at moving pan and tilt, towards world x and y.

    The optical axis d is that of ``nadir_gaze(pan, tilt)``; at zero the image is turned by ``yaw``, which is constant:
    ``q = q_swing(d) q_yaw q_down``. With n = [1 - d_z, d_y, -d_x, 0], q_swing = n/|n|:
    q' = (n' - q (q.n')) / |n|, w = 2 vec(q* q'), seen after the yaw and the straight-down turn (x, -y, -z).
    """
    tx, ty = math.tan(gaze[0]), math.tan(gaze[1])
    dtx, dty = (1.0 + tx * tx) * rate[0], (1.0 + ty * ty) * rate[1]
    size = math.sqrt(tx * tx + ty * ty + 1.0)
    shrink = (tx * dtx + ty * dty) / size**3
    dx, dy, dz = tx / size, ty / size, -1.0 / size
    ddx, ddy, ddz = dtx / size - tx * shrink, dty / size - ty * shrink, shrink
    norm = math.sqrt((1.0 - dz) ** 2 + dy * dy + dx * dx)
    a, b, c = (1.0 - dz) / norm, dy / norm, -dx / norm
    along = (-a * ddz + b * ddy - c * ddx) / norm
    da, db, dc = -ddz / norm - a * along, ddy / norm - b * along, -ddx / norm - c * along
    out = np.empty(7)
    # q_yaw q_down = (0, cy, sy, 0)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    out[0], out[1] = -b * cy - c * sy, a * cy
    out[2], out[3] = a * sy, b * sy - c * cy
    # conj(a, b, c, 0) (da, db, dc, 0)
    wx, wy, wz = 2.0 * (a * db - b * da), 2.0 * (a * dc - c * da), 2.0 * (c * db - b * dc)
    cy, sy = math.cos(yaw), math.sin(yaw)
    out[4], out[5], out[6] = cy * wx + sy * wy, -(cy * wy - sy * wx), -wz
    return out
