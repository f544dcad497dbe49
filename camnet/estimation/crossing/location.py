"""One place for many votes: the mode, the geometric median or the mean of weighted points in the plane.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| x_k | ``points`` | (n, 2) | m |
| w_k | ``weights`` | (n,) | |
| h | ``width_m`` | - | m |

- mean: argmin sum w |x - x_k|^2
- geometric median: argmin sum w |x - x_k| (Weiszfeld's iteration, smoothed by 0.5 m as Vardi and Zhang 2000 discuss)
- mode: argmax sum w exp(-|x - x_k|^2 / (2 h^2)) (mean shift, Comaniciu and Meer 2002, from the best vote)

The mean of two groups of votes lies between them, where nobody is; the median of errors is least where half of the
votes are nearest, which the mode of a width like that error finds.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["geometric_median", "mode", "weighted_mean"]

_SMOOTHING_M2 = 0.25
_ITERATIONS = 100
_TOLERANCE_M = 1e-4


@cached_njit
def weighted_mean(points: Array, weights: Array) -> Array:
    """Mean (2,)."""
    total = 0.0
    out = np.zeros(2)
    for k in range(len(points)):
        total += weights[k]
        out += weights[k] * points[k]
    out /= total
    return out


@cached_njit
def geometric_median(points: Array, weights: Array) -> Array:
    """Geometric median (2,)."""
    x = weighted_mean(points, weights)
    for _ in range(_ITERATIONS):
        total = 0.0
        new = np.zeros(2)
        for k in range(len(points)):
            gap = points[k] - x
            pull = weights[k] / np.sqrt(gap[0] ** 2 + gap[1] ** 2 + _SMOOTHING_M2)
            total += pull
            new += pull * points[k]
        new /= total
        moved = abs(new[0] - x[0]) + abs(new[1] - x[1])
        x = new
        if moved < _TOLERANCE_M:
            break
    return x


@cached_njit
def _density(points: Array, weights: Array, x: Array, width_m: float) -> float:
    total = 0.0
    for k in range(len(points)):
        gap2 = (points[k, 0] - x[0]) ** 2 + (points[k, 1] - x[1]) ** 2
        total += weights[k] * np.exp(-0.5 * gap2 / width_m**2)
    return total


@cached_njit
def mode(points: Array, weights: Array, width_m: float) -> Array:
    """Mode (2,) of the kernel density: mean shift from the vote, or geometric median, where the density is largest."""
    x = geometric_median(points, weights)
    best = _density(points, weights, x, width_m)
    for k in range(len(points)):
        density = _density(points, weights, points[k], width_m)
        if density > best:
            best = density
            x = points[k].copy()
    for _ in range(_ITERATIONS):
        total = 0.0
        new = np.zeros(2)
        for k in range(len(points)):
            gap2 = (points[k, 0] - x[0]) ** 2 + (points[k, 1] - x[1]) ** 2
            pull = weights[k] * np.exp(-0.5 * gap2 / width_m**2)
            total += pull
            new += pull * points[k]
        new /= total
        moved = abs(new[0] - x[0]) + abs(new[1] - x[1])
        x = new
        if moved < _TOLERANCE_M:
            break
    return x
