"""Centre lines in the ground plane by arc length, as drawn: straight segments between points.

``smooth_road`` has curves that a robot can follow, ``road_graph`` joins lines to networks.

| name | meaning |
| --- | --- |
| ``s`` | arc length from the first point, m; taken modulo the length on closed lines, clipped on open ones |
| ``lateral`` | signed distance from the line, m, positive to the left of the direction of travel |
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from camnet.compiled import cached_njit
from camnet.errors import WorldError
from camnet.geometry.settings import Road
from camnet.types import Array

__all__ = ["Polyline", "waypoints"]


def waypoints(points_m: ArrayLike, closed: bool, name: str) -> Array:
    """Points (K, 2) of a line without repetitions; the first is repeated at the end of a closed one.

    Raises
    ------
    WorldError
        With fewer than two (closed: three) different points, or numbers that are not finite.
    """
    points = np.array(points_m, dtype=np.float64).reshape(-1, 2)
    if closed and len(points) > 1 and np.array_equal(points[0], points[-1]):
        points = points[:-1]
    different = points[np.append(True, np.any(points[1:] != points[:-1], axis=1))]
    least = 3 if closed else 2
    if len(different) < least:
        kind = "closed" if closed else "open"
        raise WorldError(
            f"road '{name}': points_m {points.tolist()}; "
            f"a road that is {kind} needs at least {least} different points"
        )
    if not np.all(np.isfinite(different)):
        raise WorldError(f"road '{name}': points_m {points.tolist()} must be finite numbers")
    return np.vstack([different, different[:1]]) if closed else different


@cached_njit
def _project(points: Array, line: Array, arc: Array) -> tuple[Array, Array]:
    count = points.shape[0]
    s, lateral = np.empty(count), np.empty(count)
    for k in range(count):
        best = math.inf
        for i in range(line.shape[0] - 1):
            ex, ey = line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1]
            dx, dy = points[k, 0] - line[i, 0], points[k, 1] - line[i, 1]
            length = arc[i + 1] - arc[i]
            t = min(1.0, max(0.0, (dx * ex + dy * ey) / (length * length)))
            rx, ry = dx - t * ex, dy - t * ey
            d2 = rx * rx + ry * ry
            if d2 < best:
                best = d2
                s[k] = arc[i] + t * length
                lateral[k] = math.copysign(math.sqrt(d2), ex * dy - ey * dx)
    return s, lateral


class Polyline:
    """Straight segments between points (K, 2), closed or open.

    Attributes
    ----------
    points : (K, 2) vertices; on a closed line the first is repeated at the end
    arc : (K,) arc length at the vertices
    length : total length, m

    Raises
    ------
    WorldError
        With fewer than two (closed: three) different points.
    """

    def __init__(self, points_m: ArrayLike, closed: bool = False, name: str = "") -> None:
        self.name, self.closed = name, closed
        self.points: Array = waypoints(points_m, closed, name)
        steps = np.diff(self.points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self.arc: Array = np.append(0.0, np.cumsum(lengths))
        self.length = float(self.arc[-1])
        self._directions: Array = steps / lengths[:, None]
        for array in (self.points, self.arc, self._directions):
            array.setflags(write=False)

    @classmethod
    def from_settings(cls, road: Road) -> Polyline:
        """Centre line of a road as drawn."""
        return cls(road.points_m, road.closed, road.name)

    def _wrap(self, s: ArrayLike) -> Array:
        s = np.asarray(s, dtype=np.float64)
        return np.asarray(np.mod(s, self.length) if self.closed else np.clip(s, 0.0, self.length))

    def _segment(self, s: Array) -> Array:
        return np.clip(np.searchsorted(self.arc, s, side="right") - 1, 0, len(self._directions) - 1)

    def point(self, s: ArrayLike) -> Array:
        """Points (..., 2) at arc lengths (...,)."""
        s = self._wrap(s)
        i = self._segment(s)
        return np.asarray(self.points[i] + (s - self.arc[i])[..., None] * self._directions[i])

    def tangent(self, s: ArrayLike) -> Array:
        """Directions of travel (..., 2), unit vectors, at arc lengths (...,); at a vertex that of the segment ahead."""
        return np.asarray(self._directions[self._segment(self._wrap(s))])

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Arc length and lateral offset (...,), (...,) of the nearest point of the line to points (..., 2)."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        s, lateral = _project(p.reshape(-1, p.shape[-1]), self.points, self.arc)
        return self._wrap(s).reshape(p.shape[:-1]), lateral.reshape(p.shape[:-1])
