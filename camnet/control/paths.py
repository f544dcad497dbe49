"""Ways around reflex corners of a polygonal region: shortest paths on its visibility graph.

The corners of shortest paths among polygons are reflex vertices (T. Lozano-Perez, M. A. Wesley, "An algorithm for
planning collision-free paths among polyhedral obstacles", CACM 1979). In the region shrunk by the margin a corner
becomes an arc; two points just beyond it, each in sight along one of the edges, stand for it.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse.csgraph import shortest_path

from camnet.control.reference_kernel import segment_inside
from camnet.types import Array

__all__ = ["Paths", "PlanarBounds"]

#: corners are passed this much farther in than the margin asks
_BEYOND = 1.005


class PlanarBounds(Protocol):
    """The part of `camnet.control.references.RegionBounds` that is used here."""

    @property
    def planes(self) -> Array:
        """Half-spaces (F,4)."""
        ...

    @property
    def disc(self) -> Array:
        """Disc (3,)."""
        ...

    @property
    def polygon(self) -> Array:
        """Polygon (K,2), counter-clockwise."""
        ...


class Paths:
    """Shortest paths inside a prism; ``bounds`` is a `camnet.control.references.RegionBounds`."""

    def __init__(self, bounds: PlanarBounds, margin_m: float) -> None:
        self._bounds, self._margin = bounds, margin_m
        self._nodes = self._reflex_points(bounds.polygon)
        n = len(self._nodes)
        cost = np.full((n, n), np.inf)
        for i in range(n):
            for j in range(i):
                if self._visible(self._nodes[i], self._nodes[j]):
                    cost[i, j] = cost[j, i] = np.linalg.norm(self._nodes[i] - self._nodes[j])
        self._cost = shortest_path(cost) if n else cost

    def _reflex_points(self, polygon: Array) -> Array:
        """Two points beside every reflex corner, on the two moved edges; the line between them touches the arc."""
        into = polygon - np.roll(polygon, 1, axis=0)
        out = np.roll(polygon, -1, axis=0) - polygon
        into /= np.linalg.norm(into, axis=1, keepdims=True)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
        turn = np.arctan2(-cross, np.sum(into * out, axis=1))  # positive at reflex corners
        ahead = np.tan(0.25 * turn)[:, None]
        left = [np.column_stack([-e[:, 1], e[:, 0]]) for e in (into, out)]
        size = _BEYOND * max(self._margin, 0.01)
        first, second = polygon + size * (left[0] + ahead * into), polygon + size * (left[1] - ahead * out)
        return np.concatenate([first[turn > 1e-9], second[turn > 1e-9]])

    def _visible(self, a: Array, b: Array) -> bool:
        region = self._bounds
        start, end = np.array([*a[:2], 0.0]), np.array([*b[:2], 0.0])
        no_planes = region.planes[:0]
        return bool(segment_inside(start, end, self._margin, no_planes, region.disc, region.polygon))

    def next_point(self, p: Array, goal: Array) -> Array:
        """Where to head (3,) from ``p`` (3,) to reach ``goal`` (3,): the goal itself when the way is free."""
        if len(self._nodes) == 0 or self._visible(p, goal):
            return goal
        first = np.array([self._visible(p, node) for node in self._nodes])
        last = np.array([self._visible(goal, node) for node in self._nodes])
        to_first = np.where(first, np.linalg.norm(self._nodes - p[:2], axis=1), np.inf)
        to_last = np.where(last, np.linalg.norm(self._nodes - goal[:2], axis=1), np.inf)
        through = to_first[:, None] + self._cost + to_last[None, :]
        i, _ = np.unravel_index(int(np.argmin(through)), through.shape)
        if not np.isfinite(through.min()):
            return goal
        # beyond the corner it is passed at speed; heights are reached on the way
        return np.array([*self._nodes[i], goal[2]])
