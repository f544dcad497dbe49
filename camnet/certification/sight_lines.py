r"""Which cameras see a target at given poses: its feature points, frusta and solids, exactly as the simulator asks.

| symbol | name | shape | meaning |
| --- | --- | --- | --- |
| p_k | ``points`` | (n, F, 3) | feature points of the target at n poses, m |
| A x <= b | ``normals``, ``offsets`` | (C, H, 3), (C, H) | frusta in the world, outward unit normals |
| e | ``eyes`` | (C, 3) | optical centres, m |
| B x <= c | ``solids`` | | convex parts of occluders |

A target is seen when all its points are in the frustum (``camnet.sensing.visibility``) and no solid meets the open
line of sight to any of them. The line e + t (p - e), 0 < t < 1, meets a convex solid where the intervals of all its
half-spaces have a common inner point; a camera mounted on a wall touches the wall at t = 0 only, and sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Views
from camnet.compiled import cached_njit
from camnet.geometry.solid_lines import passes_through
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Solids", "seen_by", "seen_pairs", "sight_blocked"]


@dataclass(frozen=True, eq=False)
class Solids:
    """Convex solids as one list of half-spaces: those of solid i are rows ``ptr[i]:ptr[i + 1]``."""

    normals: Array
    limits: Array
    ptr: IntArray

    @classmethod
    def of(cls, parts: Sequence[tuple[Array, Array]]) -> Solids:
        """Take solids (B, c), B x <= c."""
        ptr = np.cumsum([0, *(len(c) for _, c in parts)]).astype(np.int64)
        if not parts:
            return cls(np.zeros((0, 3)), np.zeros(0), ptr)
        return cls(
            np.ascontiguousarray(np.concatenate([a for a, _ in parts]), dtype=float),
            np.ascontiguousarray(np.concatenate([c for _, c in parts]), dtype=float),
            ptr,
        )

    def grown(self, by_m: float) -> Solids:
        """Return solids whose faces are moved outwards by ``by_m``, m; inwards where it is negative."""
        return Solids(self.normals, self.limits + by_m, self.ptr)


def seen_by(points: Array, views: Views, solids: Solids) -> BoolArray:
    """Return whether each camera sees all feature points, (n, C), of targets with points (n, F, 3), m."""
    points = np.ascontiguousarray(points, dtype=float)
    return np.asarray(_seen_by(points, *_packed(views), solids.normals, solids.limits, solids.ptr))


def seen_pairs(points: Array, camera: IntArray, views: Views, solids: Solids) -> BoolArray:
    """Return whether camera k (n,) sees all feature points (n, F, 3) of target k, (n,)."""
    points = np.ascontiguousarray(points, dtype=float)
    camera = np.ascontiguousarray(camera)
    a, b, _, eyes = _packed(views)
    return np.asarray(_seen_pairs(points, camera, a, b, eyes, solids.normals, solids.limits, solids.ptr))


def _packed(views: Views) -> tuple[Array, Array, Array, Array]:
    parts = (views.normals, views.offsets, views.bounds_xy, views.position)
    a, b, bounds, eyes = (np.ascontiguousarray(part, dtype=float) for part in parts)
    return a, b, bounds, eyes


def sight_blocked(eyes: Array, points: Array, solids: Solids) -> BoolArray:
    """Return whether a solid meets the line of sight from each eye (n, 3) to each point (n, 3), (n,)."""
    eyes, points = np.broadcast_arrays(np.asarray(eyes, dtype=float), np.asarray(points, dtype=float))
    return np.asarray(
        _blocked_rows(
            np.ascontiguousarray(eyes),
            np.ascontiguousarray(points),
            solids.normals,
            solids.limits,
            solids.ptr,
        )
    )


@cached_njit
def _blocked(e: Array, p: Array, normals: Array, limits: Array, ptr: IntArray) -> bool:
    """Whether some solid holds an inner part of the line from e to p."""
    way = (p[0] - e[0], p[1] - e[1], p[2] - e[2])
    return bool(passes_through((e[0], e[1], e[2]), way, normals, limits, ptr))


@cached_njit
def _blocked_rows(eyes: Array, points: Array, normals: Array, limits: Array, ptr: IntArray) -> BoolArray:
    out = np.empty(len(eyes), dtype=np.bool_)
    for n in range(len(eyes)):
        out[n] = _blocked(eyes[n], points[n], normals, limits, ptr)
    return out


@cached_njit
def _sees(
    points: Array, a: Array, b: Array, eye: Array, normals: Array, limits: Array, ptr: IntArray
) -> bool:
    """Whether one camera sees all points (F, 3)."""
    for f in range(points.shape[0]):
        for k in range(a.shape[0]):
            if a[k, 0] * points[f, 0] + a[k, 1] * points[f, 1] + a[k, 2] * points[f, 2] > b[k]:
                return False
    for f in range(points.shape[0]):  # noqa: SIM110 - Numba compiles no generator expressions
        if _blocked(eye, points[f], normals, limits, ptr):
            return False
    return True


@cached_njit
def _seen_by(
    points: Array,
    a: Array,
    b: Array,
    bounds: Array,
    eyes: Array,
    normals: Array,
    limits: Array,
    ptr: IntArray,
) -> BoolArray:
    out = np.zeros((points.shape[0], a.shape[0]), dtype=np.bool_)
    for n in range(points.shape[0]):
        x, y = points[n, 0, 0], points[n, 0, 1]
        for c in range(a.shape[0]):  # most cameras are far away
            if bounds[c, 0] <= x <= bounds[c, 2] and bounds[c, 1] <= y <= bounds[c, 3]:
                out[n, c] = _sees(points[n], a[c], b[c], eyes[c], normals, limits, ptr)
    return out


@cached_njit
def _seen_pairs(
    points: Array,
    camera: IntArray,
    a: Array,
    b: Array,
    eyes: Array,
    normals: Array,
    limits: Array,
    ptr: IntArray,
) -> BoolArray:
    out = np.zeros(points.shape[0], dtype=np.bool_)
    for n in range(points.shape[0]):
        c = camera[n]
        out[n] = _sees(points[n], a[c], b[c], eyes[c], normals, limits, ptr)
    return out
