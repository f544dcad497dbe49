"""Simple polygons in the plane: exact signed distance and the nearest point a margin inside, compiled.

Vertices run counter-clockwise and are not repeated at the end. The points at least ``margin`` inside form the
erosion of the polygon by a disc. Its border is made of edges moved inwards by the margin and of arcs of that
radius about reflex vertices; so the nearest point of the erosion is the point itself, a projection on one of these
curves, or a point where two of them meet (``erosion_corners``, computed once for a margin).
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["erosion_corners", "nearest_in_erosion", "point_distance", "signed_distance"]

#: how far (m) a point of the eroded border may be outside by rounding
_TOLERANCE = 1e-9


@cached_njit
def point_distance(x: float, y: float, vertices: Array) -> float:
    """Distance of one point to the border of the polygon (n, 2), negative inside."""
    n = vertices.shape[0]
    best = math.inf
    inside = False
    for i in range(n):
        ax, ay = vertices[i, 0], vertices[i, 1]
        j = i + 1 if i + 1 < n else 0
        bx, by = vertices[j, 0], vertices[j, 1]
        ex, ey = bx - ax, by - ay
        px, py = x - ax, y - ay
        t = (px * ex + py * ey) / (ex * ex + ey * ey)
        t = min(1.0, max(0.0, t))
        dx, dy = px - t * ex, py - t * ey
        best = min(best, dx * dx + dy * dy)
        if (ay > y) != (by > y) and x < ax + (y - ay) * ex / ey:
            inside = not inside
    return -math.sqrt(best) if inside else math.sqrt(best)


@cached_njit
def signed_distance(points: Array, vertices: Array) -> Array:
    """Distance (K,) of points (K, 2 or more; x and y count) to the border of the polygon (n, 2), negative inside."""
    out = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        out[k] = point_distance(points[k, 0], points[k, 1], vertices)
    return out


def _offset_lines(vertices: Array, margin: float) -> tuple[Array, Array]:
    edges = np.roll(vertices, -1, axis=0) - vertices
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    return vertices + margin * inward, edges


def _line_line(starts: Array, edges: Array) -> Array:
    i, j = np.triu_indices(len(starts), 1)
    cross = edges[i, 0] * edges[j, 1] - edges[i, 1] * edges[j, 0]
    apart = starts[j] - starts[i]
    keep = np.abs(cross) > 1e-12 * np.linalg.norm(edges[i], axis=1) * np.linalg.norm(edges[j], axis=1)
    t = (apart[keep, 0] * edges[j, 1][keep] - apart[keep, 1] * edges[j, 0][keep]) / cross[keep]
    return np.asarray(starts[i][keep] + t[:, None] * edges[i][keep])


def _line_circle(starts: Array, edges: Array, centers: Array, radius: float) -> Array:
    unit = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    apart = centers[None] - starts[:, None]
    along = np.sum(apart * unit[:, None], axis=-1)
    foot = starts[:, None] + along[..., None] * unit[:, None]
    half2 = radius**2 - np.sum((centers[None] - foot) ** 2, axis=-1)
    hit = half2 >= 0.0
    step = np.sqrt(np.where(hit, half2, 0.0))[..., None] * unit[:, None]
    return np.concatenate([(foot + step)[hit], (foot - step)[hit]])


def _circle_circle(centers: Array, radius: float) -> Array:
    i, j = np.triu_indices(len(centers), 1)
    apart = centers[j] - centers[i]
    gap = np.linalg.norm(apart, axis=1)
    hit = (gap > 0.0) & (gap <= 2.0 * radius)
    middle, apart, gap = 0.5 * (centers[i] + centers[j])[hit], apart[hit], gap[hit]
    side = np.stack([-apart[:, 1], apart[:, 0]], axis=1) / gap[:, None]
    step = np.sqrt(radius**2 - 0.25 * gap**2)[:, None] * side
    return np.concatenate([middle + step, middle - step])


def erosion_corners(vertices: Array, margin: float) -> Array:
    """Points (K, 2) where two curves of the eroded border meet; empty when no point is ``margin`` inside."""
    starts, edges = _offset_lines(vertices, margin)
    candidates = np.concatenate(
        [
            starts,
            starts + edges,
            _line_line(starts, edges),
            _line_circle(starts, edges, vertices, margin),
            _circle_circle(vertices, margin),
        ]
    )
    keep = signed_distance(candidates, vertices) <= _TOLERANCE - margin
    return np.ascontiguousarray(candidates[keep])


@cached_njit
def nearest_in_erosion(point: Array, vertices: Array, margin: float, corners: Array) -> Array:
    """Nearest point (2,) to ``point`` (2,) that is at least ``margin`` inside, to 1e-9 m.

    ``corners`` are those of ``erosion_corners``; there must be at least one unless the point itself is inside.
    """
    x, y = point[0], point[1]
    out = np.empty(2)
    out[0], out[1] = x, y
    if point_distance(x, y, vertices) <= -margin:
        return out
    best = math.inf
    for k in range(corners.shape[0]):
        d2 = (corners[k, 0] - x) ** 2 + (corners[k, 1] - y) ** 2
        if d2 < best:
            best = d2
            out[0], out[1] = corners[k, 0], corners[k, 1]
    n = vertices.shape[0]
    for i in range(n):
        ax, ay = vertices[i, 0], vertices[i, 1]
        j = i + 1 if i + 1 < n else 0
        ex, ey = vertices[j, 0] - ax, vertices[j, 1] - ay
        length = math.sqrt(ex * ex + ey * ey)
        # on the edge moved inwards
        sx, sy = ax - margin * ey / length, ay + margin * ex / length
        t = min(1.0, max(0.0, ((x - sx) * ex + (y - sy) * ey) / (length * length)))
        cx, cy = sx + t * ex, sy + t * ey
        d2 = (cx - x) ** 2 + (cy - y) ** 2
        if d2 < best and point_distance(cx, cy, vertices) <= _TOLERANCE - margin:
            best = d2
            out[0], out[1] = cx, cy
        # on the arc about the vertex
        radial = math.sqrt((x - ax) ** 2 + (y - ay) ** 2)
        if radial > 0.0:
            cx, cy = ax + margin * (x - ax) / radial, ay + margin * (y - ay) / radial
            d2 = (cx - x) ** 2 + (cy - y) ** 2
            if d2 < best and point_distance(cx, cy, vertices) <= _TOLERANCE - margin:
                best = d2
                out[0], out[1] = cx, cy
    return out
