"""Roads as twice continuously differentiable curves by arc length.

A cubic spline through the points (periodic on closed roads, natural at open ends; parameter: length of the chords) is
sampled at equal arc lengths, and a second spline through the samples is the road. So position, direction and
curvature are continuous in s, and ``|dr/ds| = 1`` up to the error of the second spline. Its knots are equally
spaced, so the piece that belongs to s is found by a division.

| symbol | meaning |
| --- | --- |
| ``s``, ``lateral`` | as in ``roads`` |
| ``r(s)`` | point: ``c[0,i] x^3 + c[1,i] x^2 + c[2,i] x + c[3,i]`` with ``i = floor(s / h)``, ``x = s - i h`` |
"""

from __future__ import annotations

import itertools
import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from camnet.compiled import cached_njit
from camnet.errors import WorldError
from camnet.geometry.roads import waypoints
from camnet.geometry.settings import Road
from camnet.types import Array

__all__ = ["SmoothRoad"]

#: knots of the second spline: as many per metre of chord, per waypoint, and in all, at least
_PER_M, _PER_WAYPOINT, _LEAST = 10.0, 24, 200
_NEWTON_STEPS = 20


@cached_njit
def _evaluate(s: float, c: Array, h: float) -> tuple[float, float, float, float, float, float]:
    """Position, first and second derivative at arc length s in [0, length]."""
    i = min(int(s / h), c.shape[1] - 1)
    x = s - i * h
    px = ((c[0, i, 0] * x + c[1, i, 0]) * x + c[2, i, 0]) * x + c[3, i, 0]
    py = ((c[0, i, 1] * x + c[1, i, 1]) * x + c[2, i, 1]) * x + c[3, i, 1]
    vx = (3.0 * c[0, i, 0] * x + 2.0 * c[1, i, 0]) * x + c[2, i, 0]
    vy = (3.0 * c[0, i, 1] * x + 2.0 * c[1, i, 1]) * x + c[2, i, 1]
    return px, py, vx, vy, 6.0 * c[0, i, 0] * x + 2.0 * c[1, i, 0], 6.0 * c[0, i, 1] * x + 2.0 * c[1, i, 1]


@cached_njit
def _wrap(s: float, length: float, closed: bool) -> float:
    return s - length * math.floor(s / length) if closed else min(length, max(0.0, s))


@cached_njit
def _sample(s: Array, c: Array, h: float, closed: bool) -> Array:
    """Position, first and second derivative (K, 6) at arc lengths (K,)."""
    out = np.empty((s.shape[0], 6))
    length = h * c.shape[1]
    for k in range(s.shape[0]):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4], out[k, 5] = _evaluate(
            _wrap(s[k], length, closed), c, h
        )
    return out


@cached_njit
def _project(points: Array, c: Array, h: float, closed: bool) -> tuple[Array, Array]:
    """Arc length and lateral offset (K,), (K,) of the nearest points of the curve to points (K, 2)."""
    count, knots = points.shape[0], c.shape[1]
    length = h * knots
    s_out, lateral = np.empty(count), np.empty(count)
    for k in range(count):
        x, y = points[k, 0], points[k, 1]
        # the nearest knot, then Newton on (r(s) - p) . r'(s) = 0 within a knot's distance of it
        best, start = (c[3, 0, 0] - x) ** 2 + (c[3, 0, 1] - y) ** 2, 0
        for i in range(1, knots):
            d2 = (c[3, i, 0] - x) ** 2 + (c[3, i, 1] - y) ** 2
            if d2 < best:
                best, start = d2, i
        if not closed:
            ex, ey, _, _, _, _ = _evaluate(length, c, h)
            if (ex - x) ** 2 + (ey - y) ** 2 < best:
                start = knots
        low, high = (start - 1) * h, (start + 1) * h
        if not closed:
            low, high = max(low, 0.0), min(high, length)
        s = start * h
        for _ in range(_NEWTON_STEPS):
            px, py, vx, vy, ax, ay = _evaluate(_wrap(s, length, closed), c, h)
            slope = (px - x) * vx + (py - y) * vy
            bend = vx * vx + vy * vy + (px - x) * ax + (py - y) * ay
            # beyond the centre of curvature the distance is not convex: go downhill by whole steps there
            step = slope / bend if bend > 1e-3 else math.copysign(0.5 * h, slope)
            moved = min(high, max(low, s - step))
            if abs(moved - s) < 1e-13 * length:
                break
            s = moved
        s = _wrap(s, length, closed)
        px, py, vx, vy, _, _ = _evaluate(s, c, h)
        s_out[k] = s
        lateral[k] = math.copysign(math.hypot(x - px, y - py), vx * (y - py) - vy * (x - px))
    return s_out, lateral


class SmoothRoad:
    """Twice continuously differentiable curve through points (K, 2), closed or open.

    Attributes
    ----------
    points : (K, 2) the points the curve goes through; on a closed road the first is repeated at the end
    waypoint_arc : (K,) arc length at the points
    length : total length, m

    Raises
    ------
    WorldError
        With fewer than two (closed: three) different points, or points between which the curve stands still.
    """

    def __init__(self, points_m: ArrayLike, closed: bool = False, name: str = "") -> None:
        self.name, self.closed = name, closed
        self.points: Array = waypoints(points_m, closed, name)
        ends: Literal["periodic", "natural"] = "periodic" if closed else "natural"
        chords = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))
        raw = CubicSpline(chords, self.points, bc_type=ends)
        knots = max(_LEAST, math.ceil(_PER_M * chords[-1]), _PER_WAYPOINT * (len(chords) - 1))
        # arc length of the raw curve on a fine grid in which every waypoint is a node
        per_span = 2 * math.ceil(2 * knots / (len(chords) - 1))
        spans = [np.linspace(a, b, per_span, endpoint=False) for a, b in itertools.pairwise(chords)]
        u = np.concatenate([*spans, chords[-1:]])
        speed = np.linalg.norm(raw(u, 1), axis=1)
        if not np.all(speed > 1e-3):
            raise WorldError(
                f"road '{name}': points_m {self.points.tolist()} turn back on themselves; "
                "add points around the turn"
            )
        arc = np.append(0.0, cumulative_simpson(speed, x=u))
        self.length = float(arc[-1])
        self.waypoint_arc: Array = arc[::per_span].copy()
        s = np.linspace(0.0, self.length, knots + 1)
        nodes = raw(CubicSpline(arc, u)(s))
        nodes[-1] = nodes[0] if closed else self.points[-1]
        self._c: Array = np.ascontiguousarray(CubicSpline(s, nodes, bc_type=ends).c)
        self._h = self.length / knots
        for array in (self.points, self.waypoint_arc, self._c):
            array.setflags(write=False)

    @classmethod
    def from_settings(cls, road: Road) -> SmoothRoad:
        """Smooth curve through the points of a road."""
        return cls(road.points_m, road.closed, road.name)

    def derivatives(self, s: ArrayLike) -> tuple[Array, Array, Array]:
        """Position, first and second derivative by arc length, each (..., 2), at arc lengths (...,)."""
        at = np.asarray(s, dtype=np.float64)
        out = _sample(at.reshape(-1), self._c, self._h, self.closed).reshape((*at.shape, 6))
        return out[..., 0:2], out[..., 2:4], out[..., 4:6]

    def point(self, s: ArrayLike) -> Array:
        """Points (..., 2) at arc lengths (...,)."""
        return self.derivatives(s)[0]

    def tangent(self, s: ArrayLike) -> Array:
        """Directions of travel (..., 2), unit vectors, at arc lengths (...,)."""
        d = self.derivatives(s)[1]
        return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))

    def curvature(self, s: ArrayLike) -> Array:
        """Curvature (...,) in 1/m at arc lengths (...,), positive in left turns."""
        _, d1, d2 = self.derivatives(s)
        cross = d1[..., 0] * d2[..., 1] - d1[..., 1] * d2[..., 0]
        return np.asarray(cross / np.linalg.norm(d1, axis=-1) ** 3)

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Arc length and lateral offset (...,), (...,) of the nearest point of the curve to points (..., 2)."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        s, lateral = _project(p.reshape(-1, p.shape[-1]), self._c, self._h, self.closed)
        return s.reshape(p.shape[:-1]), lateral.reshape(p.shape[:-1])
