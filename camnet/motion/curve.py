"""Closed smooth curves through points: periodic cubic splines with nearest points and curvature.

| symbol | name | unit |
| --- | --- | --- |
| u | parameter: length of the chords from point to point | m |
| c(u) | point on the curve | m |
| phi | direction of the tangent | rad |
| kappa | curvature, positive to the left | 1/m |
| d | lateral offset of a point, positive to the left of the curve | m |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["ClosedCurve", "frame_at", "nearest_parameter", "refine_parameter"]

_SAMPLES_PER_PIECE = 24
_NEWTON_STEPS = 4


@dataclass(frozen=True, eq=False, slots=True)
class ClosedCurve:
    """A periodic cubic spline, twice continuously differentiable.

    Attributes
    ----------
    knots : (n+1,) parameter u at the points, from 0 to the period
    coefficients : (n, 2, 4) of x and y in each piece, lowest power first, about the piece's first knot
    samples, sample_u : (m, 2), (m,) points all along the curve, to find the nearest
    """

    knots: Array
    coefficients: Array
    samples: Array
    sample_u: Array

    @classmethod
    def through(cls, points: ArrayLike) -> ClosedCurve:
        """Fit the curve through (n, 2) distinct points in their order; the last joins the first."""
        closed = np.asarray(points, dtype=np.float64)
        closed = np.vstack([closed, closed[:1]])
        knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
        spline = CubicSpline(knots, closed, bc_type="periodic")
        coefficients = np.ascontiguousarray(spline.c[::-1].transpose(1, 2, 0))
        fractions = np.arange(_SAMPLES_PER_PIECE) / _SAMPLES_PER_PIECE
        sample_u = (knots[:-1, None] + fractions * np.diff(knots)[:, None]).ravel()
        return cls(knots, coefficients, np.ascontiguousarray(spline(sample_u)), sample_u)

    @property
    def period(self) -> float:
        """Value of u at which the curve is back at its beginning, m."""
        return float(self.knots[-1])

    def nearest(self, x: float, y: float) -> float:
        """Return the parameter u of the point nearest to (x, y)."""
        return float(nearest_parameter(x, y, self.knots, self.coefficients, self.samples, self.sample_u))

    def frame(self, u: float) -> tuple[float, float, float, float]:
        """Return x, y, tangent direction (rad) and curvature (1/m) at ``u`` in [0, period]."""
        x, y, phi, kappa = frame_at(u, self.knots, self.coefficients)
        return float(x), float(y), float(phi), float(kappa)

    def length(self) -> float:
        """Return the length once around, m (by the dense samples; short by less than one part in a thousand)."""
        closed = np.vstack([self.samples, self.samples[:1]])
        return float(np.linalg.norm(np.diff(closed, axis=0), axis=1).sum())


@cached_njit
def _derivatives(
    u: float, knots: Array, coefficients: Array
) -> tuple[float, float, float, float, float, float]:
    """x, y and their first and second derivatives by u."""
    piece = min(max(np.searchsorted(knots, u, side="right") - 1, 0), coefficients.shape[0] - 1)
    h = u - knots[piece]
    a, b = coefficients[piece, 0], coefficients[piece, 1]
    return (
        a[0] + h * (a[1] + h * (a[2] + h * a[3])),
        b[0] + h * (b[1] + h * (b[2] + h * b[3])),
        a[1] + h * (2.0 * a[2] + 3.0 * h * a[3]),
        b[1] + h * (2.0 * b[2] + 3.0 * h * b[3]),
        2.0 * a[2] + 6.0 * h * a[3],
        2.0 * b[2] + 6.0 * h * b[3],
    )


@cached_njit
def nearest_parameter(
    x: float, y: float, knots: Array, coefficients: Array, samples: Array, sample_u: Array
) -> float:
    """Parameter u of the nearest point of the curve: the nearest sample, then `refine_parameter`."""
    best, least = 0, np.inf
    for k in range(samples.shape[0]):
        dx, dy = samples[k, 0] - x, samples[k, 1] - y
        square = dx * dx + dy * dy
        if square < least:
            best, least = k, square
    return refine_parameter(float(sample_u[best]), x, y, knots, coefficients)


@cached_njit
def refine_parameter(u: float, x: float, y: float, knots: Array, coefficients: Array) -> float:
    """Parameter of the nearest point of the curve, from one nearby: Newton on ``(c - p) . c' = 0``."""
    period = float(knots[-1])
    for _ in range(_NEWTON_STEPS):
        cx, cy, dx, dy, ddx, ddy = _derivatives(u, knots, coefficients)
        slope = dx * dx + dy * dy + (cx - x) * ddx + (cy - y) * ddy
        if slope <= 0.0:  # beyond the centre of curvature: the sample is as near as it gets
            break
        u = (u - ((cx - x) * dx + (cy - y) * dy) / slope) % period
    return u


@cached_njit
def frame_at(u: float, knots: Array, coefficients: Array) -> tuple[float, float, float, float]:
    """x, y, tangent direction phi and curvature kappa at ``u``."""
    x, y, dx, dy, ddx, ddy = _derivatives(u, knots, coefficients)
    speed = math.sqrt(dx * dx + dy * dy)
    return x, y, math.atan2(dy, dx), (dx * ddy - dy * ddx) / speed**3
