"""Least distance between points, compiled: it is asked for at every sensing step."""

from __future__ import annotations

import math

from numba import njit

from camnet.types import Array

__all__ = ["least_distance"]


@njit(cache=True)
def least_distance(points: Array) -> float:
    """Smallest distance between any two of ``points`` (n, 3); inf for fewer than two."""
    least = math.inf
    for i in range(points.shape[0]):
        for j in range(i):
            square = 0.0
            for k in range(points.shape[1]):
                square += (points[i, k] - points[j, k]) ** 2
            least = min(least, square)
    return math.sqrt(least)
