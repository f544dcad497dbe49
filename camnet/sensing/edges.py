"""Corners of a dark square below the pixel: lines through many points of its edges, intersected.

| symbol | meaning | unit |
| --- | --- | --- |
| ``c0 .. c3`` | corners as found by the detector, good to about a pixel | px |
| ``n`` | normal of an edge, from dark to light | - |
| ``g(s)`` | rise of the grey level along ``n`` at the distance s from the edge as found | 1/px |
| ``s* = sum s g(s) / sum g(s)`` | where the edge is: centre of the rise, whatever symmetric blur there is | px |

Points are spread over the edge but for its ends, where the neighbouring edge would disturb. Lens distortion, which
bends straight edges, is taken out of the points before the lines are fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["edge_points", "refine_corners"]

#: points along an edge, and steps along each normal
POINTS, STEPS = 24, 16
#: share of the edge left out at each end
_ENDS = 0.12
#: an edge is looked for this far to both sides: in modules, and at most, pixels
_REACH_MODULES, _REACH_PX = 0.45, 4.0
#: an edge's points must rise by this many grey levels
_LEAST_RISE = 20.0


@cached_njit
def _grey(image: NDArray[np.uint8], x: float, y: float) -> float:
    """Bilinear; NaN outside."""
    i, j = math.floor(x), math.floor(y)
    if i < 0 or j < 0 or i + 1 >= image.shape[1] or j + 1 >= image.shape[0]:
        return math.nan
    s, t = x - i, y - j
    top = (1.0 - s) * image[j, i] + s * image[j, i + 1]
    low = (1.0 - s) * image[j + 1, i] + s * image[j + 1, i + 1]
    return float((1.0 - t) * top + t * low)


@cached_njit
def edge_points(image: NDArray[np.uint8], corners: Array, modules: int) -> Array:
    """Points (4, POINTS, 2) of the edges of a dark square with corners (4, 2), clockwise; NaN where there is no edge.

    ``modules`` is the number of modules along an edge: nearer than half a module nothing else disturbs.
    """
    out = np.full((4, POINTS, 2), np.nan)
    for e in range(4):
        x0, y0 = corners[e, 0], corners[e, 1]
        dx, dy = corners[(e + 1) % 4, 0] - x0, corners[(e + 1) % 4, 1] - y0
        length = math.hypot(dx, dy)
        if length < modules:
            continue
        nx, ny = dy / length, -dx / length  # outwards, rows counting downwards
        reach = min(_REACH_PX, _REACH_MODULES * length / modules)
        step = 2.0 * reach / STEPS
        for k in range(POINTS):
            share = _ENDS + (1.0 - 2.0 * _ENDS) * (k + 0.5) / POINTS
            px, py = x0 + share * dx, y0 + share * dy
            before = _grey(image, px - reach * nx, py - reach * ny)
            rise, moment = 0.0, 0.0
            for m in range(STEPS):
                s = -reach + (m + 1) * step
                after = _grey(image, px + s * nx, py + s * ny)
                rise += after - before
                moment += (s - 0.5 * step) * (after - before)
                before = after
            if rise > _LEAST_RISE:
                s = moment / rise
                if abs(s) < reach:
                    out[e, k, 0], out[e, k, 1] = px + s * nx, py + s * ny
    return out


@cached_njit
def _intersect(points: Array) -> Array:
    """Corners (4, 2) where the lines fitted to neighbouring edges' points (4, n, 2) meet; NaN without a line."""
    lines = np.full((4, 3), np.nan)
    for e in range(4):
        n, mx, my = 0, 0.0, 0.0
        for k in range(points.shape[1]):
            if math.isfinite(points[e, k, 0]):
                n += 1
                mx += points[e, k, 0]
                my += points[e, k, 1]
        if 2 * n < points.shape[1]:
            continue
        mx, my = mx / n, my / n
        xx = xy = yy = 0.0
        for k in range(points.shape[1]):
            if math.isfinite(points[e, k, 0]):
                a, b = points[e, k, 0] - mx, points[e, k, 1] - my
                xx += a * a
                xy += a * b
                yy += b * b
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        lines[e, 0], lines[e, 1] = -math.sin(angle), math.cos(angle)
        lines[e, 2] = lines[e, 0] * mx + lines[e, 1] * my
    out = np.empty((4, 2))
    for e in range(4):
        a, b = lines[(e + 3) % 4], lines[e]
        det = a[0] * b[1] - a[1] * b[0]
        if abs(det) < 1e-6:
            out[e] = np.nan
        else:
            out[e, 0], out[e, 1] = (a[2] * b[1] - b[2] * a[1]) / det, (a[0] * b[2] - b[0] * a[2]) / det
    return out


def refine_corners(
    image: NDArray[np.uint8], corners: Array, modules: int, normalise: Callable[[Array], Array]
) -> Array | None:
    """Corners (4, 2) in the coordinates that ``normalise`` makes of pixels (..., 2), from corners (4, 2) in pixels.

    None if an edge cannot be found.
    """
    first = edge_points(image, corners, modules)
    again = _intersect(first)
    if not np.isfinite(again).all():
        return None
    points = edge_points(image, again, modules)  # about the better line
    exact = _intersect(normalise(points))
    return exact if np.isfinite(exact).all() else None
