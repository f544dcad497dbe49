"""Lines and convex solids: whether a segment passes through one, for sight lines of simulator and certificate alike.

| symbol | name | shape | meaning |
| --- | --- | --- | --- |
| e, d | ``start``, ``way`` | 3, 3 | the segment e + t d, 0 < t < 1, m |
| B x <= c | ``normals``, ``limits`` | (K, 3), (K,) | half-spaces of all solids, outward normals |
| | ``ptr`` | (S + 1,) | rows ``ptr[i]:ptr[i + 1]`` are those of solid i |

A segment is inside a half-space for an interval of t; it meets a solid where the intervals of all its half-spaces have
a common inner point (Cyrus and Beck 1978, Generalized two- and three-dimensional clipping).
"""

from __future__ import annotations

from camnet.geometry.triples import Triple, borrowing
from camnet.types import Array, IntArray

__all__ = ["passes_through"]

#: a segment that is inside a solid for less than this share of its length touches it
_TOUCH = 1e-9


@borrowing
def passes_through(start: Triple, way: Triple, normals: Array, limits: Array, ptr: IntArray) -> bool:
    """Whether some solid holds an inner part of the segment; one that is only touched does not count."""
    for i in range(ptr.shape[0] - 1):
        low, high = 0.0, 1.0
        for k in range(ptr[i], ptr[i + 1]):
            b0, b1, b2 = normals[k, 0], normals[k, 1], normals[k, 2]
            spare = limits[k] - (b0 * start[0] + b1 * start[1] + b2 * start[2])
            rate = b0 * way[0] + b1 * way[1] + b2 * way[2]
            if rate > 1e-15:
                high = min(high, spare / rate)
            elif rate < -1e-15:
                low = max(low, spare / rate)
            elif spare <= 0.0:  # along a face, or outside it
                high = -1.0
            if high - low <= _TOUCH:
                break
        if high - low > _TOUCH:
            return True
    return False
