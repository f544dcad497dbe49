"""References and commands of four agents at a time: `camnet.batch.reference` with a lane of a vector register for each.

`ask_lanes` is the sliding mode, (4-3) and (4-6), `follow_lanes` moves the references on. A reference that has to brake
before a border is left to `camnet.batch.reference.position_step`: `follow_lanes` tells whether there is one.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inlined, inner
from camnet.batch.lane_layout import (
    ALLOWED,
    CAMERA,
    DEPTHS,
    DISC,
    ERROR,
    GENTLE_STOP,
    HALF_YAW,
    HEADING,
    HIGH,
    LANES,
    LOOK,
    LOW,
    MOTION,
    NEXT,
    SETPOINT,
    STOP,
    A,
    U,
    get,
    get_four,
    get_pair,
    put,
)
from camnet.batch.reference import TOLERANCE, gaze_step, gentle_stop, moved, pointing, stop, wanted
from camnet.batch.triples import circle, even_rotation_vector, tanh
from camnet.geometry.triples import Triple, multiply, rotate_inverse
from camnet.types import Array

__all__ = ["ask_lanes", "follow_lanes"]

Gains = tuple[float, float, float, float]
Limits = tuple[float, float, float, float, float]


@inlined
def _switch(e: float, code: int, per_layer: float) -> float:
    sign = 1.0 if e > 0.0 else (-1.0 if e < 0.0 else 0.0)
    straight = min(max(e * per_layer, -1.0), 1.0)
    smooth = tanh(e * per_layer)
    return smooth if code == 2 else (straight if code == 1 else sign)


@inlined
def _ask(x: Array, gains: Gains, code: int) -> None:
    """Command velocity and angular velocity of the cameras."""
    k1, d_l, d_a, per_layer = gains[0], gains[1], gains[2], 1.0 / gains[3]
    for i in range(LANES):
        gaze, rate = get_pair(x, MOTION + 9, i), get_pair(x, MOTION + 11, i)
        pan, tilt = circle(gaze[0]), circle(gaze[1])
        tx, ty = pan[1] / pan[0], tilt[1] / tilt[0]
        q_d, w_d = pointing(tx, ty, rate[0], rate[1], get_pair(x, HEADING, i), get_pair(x, HALF_YAW, i))
        p, q = get(x, CAMERA, i), get_four(x, CAMERA + 3, i)
        p_d, v_d = get(x, MOTION, i), get(x, MOTION + 3, i)
        off = multiply((q_d[0], -q_d[1], -q_d[2], -q_d[3]), q)
        a, ahead = even_rotation_vector(off), rotate_inverse(off, w_d)
        e = (p[0] - p_d[0], p[1] - p_d[1], p[2] - p_d[2])  # (4-3)
        u: Triple = (
            v_d[0] - k1 * e[0] - d_l * _switch(e[0], code, per_layer),  # (4-6)
            v_d[1] - k1 * e[1] - d_l * _switch(e[1], code, per_layer),
            v_d[2] - k1 * e[2] - d_l * _switch(e[2], code, per_layer),
        )
        w: Triple = (
            ahead[0] - k1 * a[0] - d_a * _switch(a[0], code, per_layer),  # (4-6)
            ahead[1] - k1 * a[1] - d_a * _switch(a[1], code, per_layer),
            ahead[2] - k1 * a[2] - d_a * _switch(a[2], code, per_layer),
        )
        put(x, U, i, u)
        put(x, A, i, get(x, MOTION + 6, i))
        put(x, LOOK, i, w)
        x[ERROR * LANES + i] = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]


@inner
def ask_lanes(lanes: Array, count: int, gains: Array, code: int) -> None:
    """Command what brings cameras to their references, in the first ``count`` environments' workspaces.

    ``lanes`` (count or more, B, 4 ROWS) change in place; ``gains`` and ``code`` as in `command_of`.
    """
    g = (gains[0], gains[1], gains[2], gains[3])
    for k in range(count):
        for b in range(lanes.shape[1]):
            _ask(lanes[k, b], g, code)


@inlined
def _depth(x: Array, lane: int, p: Triple) -> float:
    """Depth of a point inside the box around the lane's region."""
    low, high = get(x, LOW, lane), get(x, HIGH, lane)
    across = min(p[0] - low[0], high[0] - p[0], p[1] - low[1], high[1] - p[1])
    return min(across, p[2] - low[2], high[2] - p[2])


@inlined
def _shallower(x: Array, row: int, lane: int, p: Triple) -> None:
    """Make a depth that of the point inside the lane's upright cylinder if it is one and this is less."""
    disc = get(x, DISC, lane)
    dx, dy = p[0] - disc[0], p[1] - disc[1]
    depth = disc[2] - math.sqrt(dx * dx + dy * dy)
    x[row * LANES + lane] = min(x[row * LANES + lane], depth if disc[2] > 0.0 else math.inf)


@inner
def _mind_cylinders(x: Array) -> None:
    """Count the depth inside cylinders as well: `camnet.batch.reference.clearance`."""
    for i in range(LANES):
        _shallower(x, DEPTHS, i, get(x, MOTION, i))
        _shallower(x, DEPTHS + 1, i, get(x, NEXT, i))
        _shallower(x, DEPTHS + 2, i, get(x, STOP, i))
        _shallower(x, DEPTHS + 3, i, get(x, GENTLE_STOP, i))


@inner
def _any_cylinder(x: Array) -> bool:
    widest = 0.0
    for i in range(LANES):
        widest = max(widest, x[(DISC + 2) * LANES + i])
    return widest > 0.0


@inlined
def _want(x: Array, limits: Limits, dt: float) -> None:
    """Where references would be after the period, and where they could stop."""
    for i in range(LANES):
        p, v, a = get(x, MOTION, i), get(x, MOTION + 3, i), get(x, MOTION + 6, i)
        push = wanted(p, v, a, get(x, SETPOINT, i), limits, dt)
        p_next, v_next = moved(p, v, push, dt)
        end, gentle_end = (
            stop(p_next, v_next, limits[1]),
            gentle_stop(p_next, v_next, push, limits[1], limits[4]),
        )
        put(x, NEXT, i, p_next)
        put(x, NEXT + 3, i, v_next)
        put(x, NEXT + 6, i, push)
        put(x, STOP, i, end)
        put(x, GENTLE_STOP, i, gentle_end)
        x[DEPTHS * LANES + i] = _depth(x, i, p)
        x[(DEPTHS + 1) * LANES + i] = _depth(x, i, p_next)
        x[(DEPTHS + 2) * LANES + i] = _depth(x, i, end)
        x[(DEPTHS + 3) * LANES + i] = _depth(x, i, gentle_end)


@inlined
def _go_on(x: Array, margin: float, limits: tuple[float, float, float], dt: float) -> None:
    """Move references that may, and all gazes."""
    least = margin - TOLERANCE
    for i in range(LANES):
        k = DEPTHS * LANES + i
        safe = min(x[k + LANES], x[k + 2 * LANES], x[k + 3 * LANES])
        allowed = 1.0 if (x[k] < margin - 2.0 * TOLERANCE) | (safe >= least) else 0.0
        x[ALLOWED * LANES + i] = allowed
        for j in range(9):
            old, new = x[(MOTION + j) * LANES + i], x[(NEXT + j) * LANES + i]
            x[(MOTION + j) * LANES + i] = (
                allowed * new + (1.0 - allowed) * old
            )  # a choice would become a branch
        look = gaze_step(
            get_pair(x, MOTION + 9, i),
            get_pair(x, MOTION + 11, i),
            get_pair(x, SETPOINT + 3, i),
            limits[0],
            limits[1],
            limits[2],
            dt,
        )
        x[(MOTION + 9) * LANES + i], x[(MOTION + 10) * LANES + i] = look[0], look[1]
        x[(MOTION + 11) * LANES + i], x[(MOTION + 12) * LANES + i] = look[2], look[3]


@inner
def _want_all(lanes: Array, count: int, limits: Limits, dt: float) -> None:
    for k in range(count):
        for b in range(lanes.shape[1]):
            _want(lanes[k, b], limits, dt)


@inner
def _go_on_all(
    lanes: Array, count: int, margin: float, limits: tuple[float, float, float], dt: float
) -> None:
    for k in range(count):
        for b in range(lanes.shape[1]):
            _go_on(lanes[k, b], margin, limits, dt)


@inner
def follow_lanes(
    lanes: Array, count: int, margin: float, limits: Array, gaze_limits: Array, dt: float
) -> int:
    """Move the references of the first ``count`` environments' workspaces on for a control period.

    Returns
    -------
    int
        How many of the lanes wait, because their references have to brake: those with ``ALLOWED`` 0.
    """
    _want_all(lanes, count, (limits[0], limits[1], limits[2], limits[3], limits[4]), dt)
    for k in range(count):
        for b in range(lanes.shape[1]):
            if _any_cylinder(lanes[k, b]):
                _mind_cylinders(lanes[k, b])
    _go_on_all(lanes, count, margin, (gaze_limits[0], gaze_limits[1], gaze_limits[2]), dt)
    waiting = 0
    for k in range(count):
        for b in range(lanes.shape[1]):
            for i in range(LANES):
                waiting += 1 if lanes[k, b, ALLOWED * LANES + i] == 0.0 else 0
    return waiting
