r"""Compiled bounds of a planar Gaussian field's logarithmic norm over a disc; see ``growth`` for the derivation.

| symbol | name | shape | meaning |
| --- | --- | --- | --- |
| mu_k, P_k, w_k | ``centres``, ``precision``, ``weights`` | (p, 2), (p, 2, 2), (p, 2) | kernels, learned velocities |
| sqrt(lambda_max(P_k)) | ``scale`` | (p,) | 1/m, steepness of kernel k |
| S = (J + J^T)/2 | components ``sxx, sxy, syy`` | | symmetric part of the Jacobian |
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["cell_bounds", "disc_supremum", "third_derivative_bound"]

#: max of exp(-r^2/2) m(r) over all r and over r >= 2 (rounded up), and where they are attained (rounded inward)
_PEAK, _PEAK_AT = 1.3802, 0.7419
_TAIL_PEAK, _TAIL_PEAK_AT = 0.3750, 2.3345
#: children of a divided square, as multiples of half its half-side
_SIGNS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])


@cached_njit
def third_derivative_bound(r: float) -> float:
    """Upper bound of the third directional derivative of exp(-|u|^2/2) over all |u| >= r."""
    if r <= _PEAK_AT:
        return _PEAK
    m = 3.0 * r - r**3 if r <= 1.0 else max(2.0, r**3 - 3.0 * r)
    value = math.exp(-0.5 * r * r) * m
    return value if r > _TAIL_PEAK_AT else max(value, _TAIL_PEAK)


@cached_njit
def _lambda_max(xx: float, xy: float, yy: float) -> float:
    return 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)


@cached_njit
def _norm(xx: float, xy: float, yy: float) -> float:
    return abs(0.5 * (xx + yy)) + math.hypot(0.5 * (xx - yy), xy)


@cached_njit
def cell_bounds(
    cx: float, cy: float, rho: float, centres: Array, precision: Array, weights: Array, scale: Array
) -> tuple[float, float]:
    """Return lambda_max(S) at (cx, cy) and an upper bound of it over the disc of radius ``rho``."""
    sxx = sxy = syy = 0.0
    axx = axy = ayy = 0.0  # DS in direction x
    bxx = bxy = byy = 0.0  # DS in direction y
    curvature = 0.0
    for k in range(centres.shape[0]):
        dx, dy = cx - centres[k, 0], cy - centres[k, 1]
        p00, p01, p11 = precision[k, 0, 0], precision[k, 0, 1], precision[k, 1, 1]
        gx, gy = p00 * dx + p01 * dy, p01 * dx + p11 * dy  # P d
        u2 = gx * dx + gy * dy
        wx, wy = weights[k, 0], weights[k, 1]
        near = max(0.0, math.sqrt(max(u2, 0.0)) - scale[k] * rho)
        curvature += math.hypot(wx, wy) * scale[k] ** 3 * third_derivative_bound(near)
        g = math.exp(-0.5 * u2)
        sxx -= g * wx * gx
        sxy -= 0.5 * g * (wx * gy + wy * gx)
        syy -= g * wy * gy
        hxx, hxy, hyy = g * (gx * gx - p00), g * (gx * gy - p01), g * (gy * gy - p11)
        axx += wx * hxx
        axy += 0.5 * (wx * hxy + wy * hxx)
        ayy += wy * hxy
        bxx += wx * hxy
        bxy += 0.5 * (wx * hyy + wy * hxy)
        byy += wy * hyy
    at_centre = _lambda_max(sxx, sxy, syy)
    slope = math.hypot(_norm(axx, axy, ayy), _norm(bxx, bxy, byy))
    return at_centre, at_centre + rho * slope + 0.5 * rho * rho * curvature


@cached_njit
def disc_supremum(
    cx: float,
    cy: float,
    radius: float,
    centres: Array,
    precision: Array,
    weights: Array,
    scale: Array,
    tolerance: float,
    max_cells: int,
) -> tuple[float, float, int]:
    """Bound sup lambda_max(S) over a disc by branch and bound: (upper, lower, cells looked at)."""
    lower, upper = cell_bounds(cx, cy, radius, centres, precision, weights, scale)
    if radius <= 0.0 or upper <= lower + tolerance:
        return upper, lower, 1
    cells = 1
    heap = [(-upper, cx, cy, radius)]  # the square of the largest bound is divided next
    while cells < max_cells:
        bound, x, y, half = heapq.heappop(heap)
        if -bound <= lower + tolerance:
            return max(-bound, lower), lower, cells
        half *= 0.5
        rho = half * math.sqrt(2.0)
        for i in range(4):
            nx, ny = x + half * _SIGNS[i, 0], y + half * _SIGNS[i, 1]
            if math.hypot(max(0.0, abs(nx - cx) - half), max(0.0, abs(ny - cy) - half)) > radius:
                continue
            cells += 1
            value, above = cell_bounds(nx, ny, rho, centres, precision, weights, scale)
            if math.hypot(nx - cx, ny - cy) <= radius:
                lower = max(lower, value)
            heapq.heappush(heap, (-min(above, -bound), nx, ny, half))
    return max(-heap[0][0], lower), lower, cells
