"""Shortest clear polyline between two points among standing obstacles, by a road map of the free space.

The nodes are a grid over the region, kept where they clear region and obstacles; the edges join the 26 neighbours
where the whole segment is clear. Both are made once, at the first question. A question joins its two points to
the nearest nodes in sight, runs Dijkstra's algorithm and pulls the polyline taut. Complete up to the grid's spacing: a
passage wider than the spacing (less the margins) is found.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from camnet.compiled import cached_njit
from camnet.control.planner.distance_kernel import segment_clearance, signed_distance
from camnet.geometry.polytope import PolytopeRegion
from camnet.geometry.regions import BoxRegion, CylinderRegion, Region
from camnet.types import Array, BoolArray, IntArray

__all__ = ["RoadMap"]

_SPACING_M = 0.3
_NODES_MAX = 12_000
#: nodes that the ends of a question are joined to
_NEAREST = 24
_SAMPLE_M = 0.1
_CONVEX = (BoxRegion, CylinderRegion, PolytopeRegion)
_STEPS = np.array([s for s in itertools.product((-1, 0, 1), repeat=3) if s > (0, 0, 0)])


@cached_njit(error_model="numpy")
def _clearances(points: Array, rows: Array) -> Array:
    out, normal = np.full(points.shape[0], np.inf), np.empty(3)
    for i in range(points.shape[0]):
        for row in rows:
            out[i] = min(out[i], signed_distance(row, points[i], 0.0, normal))
    return out


@cached_njit(error_model="numpy")
def _clear(a: Array, b: Array, rows: Array, least: float) -> bool:
    for row in rows:  # noqa: SIM110 - the compiler has no all() over a generator
        if segment_clearance(row, a, b, 0.0) < least:
            return False
    return True


@cached_njit(error_model="numpy")
def _edges(points: Array, gaps: Array, pairs: IntArray, rows: Array, least: float) -> BoolArray:
    """Which of the segments between ``pairs`` (E,2) of points are clear; far from obstacles that needs no test."""
    out = np.empty(pairs.shape[0], dtype=np.bool_)
    for e in range(pairs.shape[0]):
        a, b = pairs[e]
        length = np.sqrt(np.sum((points[a] - points[b]) ** 2))
        far = gaps[a] + gaps[b] - length >= 2.0 * least  # a distance is 1-Lipschitz
        out[e] = far or _clear(points[a], points[b], rows, least)
    return out


class RoadMap:
    """Routes of a point in ``region`` among obstacles ``rows`` (K,19).

    Parameters
    ----------
    region : where it has to stay (its bounds are the grid's)
    region_margin_m, margin_m : what is kept from the region's border and from obstacles
    """

    def __init__(self, region: Region, rows: Array, region_margin_m: float, margin_m: float) -> None:
        self._region, self._rows = region, rows
        self._inner, self._least = region_margin_m, margin_m
        self._convex = isinstance(region, _CONVEX)
        self._points: Array | None = None
        self._graph: csr_array | None = None

    def clear(self, a: Array, b: Array) -> bool:
        """Whether the segment from ``a`` to ``b`` (3,) keeps all margins; its ends are taken to be in the region."""
        if not _clear(a, b, self._rows, self._least - 1e-6):
            return False
        if self._convex:
            return True
        count = int(np.linalg.norm(b - a) / _SAMPLE_M) + 2
        along = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
        return bool((self._region.signed_distance(along) <= -self._inner + 1e-3).all())

    def _build(self) -> tuple[Array, csr_array]:
        low, high = self._region.bounds
        volume = float(np.prod(np.maximum(high - low - 2.0 * self._inner, 1e-3)))
        h = max(_SPACING_M, (volume / _NODES_MAX) ** (1.0 / 3.0))
        shape = np.maximum(np.floor((high - low - 2.0 * self._inner) / h).astype(int), 0) + 1
        first = 0.5 * (low + high) - 0.5 * h * (shape - 1)
        index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
        points = first + h * index
        gaps = _clearances(points, self._rows)
        free = (gaps >= self._least) & (self._region.signed_distance(points) <= -self._inner)
        names = np.where(free, np.cumsum(free) - 1, -1).reshape(shape)
        points, gaps, index = points[free], gaps[free], index[free]
        pairs = self._neighbours(index, names, shape)
        pairs = pairs[_edges(points, gaps, pairs, self._rows, self._least)]
        if not self._convex:
            middle = 0.5 * (points[pairs[:, 0]] + points[pairs[:, 1]])
            pairs = pairs[self._region.signed_distance(middle) <= -self._inner]
        length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        n = len(points)
        self._points, self._graph = points, csr_array((length, (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        return self._points, self._graph

    @staticmethod
    def _neighbours(index: Array, names: IntArray, shape: IntArray) -> IntArray:
        out = []
        for step in _STEPS:
            there = index + step
            inside = ((there >= 0) & (there < shape)).all(axis=1)
            other = names[tuple(there[inside].T)]
            found = other >= 0
            out.append(np.column_stack([np.flatnonzero(inside)[found], other[found]]))
        return np.concatenate(out).astype(np.int64)

    def route(self, start: Array, goal: Array) -> Array | None:
        """Corners (k,3) of a taut polyline from ``start`` to ``goal`` (3,), ends included; None: there is none."""
        if self.clear(start, goal):
            return np.stack([start, goal])
        points, graph = (self._points, self._graph) if self._graph is not None else self._build()
        assert points is not None
        assert graph is not None
        entries, exits = self._in_sight(start, points), self._in_sight(goal, points)
        if not len(entries) or not len(exits):
            return None
        far, before, _ = dijkstra(
            graph, directed=False, indices=exits, return_predecessors=True, min_only=True
        )
        total = far[entries] + np.linalg.norm(points[entries] - start, axis=1)
        k = int(entries[np.argmin(total)])
        if not np.isfinite(far[k]):
            return None
        corners = [start]
        while k >= 0:
            corners.append(points[k])
            k = int(before[k])
        return self._taut(np.array([*corners, goal]))

    def _in_sight(self, p: Array, points: Array) -> IntArray:
        away = np.linalg.norm(points - p, axis=1)
        near = np.argsort(away)[:_NEAREST]
        return np.array([k for k in near if self.clear(p, points[k])], dtype=np.int64)

    def _taut(self, corners: Array) -> Array:
        """Leave out corners that the one before sees beyond, and put the others at the last point seen."""
        out, i, last = [corners[0]], 0, len(corners) - 1
        while i < last:
            j = next(j for j in range(last, i, -1) if j == i + 1 or self.clear(out[-1], corners[j]))
            out.append(self._further(out[-1], corners[j], corners[j + 1]) if j < last else corners[j])
            i = j
        return np.array(out)

    def _further(self, start: Array, corner: Array, after: Array) -> Array:
        """Point between ``corner`` and ``after`` farthest on that ``start`` still sees."""
        low, high = 0.0, 1.0
        for _ in range(8):
            middle = 0.5 * (low + high)
            if self.clear(start, corner + middle * (after - corner)):
                low = middle
            else:
                high = middle
        return np.asarray(corner + low * (after - corner))
