r"""Exact signed distance of a point to an ellipsoid, box or upright cylinder, and its gradient, compiled.

The signed distance d to a convex body (negative inside) is convex and 1-Lipschitz; its gradient is the outward
normal at the nearest surface point. An ellipsoid with half-axes a has the nearest point
``x_i = a_i^2 y_i / (t + a_i^2)`` to y, with t the largest root of

    F(t) = sum (a_i y_i / (t + a_i^2))^2 - 1,   convex and decreasing for t > -min a^2

so Newton's method from the left never overshoots (D. Eberly, "Distance from a point to an ellipse, an ellipsoid, or a
hyperellipsoid", 2013).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| kind | `row[0]`: `ELLIPSOID`, `BOX`, `CYLINDER` (axis: third column of A) | | |
| c, c' | `row[1:4]`, `row[4:7]` centre at the plan's start, its velocity | (3,) | m, m/s |
| A | `row[7:16]` body axes in the world, row-major | (3,3) | |
| a | `row[16:19]` half-axes (cylinder: radius, radius, half height) | (3,) | m |
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["BOX", "CYLINDER", "ELLIPSOID", "ROW", "segment_clearance", "signed_distance"]

ELLIPSOID, BOX, CYLINDER = 0, 1, 2
#: length of a packed obstacle
ROW = 19
_NEWTON = 60
_BISECTIONS = 30


@cached_njit(error_model="numpy")
def _ellipsoid(y: Array, a: Array, normal: Array) -> float:
    """Signed distance in body axes; ``y`` (3,) is changed to its absolute value."""
    smallest = min(a[0], a[1], a[2])
    sign = np.empty(3)
    t = -math.inf
    for i in range(3):
        sign[i] = -1.0 if y[i] < 0.0 else 1.0
        y[i] = max(abs(y[i]), 1e-9 * smallest)
        t = max(t, a[i] * (y[i] - a[i]))
    for _ in range(_NEWTON):
        value, slope = -1.0, 0.0
        for i in range(3):
            w = t + a[i] * a[i]
            part = a[i] * y[i] / w
            value += part * part
            slope -= 2.0 * part * part / w
        move = -value / slope
        t += move
        if move <= 1e-15 * (abs(t) + smallest * smallest):
            break
    size = 0.0
    for i in range(3):
        normal[i] = y[i] / (t + a[i] * a[i])  # x_i / a_i^2
        size += normal[i] * normal[i]
    size = math.sqrt(size)
    out = 0.0
    for i in range(3):
        near = a[i] * a[i] * normal[i]
        normal[i] /= size
        out += (y[i] - near) * normal[i]
        normal[i] *= sign[i]
    return out


@cached_njit(error_model="numpy")
def _box(y: Array, a: Array, normal: Array) -> float:
    outside, deepest, axis = 0.0, -math.inf, 0
    for i in range(3):
        over = abs(y[i]) - a[i]
        normal[i] = max(over, 0.0) * (1.0 if y[i] >= 0.0 else -1.0)
        outside += normal[i] * normal[i]
        if over > deepest:
            deepest, axis = over, i
    if outside > 0.0:
        size = math.sqrt(outside)
        for i in range(3):
            normal[i] /= size
        return size
    normal[axis] = 1.0 if y[axis] >= 0.0 else -1.0
    return deepest


@cached_njit(error_model="numpy")
def _cylinder(y: Array, a: Array, normal: Array) -> float:
    radius = math.hypot(y[0], y[1])
    ux, uy = (y[0] / radius, y[1] / radius) if radius > 0.0 else (1.0, 0.0)
    side, end = radius - a[0], abs(y[2]) - a[2]
    up = 1.0 if y[2] >= 0.0 else -1.0
    along_side, along_end, out = 0.0, 0.0, 0.0
    if side > 0.0 or end > 0.0:
        out = math.hypot(max(side, 0.0), max(end, 0.0))
        along_side, along_end = max(side, 0.0) / out, max(end, 0.0) / out
    elif side > end:
        out, along_side = side, 1.0
    else:
        out, along_end = end, 1.0
    normal[0], normal[1], normal[2] = along_side * ux, along_side * uy, along_end * up
    return out


@cached_njit(error_model="numpy")
def signed_distance(row: Array, p: Array, t_s: float, normal: Array) -> float:
    """Distance in m of ``p`` (3,) at ``t_s`` after the plan's start, negative inside; fills its gradient (3,)."""
    y, local = np.empty(3), np.empty(3)
    for j in range(3):
        y[j] = 0.0
        for i in range(3):
            y[j] += row[7 + 3 * i + j] * (p[i] - row[1 + i] - t_s * row[4 + i])
    if row[0] == ELLIPSOID:
        out = _ellipsoid(y, row[16:19], local)
    elif row[0] == BOX:
        out = _box(y, row[16:19], local)
    else:
        out = _cylinder(y, row[16:19], local)
    for i in range(3):
        normal[i] = row[7 + 3 * i] * local[0] + row[8 + 3 * i] * local[1] + row[9 + 3 * i] * local[2]
    return out


@cached_njit(error_model="numpy")
def segment_clearance(row: Array, start: Array, end: Array, t_s: float) -> float:
    """Return the smallest signed distance of the points of a segment (ends (3,)) to the obstacle at ``t_s``.

    Along a segment the distance is convex, so bisection on the sign of its slope finds the minimum.
    """
    normal, p = np.empty(3), np.empty(3)
    low, high = 0.0, 1.0
    best = min(signed_distance(row, start, t_s, normal), signed_distance(row, end, t_s, normal))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        slope = 0.0
        for i in range(3):
            p[i] = start[i] + middle * (end[i] - start[i])
        best = min(best, signed_distance(row, p, t_s, normal))
        for i in range(3):
            slope += normal[i] * (end[i] - start[i])
        if slope > 0.0:
            high = middle
        else:
            low = middle
    return best
