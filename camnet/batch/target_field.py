"""Targets that steer along a field: `camnet.motion.vector_field` and `camnet.motion.fields`, one step of one target.

| column of ``inner`` | meaning |
| --- | --- |
| 0, 1, 2 | heading (not wrapped), forward and turning speed |
| 3, 4, 5 | loops: parameter u of the nearest place at the last look, how far it had moved since the one before, piece |
| 6 | speed over the field's own: 1 but for planned targets |

Newton's search for the nearest place of a loop begins where the place will be if it moves as it did. What it ends at
is the nearest of all when it lies within the loop's safe distance (`camnet.batch.target_laws`); otherwise the search
begins at the nearest sample.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.batch.compiled import inlined, inner
from camnet.batch.target_laws import CELL_M, LOOP, PLANNED_FIELD, SAFE, Targets
from camnet.batch.triples import circle, direction
from camnet.motion.fields import LEAST_STRETCH, SPEED_WAVES, wave_guide
from camnet.types import Array

__all__ = ["PACE", "set_planar", "step_field", "wrapped"]

_TWO_PI = 2.0 * math.pi
#: column of ``inner``
PACE = 6
#: at most so many steps to the nearest place of a loop; when one is this short, m, the next would be its square
_NEWTON_STEPS, CLOSE_M = 4, 1e-5
#: x, y of a loop and their first and second derivatives by u
Place = tuple[float, float, float, float, float, float]
_Cubic = tuple[float, float, float, float]
#: see ``driven``
Limits = tuple[float, float, float, float, float]


@inlined
def wrapped(angle: float) -> float:
    """Angle in [-pi, pi]."""
    return angle - _TWO_PI * np.rint(angle / _TWO_PI)


@inner
def set_planar(
    now: Array, e: int, m: int, x: float, y: float, z: float, heading: float, v: float, w: float
) -> None:
    """Write the state of a target that drives forward at ``v`` and turns at ``w``."""
    c, s = circle(0.5 * heading)
    put_planar(now, e, m, x, y, z, c, s, v, w)


@inlined
def put_planar(
    now: Array, e: int, m: int, x: float, y: float, z: float, c: float, s: float, v: float, w: float
) -> None:
    """Write what `set_planar` does, from the cosine and the sine of half the heading."""
    now[e, m, 0], now[e, m, 1], now[e, m, 2] = x, y, z
    now[e, m, 3], now[e, m, 4], now[e, m, 5], now[e, m, 6] = c, 0.0, 0.0, s
    now[e, m, 7], now[e, m, 8], now[e, m, 9] = v * (c * c - s * s), v * (2.0 * s * c), 0.0
    now[e, m, 10], now[e, m, 11], now[e, m, 12] = 0.0, 0.0, w


@inner
def _nearest_sample(t: Targets, m: int, x: float, y: float) -> int:
    """Return the number of the loop's sample nearest to (x, y)."""
    begin, n = t.sample_first[m], t.sample_first[m + 1] - t.sample_first[m]
    first, count = 0, n
    column = math.floor((x - t.grid[m, 0]) / CELL_M)
    row = math.floor((y - t.grid[m, 1]) / CELL_M)
    if 0 <= column < t.grid[m, 2] and 0 <= row < t.grid[m, 3]:
        cell = t.grid_first[m] + row * int(t.grid[m, 2]) + column
        first, count = t.cells[cell, 0], t.cells[cell, 1]
    best, least = first, math.inf
    for k in range(first, first + count):
        i = begin + (k if k < n else k - n)
        dx, dy = t.samples[i, 0] - x, t.samples[i, 1] - y
        square = dx * dx + dy * dy
        if square < least:
            best, least = i, square
    return best


@inlined
def _on_curve(t: Targets, first: int, piece: int, u: float) -> Place:
    """x, y of a loop and their first and second derivatives by u, in one of its pieces."""
    k = first + piece
    c = t.pieces
    x, y = (c[k, 0, 0], c[k, 0, 1], c[k, 0, 2], c[k, 0, 3]), (c[k, 1, 0], c[k, 1, 1], c[k, 1, 2], c[k, 1, 3])
    return on_cubic(x, y, u - t.knots[k])


@inlined
def on_cubic(x: _Cubic, y: _Cubic, h: float) -> Place:
    """Points of two cubics, and their derivatives."""
    ax, bx, cx, dx = x
    ay, by, cy, dy = y
    return (
        ax + h * (bx + h * (cx + h * dx)),
        ay + h * (by + h * (cy + h * dy)),
        bx + h * (2.0 * cx + 3.0 * h * dx),
        by + h * (2.0 * cy + 3.0 * h * dy),
        2.0 * cx + 6.0 * h * dx,
        2.0 * cy + 6.0 * h * dy,
    )


@inner
def _nearest(
    t: Targets, m: int, piece: int, u: float, x: float, y: float
) -> tuple[bool, int, float, float, Place]:
    """Newton's search from ``u``: whether it has ended, piece and parameter, how far it went, and the place there."""
    first, pieces = t.knot_first[m], t.knot_first[m + 1] - t.knot_first[m] - 1
    period, gone, ended = t.knots[first + pieces], 0.0, False
    for k in range(_NEWTON_STEPS + 1):
        if u < 0.0 or u >= period:
            u -= period * math.floor(u / period)
        while u < t.knots[first + piece] or u >= t.knots[first + piece + 1]:
            ahead = u >= t.knots[first + piece + 1] if u - t.knots[first + piece] < 0.5 * period else False
            piece = (piece + (1 if ahead else pieces - 1)) % pieces
        px, py, dx, dy, ddx, ddy = _on_curve(t, first, piece, u)
        if ended or k == _NEWTON_STEPS:
            break
        slope = dx * dx + dy * dy + (px - x) * ddx + (py - y) * ddy
        if slope <= 0.0:  # beyond the centre of curvature: the sample is as near as it gets
            break
        step = ((px - x) * dx + (py - y) * dy) / slope
        u, gone, ended = u - step, gone - step, abs(step) < CLOSE_M
    return ended, piece, u, gone, (px, py, dx, dy, ddx, ddy)


@inner
def _place_by(t: Targets, m: int, inner: Array, e: int, x: float, y: float) -> tuple[float, Place]:
    """Parameter of the nearest place of a loop, and the place."""
    moved = inner[e, m, 4]
    ended, piece, u, gone, place = _nearest(t, m, int(inner[e, m, 5]), inner[e, m, 3] + moved, x, y)
    inner[e, m, 4] = moved + gone
    square = (place[0] - x) * (place[0] - x) + (place[1] - y) * (place[1] - y)
    if not (ended and square < t.shape[m, SAFE]):
        sample = _nearest_sample(t, m, x, y)
        pieces, samples = t.knot_first[m + 1] - t.knot_first[m] - 1, t.sample_first[m + 1] - t.sample_first[m]
        piece = (sample - t.sample_first[m]) * pieces // samples
        _, piece, u, _, place = _nearest(t, m, piece, t.sample_u[sample], x, y)
        inner[e, m, 4] = 0.0
    inner[e, m, 3], inner[e, m, 5] = u, piece
    return u, place


@inner
def _loop(
    t: Targets, m: int, inner: Array, e: int, x: float, y: float, c: float, s: float
) -> tuple[float, float, float, float]:
    """Return what a loop wants at a point: `LoopField`, the direction from the heading (cosine, sine) ``c, s`` on."""
    u, place = _place_by(t, m, inner, e, x, y)
    period = t.knots[t.knot_first[m + 1] - 1]
    aside, ahead, gx, gy = led_along(place, x, y, c, s, t.shape[m, 0])
    return direction(aside, ahead), gx, gy, t.shape[m, 1] * speed_wave(t.shape[m, 2], u / period)


@inlined
def speed_wave(height: float, turns: float) -> float:
    """Speed on a loop over its mean, so many turns around it."""
    return 1.0 + height * circle(_TWO_PI * SPEED_WAVES * turns)[1]


@inlined
def led_along(
    place: Place, x: float, y: float, c: float, s: float, g: float
) -> tuple[float, float, float, float]:
    """Vector (aside, ahead) to the direction that a loop wants at a point, and that direction's gradient."""
    px, py, dx, dy, ddx, ddy = place
    per_speed = 1.0 / math.sqrt(dx * dx + dy * dy)
    tx, ty, kappa = (
        dx * per_speed,
        dy * per_speed,
        (dx * ddy - dy * ddx) * (per_speed * per_speed * per_speed),
    )
    d = tx * (y - py) - ty * (x - px)
    along, across = kappa / max(1.0 - kappa * d, LEAST_STRETCH), -g / (1.0 + (g * d) * (g * d))
    wx, wy = tx + g * d * ty, ty - g * d * tx  # the tangent's direction less atan(g d)
    return wy * c - wx * s, wx * c + wy * s, along * tx - across * ty, along * ty + across * tx


@inner
def _guide(
    t: Targets, m: int, inner: Array, e: int, x: float, y: float, theta: float, c: float, s: float
) -> tuple[float, float, float, float]:
    """Turn to the direction, the direction's gradient and the speed that the target's field wants at a point."""
    if t.kind[m] == LOOP or t.kind[m] == PLANNED_FIELD + LOOP:
        return _loop(t, m, inner, e, x, y, c, s)
    a = t.shape
    psi, gx, gy, v = wave_guide((x - a[m, 3]) / a[m, 0], (y - a[m, 4]) / a[m, 0], a[m, 0], a[m, 1], a[m, 2])
    return wrapped(psi - theta), gx, gy, v


@inlined
def driven(
    turn: float, grad_x: float, grad_y: float, v: float, c: float, s: float, limits: Limits
) -> tuple[float, float]:
    """Forward and turning speed within ``limits``: of both, of the wheels, wheels apart, gain of the turn."""
    v_max, w_max, wheel_max, apart, gain = limits
    v = min(v, v_max)
    w = gain * turn + v * (grad_x * c + grad_y * s)
    w = min(max(w, -w_max), w_max)
    fastest = abs(v) + abs(w) * 0.5 * apart
    scale = wheel_max / fastest if fastest > wheel_max else 1.0
    return v * scale, w * scale


@inlined
def limits_of(t: Targets, m: int) -> Limits:
    """Return what ``driven`` needs of a target."""
    a = t.shape
    return a[m, 5], a[m, 6], a[m, 8], a[m, 7], a[m, 10]


@inner
def drive(
    t: Targets, m: int, inner: Array, e: int, x: float, y: float, theta: float, c: float, s: float
) -> tuple[float, float]:
    """Forward and turning speed that the robot runs at a pose: `VectorFieldMotion._command`."""
    turn, grad_x, grad_y, v = _guide(t, m, inner, e, x, y, theta, c, s)
    return driven(turn, grad_x, grad_y, inner[e, m, PACE] * v, c, s, limits_of(t, m))


@inner
def step_field(t: Targets, m: int, now: Array, inner: Array, e: int, dt: float) -> None:
    """`VectorFieldMotion.step`."""
    x, y = now[e, m, 0], now[e, m, 1]
    theta, v, w = inner[e, m, 0], inner[e, m, 1], inner[e, m, 2]
    lag, half = t.shape[m, 9], 0.5 * dt
    c, s = circle(theta)
    if lag > 0.0:
        v_goal, w_goal = drive(t, m, inner, e, x, y, theta, c, s)
        gain = -math.expm1(-dt / lag)
        v_next, w_next = v + gain * (v_goal - v), w + gain * (w_goal - w)
        v_mid, w_mid = 0.5 * (v + v_next), 0.5 * (w + w_next)
        c, s = circle(theta + 0.25 * dt * (w + w_mid))
    else:
        theta_mid, x_mid, y_mid = theta + half * w, x + half * v * c, y + half * v * s
        c, s = circle(theta_mid)
        v_mid, w_mid = drive(t, m, inner, e, x_mid, y_mid, theta_mid, c, s)
        v_next, w_next = v_mid, w_mid
    x, y, theta = x + dt * v_mid * c, y + dt * v_mid * s, theta + dt * w_mid
    if lag <= 0.0:
        c, s = circle(theta)
        v_next, w_next = drive(t, m, inner, e, x, y, theta, c, s)
    set_planar(now, e, m, x, y, 0.0, theta, v_next, w_next)
    inner[e, m, 0], inner[e, m, 1], inner[e, m, 2] = theta, v_next, w_next
