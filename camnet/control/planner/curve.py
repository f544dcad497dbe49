"""C1 curve of a plan, cubic Hermite through positions and velocities, and how close it comes to obstacles.

The clearance is certified between the samples: a piece of the cubic over a time h deviates from its chord by at most
``h^2 max|x''| / 8``, x'' is linear in time, and the distance of a chord to a convex body is exact
(`camnet.control.planner.distance_kernel.segment_clearance`). Pieces that might hold the minimum are halved until both
bounds agree. A moving obstacle is at rest in its own frame, where the curve is again cubic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.compiled import cached_njit
from camnet.control.planner.distance_kernel import segment_clearance, signed_distance
from camnet.types import Array

__all__ = ["Curve", "curve_clearance"]

_STACK = 64
#: shortest piece, as a share of a step
_SHORTEST = 1e-4


@cached_njit(error_model="numpy")
def _cubic(c: Array, u: float, p: Array) -> None:
    for k in range(3):
        p[k] = c[0, k] + u * (c[1, k] + u * (c[2, k] + u * c[3, k]))


@cached_njit(error_model="numpy")
def _coefficients(x: Array, v: Array, i: int, tau: float, row: Array, c: Array) -> None:
    """Fill the polynomial (4,3) of step ``i`` over u in (0, 1), relative to the obstacle's motion."""
    for k in range(3):
        drift = row[4 + k] * tau
        x0, x1 = x[i, k] - i * drift, x[i + 1, k] - (i + 1) * drift
        v0, v1 = tau * v[i, k] - drift, tau * v[i + 1, k] - drift
        c[0, k], c[1, k] = x0, v0
        c[2, k], c[3, k] = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1


@cached_njit(error_model="numpy")
def _sag(c: Array, a: float, b: float) -> float:
    """Return the bound of the distance between the piece of ``c`` over (a, b) and its chord."""
    most = 0.0
    for u in (a, b):
        size = 0.0
        for k in range(3):
            size += (2.0 * c[2, k] + 6.0 * c[3, k] * u) ** 2
        most = max(most, size)
    return math.sqrt(most) * (b - a) ** 2 / 8.0


@cached_njit(error_model="numpy")
def curve_clearance(x: Array, v: Array, tau: float, row: Array, resolution: float) -> tuple[float, float]:
    """Smallest distance to an obstacle: a lower bound at most ``resolution`` below it, and the time (s) of the closest.

    ``x``, ``v`` (n,3) are the samples ``tau`` apart, ``row`` (19,) the obstacle.
    """
    c, p, q, normal = np.empty((4, 3)), np.empty(3), np.empty(3), np.empty(3)
    stack = np.empty((_STACK, 2))
    lowest, best, when = math.inf, math.inf, 0.0
    if not (np.isfinite(x).all() and np.isfinite(v).all()):
        return -math.inf, 0.0
    for i in range(x.shape[0] - 1):  # a first upper bound, so that far pieces are left at once
        _coefficients(x, v, i, tau, row, c)
        for j in range(2):
            _cubic(c, 0.5 * j, p)
            d = signed_distance(row, p, 0.0, normal)
            if d < best:
                best, when = d, (i + 0.5 * j) * tau
    for i in range(x.shape[0] - 1):
        _coefficients(x, v, i, tau, row, c)
        stack[0, 0], stack[0, 1] = 0.0, 1.0
        size = 1
        while size > 0:
            size -= 1
            a, b = stack[size, 0], stack[size, 1]
            middle = 0.5 * (a + b)
            _cubic(c, middle, p)
            d = signed_distance(row, p, 0.0, normal)
            if d < best:
                best, when = d, (i + middle) * tau
            _cubic(c, a, p)
            _cubic(c, b, q)
            reach = 0.5 * math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)
            sag = _sag(c, a, b)
            if d - reach - 2.0 * sag >= best:  # 1-Lipschitz: nothing here comes closer
                lowest = min(lowest, best)
                continue
            bound = segment_clearance(row, p, q, 0.0) - sag
            if bound >= best - resolution or b - a < _SHORTEST or size + 2 > _STACK:
                lowest = min(lowest, bound)
                continue
            stack[size, 0], stack[size, 1] = middle, b
            stack[size + 1, 0], stack[size + 1, 1] = a, middle
            size += 2
    return lowest, when


@dataclass(frozen=True, eq=False, slots=True)
class Curve:
    """Samples ``x``, ``v`` (n,3) every ``tau`` s, m and m/s, from time 0; between them cubic, with continuous v."""

    x: Array
    v: Array
    tau: float

    @property
    def duration_s(self) -> float:
        """Time of the last sample."""
        return self.tau * (len(self.x) - 1)

    def at(self, t_s: float) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (3,) at ``t_s``; at rest at the end afterwards."""
        if t_s >= self.duration_s:
            return self.x[-1].copy(), self.v[-1] * (t_s <= self.duration_s), np.zeros(3)
        i = min(max(int(t_s / self.tau), 0), len(self.x) - 2)
        u = t_s / self.tau - i
        c = np.empty((4, 3))
        _coefficients(self.x, self.v, i, self.tau, np.zeros(7), c)
        p = c[0] + u * (c[1] + u * (c[2] + u * c[3]))
        v = (c[1] + u * (2.0 * c[2] + 3.0 * u * c[3])) / self.tau
        return p, v, (2.0 * c[2] + 6.0 * u * c[3]) / self.tau**2

    def points(self, per_step: int) -> Array:
        """Positions (K,3) at even times, ``per_step`` a step and the end."""
        u = np.arange(per_step)[None, :, None] / per_step
        x0, x1 = self.x[:-1, None], self.x[1:, None]
        v0, v1 = self.tau * self.v[:-1, None], self.tau * self.v[1:, None]
        c2, c3 = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
        return np.concatenate([(x0 + u * (v0 + u * (c2 + u * c3))).reshape(-1, 3), self.x[-1:]])

    def fastest(self) -> tuple[float, float]:
        """Return the largest speed (at ten times a step) and the largest acceleration of the curve."""
        u = np.arange(11)[None, :, None] / 10.0
        x0, x1 = self.x[:-1, None], self.x[1:, None]
        v0, v1 = self.tau * self.v[:-1, None], self.tau * self.v[1:, None]
        c2, c3 = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
        speed = np.linalg.norm(v0 + u * (2.0 * c2 + 3.0 * u * c3), axis=-1) / self.tau
        size = np.linalg.norm(2.0 * c2 + 6.0 * c3 * u[:, [0, -1]], axis=-1) / self.tau**2
        return float(speed.max()), float(size.max())

    def clearance(self, rows: Array, resolution_m: float = 0.01) -> tuple[Array, Array]:
        """Certified distances (K,) to the obstacles ``rows`` (K,19), and the times (K,) of the closest points."""
        out = [curve_clearance(self.x, self.v, self.tau, row, resolution_m) for row in rows]
        both = np.array(out).reshape(-1, 2)
        return both[:, 0], both[:, 1]
