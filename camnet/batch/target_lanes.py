"""Targets on loops, four environments at a time: `camnet.batch.target_field` with a lane of a vector register for each.

All environments have the same target, so its numbers are the same in all lanes. What is here is the usual case: the
robot follows at once (no lag), two of Newton's steps end at the nearest place within the piece of the loop in which it
was expected, and the heading is about the one wanted. A lane of which that is not true is asked again by itself
(`camnet.batch.target_field.drive`), so that what a target does depends on nothing but itself.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inlined, inner
from camnet.batch.lane_layout import LANES, lanes_of
from camnet.batch.target_field import (
    CLOSE_M,
    Limits,
    Place,
    drive,
    driven,
    led_along,
    limits_of,
    on_cubic,
    put_planar,
    speed_wave,
)
from camnet.batch.target_laws import LOOP, SAFE, Targets
from camnet.batch.triples import AHEAD, circle, direction_ahead
from camnet.types import Array, IntArray

__all__ = ["ROWS", "in_lanes", "step_loops"]

# rows of the scratch, one entry a lane: pose and its speeds; where the field is asked, and what it answers
X, Y, THETA, V, W = range(5)
AT_X, AT_Y, COS, SIN, FORWARD, TURN = range(5, 11)
# parameter where the piece begins, its length, the parameter above that, how far it moved; whether all is as usual
BEGIN, LENGTH, ABOVE, MOVED, USUAL = range(11, 16)
# the piece's cubics, the place: x, y and their derivatives
CUBICS, PLACE = 16, 24
ROWS = 30


@inner
def in_lanes(t: Targets, m: int) -> bool:
    """Whether target ``m`` is one of those that are stepped here."""
    return t.kind[m] == LOOP and t.shape[m, 9] <= 0.0


@inlined
def _cubic(x: Array, row: int, i: int) -> tuple[float, float, float, float]:
    at = row * LANES + i
    return x[at], x[at + LANES], x[at + 2 * LANES], x[at + 3 * LANES]


@inner
def _expect(t: Targets, m: int, inner: Array, e: int, x: Array, i: int) -> int:
    """Note the piece of the loop in which the nearest place should be, and where; the piece's number."""
    first, pieces = t.knot_first[m], t.knot_first[m + 1] - t.knot_first[m] - 1
    period, piece, u = t.knots[first + pieces], int(inner[e, m, 5]), inner[e, m, 3] + inner[e, m, 4]
    if u < 0.0 or u >= period:
        u -= period * math.floor(u / period)
    if u < t.knots[first + piece]:
        piece = piece - 1 if t.knots[first + piece] - u < 0.5 * period else 0
    elif u >= t.knots[first + piece + 1]:
        piece += 1
    k = first + piece
    x[BEGIN * LANES + i], x[LENGTH * LANES + i] = t.knots[k], t.knots[k + 1] - t.knots[k]
    x[ABOVE * LANES + i] = u - t.knots[k]
    for j in range(4):
        x[(CUBICS + j) * LANES + i], x[(CUBICS + 4 + j) * LANES + i] = t.pieces[k, 0, j], t.pieces[k, 1, j]
    return piece


@inlined
def _newton(place: Place, x: float, y: float) -> tuple[float, float]:
    """Newton's step towards the place nearest to a point, and the slope, which has to be positive."""
    px, py, dx, dy, ddx, ddy = place
    slope = dx * dx + dy * dy + (px - x) * ddx + (py - y) * ddy
    return ((px - x) * dx + (py - y) * dy) / slope, slope


@inlined
def _search(x: Array, safe: float) -> None:
    """Find the nearest places; where that is not what it should be ``USUAL`` is 0."""
    for i in range(LANES):
        at_x, at_y, expected = x[AT_X * LANES + i], x[AT_Y * LANES + i], x[ABOVE * LANES + i]
        cx, cy = _cubic(x, CUBICS, i), _cubic(x, CUBICS + 4, i)
        step, slope = _newton(on_cubic(cx, cy, expected), at_x, at_y)
        h = expected - step
        last, last_slope = _newton(on_cubic(cx, cy, h), at_x, at_y)
        h -= last
        px, py, dx, dy, ddx, ddy = on_cubic(cx, cy, h)
        x[ABOVE * LANES + i], x[MOVED * LANES + i] = h, h - expected
        x[PLACE * LANES + i], x[(PLACE + 1) * LANES + i] = px, py
        x[(PLACE + 2) * LANES + i], x[(PLACE + 3) * LANES + i] = dx, dy
        x[(PLACE + 4) * LANES + i], x[(PLACE + 5) * LANES + i] = ddx, ddy
        square = (px - at_x) * (px - at_x) + (py - at_y) * (py - at_y)
        inside = (h > -CLOSE_M) & (h < x[LENGTH * LANES + i] + CLOSE_M) & (square < safe)
        well = (slope > 0.0) & (last_slope > 0.0) & (abs(last) < CLOSE_M) & inside
        x[USUAL * LANES + i] = 1.0 if well else 0.0


@inlined
def _steer(x: Array, g: float, speed: float, wave: float, period: float, limits: Limits) -> None:
    """Work out the forward and turning speeds; where the heading is far off ``USUAL`` is 0."""
    for i in range(LANES):
        row = PLACE * LANES + i
        place = (x[row], x[row + 4], x[row + 8], x[row + 12], x[row + 16], x[row + 20])
        c, s = x[COS * LANES + i], x[SIN * LANES + i]
        aside, ahead, gx, gy = led_along(place, x[AT_X * LANES + i], x[AT_Y * LANES + i], c, s, g)
        v = speed * speed_wave(wave, (x[BEGIN * LANES + i] + x[ABOVE * LANES + i]) / period)
        v, w = driven(direction_ahead(aside, ahead), gx, gy, v, c, s, limits)
        x[FORWARD * LANES + i], x[TURN * LANES + i] = v, w
        x[USUAL * LANES + i] *= 1.0 if abs(aside) <= AHEAD * ahead else 0.0


@inner
def _ask(t: Targets, m: int, inner: Array, block: IntArray, first: int, x: Array) -> None:
    """Ask the field for the speeds of four environments' targets from ``first`` on, at (AT_X, AT_Y)."""
    count = min(LANES, block.shape[0] - first)
    pieces = (
        _expect(t, m, inner, block[first], x, 0),
        _expect(t, m, inner, block[first + min(1, count - 1)], x, 1),
        _expect(t, m, inner, block[first + min(2, count - 1)], x, 2),
        _expect(t, m, inner, block[first + min(3, count - 1)], x, 3),
    )
    a = t.shape
    _search(x, a[m, SAFE])
    _steer(x, a[m, 0], a[m, 1], a[m, 2], t.knots[t.knot_first[m + 1] - 1], limits_of(t, m))
    for i in range(count):
        e = block[first + i]
        if x[USUAL * LANES + i] > 0.0:
            inner[e, m, 3] = x[BEGIN * LANES + i] + x[ABOVE * LANES + i]
            inner[e, m, 4] += x[MOVED * LANES + i]
            inner[e, m, 5] = pieces[i]
        else:
            at_x, at_y, c, s = (
                x[AT_X * LANES + i],
                x[AT_Y * LANES + i],
                x[COS * LANES + i],
                x[SIN * LANES + i],
            )
            v, w = drive(t, m, inner, e, at_x, at_y, x[THETA * LANES + i], c, s)
            x[FORWARD * LANES + i], x[TURN * LANES + i] = v, w


@inner
def _halfway(x: Array, dt: float) -> None:
    """Go half of the step at the speeds of its beginning; the pose stays the beginning's but for the heading."""
    for i in range(lanes_of(x, ROWS)):
        v, theta = x[V * LANES + i], x[THETA * LANES + i]
        c, s = circle(theta)
        x[AT_X * LANES + i] = x[X * LANES + i] + 0.5 * dt * v * c
        x[AT_Y * LANES + i] = x[Y * LANES + i] + 0.5 * dt * v * s
        c, s = circle(theta + 0.5 * dt * x[W * LANES + i])
        x[COS * LANES + i], x[SIN * LANES + i] = c, s


@inner
def _all_the_way(x: Array, dt: float) -> None:
    """Go the step at the speeds of its middle."""
    for i in range(lanes_of(x, ROWS)):
        v, w = x[FORWARD * LANES + i], x[TURN * LANES + i]
        x[AT_X * LANES + i] = x[X * LANES + i] + dt * v * x[COS * LANES + i]
        x[AT_Y * LANES + i] = x[Y * LANES + i] + dt * v * x[SIN * LANES + i]
        theta = x[THETA * LANES + i] + dt * w
        x[THETA * LANES + i] = theta
        c, s = circle(theta)
        x[COS * LANES + i], x[SIN * LANES + i] = c, s
        c, s = circle(0.5 * theta)
        x[X * LANES + i], x[Y * LANES + i] = c, s  # of half the heading: the place is no longer needed


@inner
def step_loops(
    t: Targets, m: int, now: Array, inner: Array, block: IntArray, first: int, dt: float, x: Array
) -> None:
    """`camnet.batch.target_field.step_field` for target ``m`` of the block's environments ``first`` to ``first`` + 3.

    ``x`` (4 ROWS,) is scratch. Where the block has fewer, lanes repeat its last environment.
    """
    count = min(LANES, block.shape[0] - first)
    for i in range(LANES):
        e = block[first + min(i, count - 1)]
        x[X * LANES + i], x[Y * LANES + i] = now[e, m, 0], now[e, m, 1]
        x[THETA * LANES + i], x[V * LANES + i], x[W * LANES + i] = (
            inner[e, m, 0],
            inner[e, m, 1],
            inner[e, m, 2],
        )
    _halfway(x, dt)
    _ask(t, m, inner, block, first, x)
    _all_the_way(x, dt)
    _ask(t, m, inner, block, first, x)
    for i in range(count):
        e, v, w = block[first + i], x[FORWARD * LANES + i], x[TURN * LANES + i]
        at_x, at_y, c, s = x[AT_X * LANES + i], x[AT_Y * LANES + i], x[X * LANES + i], x[Y * LANES + i]
        put_planar(now, e, m, at_x, at_y, 0.0, c, s, v, w)
        inner[e, m, 0], inner[e, m, 1], inner[e, m, 2] = x[THETA * LANES + i], v, w
