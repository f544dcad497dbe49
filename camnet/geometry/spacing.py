"""Least distance between points and membership in boxes, compiled: asked for at every sensing step."""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray

__all__ = ["in_boxes", "least_distance"]


@cached_njit
def in_boxes(points: Array, low: Array, high: Array) -> BoolArray:
    """Whether ``points`` (K, 3) lie in boxes with lowest corners ``low`` (C, 3), highest ``high`` (C, 3): (K, C)."""
    out = np.empty((points.shape[0], low.shape[0]), dtype=np.bool_)
    for k in range(points.shape[0]):
        for c in range(low.shape[0]):
            inside = True
            for i in range(3):
                inside = inside and low[c, i] <= points[k, i] <= high[c, i]
            out[k, c] = inside
    return out


@cached_njit
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
