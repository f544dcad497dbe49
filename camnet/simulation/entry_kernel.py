"""Compiled twin of `camnet.simulation.entries.first_entry` (its test oracle) for regions that are boxes."""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, IntArray

__all__ = ["ENTERS", "TOUCHES", "box_entries"]

#: what a path does to a region, besides nothing (0)
TOUCHES, ENTERS = 1, 2


@cached_njit
def _distance(x: float, y: float, z: float, low: Array, high: Array) -> float:
    """Signed distance to a box, negative inside."""
    a, b, c = max(low[0] - x, x - high[0]), max(low[1] - y, y - high[1]), max(low[2] - z, z - high[2])
    inner = max(a, b, c)
    if inner <= 0.0:
        return float(inner)
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return math.sqrt(a * a + b * b + c * c)


@cached_njit
def box_entries(p: Array, radius: Array, low: Array, high: Array) -> IntArray:
    """How (0 not at all) and at which step a path (K,3) with error radii (K,) first meets boxes (C,3), (C,3): (C,2).

    Heights are moved into a box's range by no more than the error radius.
    """
    out = np.zeros((low.shape[0], 2), dtype=np.int64)
    for c in range(low.shape[0]):
        nearest = math.inf
        for k in range(p.shape[0]):
            rise = min(max(p[k, 2], low[c, 2]), high[c, 2]) - p[k, 2]
            z = p[k, 2] + min(max(rise, -radius[k]), radius[k])
            distance = _distance(p[k, 0], p[k, 1], z, low[c], high[c])
            if distance <= 0.0:
                out[c, 0], out[c, 1] = (ENTERS if k > 0 else 0), k
                break
            if distance <= radius[k] and distance < nearest:
                nearest = distance
                out[c, 0], out[c, 1] = TOUCHES, k
    return out
