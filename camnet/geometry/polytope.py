"""Convex polytopes as half-spaces ``A x <= b`` with unit normals.

Inside, the signed distance is ``max(A x - b)``; outside, the distance to the nearest surface triangle. The
nearest point of ``{x : A x <= b - margin}`` is a least-distance programme, solved exactly through its
non-negative dual (Lawson and Hanson, Solving Least Squares Problems, ch. 23).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog, nnls
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from camnet.compiled import cached_njit
from camnet.errors import WorldError
from camnet.types import Array, BoolArray

__all__ = ["PolytopeRegion", "largest_ball", "polytope_from_halfspaces", "signed_distance"]


def largest_ball(a: Array, b: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of the largest ball in ``a x <= b`` (F, 3), (F,) with unit normals.

    The radius is that of the centre found, exactly, hence never above the best one. It is negative when the
    half-spaces have no common point, and infinite when they bound no volume.
    """
    n = a.shape[1]
    result = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.column_stack([a, np.ones(len(a))]),
        b_ub=b,
        bounds=[(None, None)] * (n + 1),
        method="highs",
    )
    if result.x is None:  # unbounded: a ball of any size fits
        return np.full(n, np.nan), math.inf
    centre = np.asarray(result.x[:n], dtype=np.float64)
    return centre, float(np.min(b - a @ centre))


@cached_njit
def _segment_distance2(p: Array, a: Array, b: Array) -> float:
    e0, e1, e2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    d0, d1, d2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    t = (d0 * e0 + d1 * e1 + d2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
    t = min(1.0, max(0.0, t))
    return float((d0 - t * e0) ** 2 + (d1 - t * e1) ** 2 + (d2 - t * e2) ** 2)


@cached_njit
def _triangle_distance2(p: Array, corners: Array) -> float:
    a, b, c = corners[0], corners[1], corners[2]
    u, v, w = b - a, c - a, p - a
    uu, uv, vv = np.dot(u, u), np.dot(u, v), np.dot(v, v)
    wu, wv = np.dot(w, u), np.dot(w, v)
    det = uu * vv - uv * uv
    s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
    if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
        foot = w - s * u - t * v
        return float(np.dot(foot, foot))
    return min(_segment_distance2(p, a, b), _segment_distance2(p, b, c), _segment_distance2(p, c, a))


@cached_njit
def signed_distance(points: Array, a: Array, b: Array, triangles: Array) -> Array:
    """Distance (K,) of points (K, 3) to the polytope ``a x <= b`` with the surface ``triangles`` (T, 3, 3)."""
    out = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        inner = -math.inf
        for i in range(a.shape[0]):
            value = a[i, 0] * points[k, 0] + a[i, 1] * points[k, 1] + a[i, 2] * points[k, 2] - b[i]
            inner = max(inner, value)
        if inner > 0.0:
            nearest = math.inf
            for i in range(triangles.shape[0]):
                nearest = min(nearest, _triangle_distance2(points[k], triangles[i]))
            inner = math.sqrt(nearest)
        out[k] = inner
    return out


def _least_distance(a: Array, b: Array, point: Array) -> Array:
    """Nearest point (3,) to ``point`` with ``a x <= b``, assumed not empty."""
    h = a @ point - b
    scale = float(np.max(h))
    if scale <= 0.0:
        return point
    # minimise |y| with -a y >= h / scale
    e = np.vstack([-a.T, h[None] / scale])
    f = np.append(np.zeros(a.shape[1]), 1.0)
    u, _ = nnls(e, f)
    residual = e @ u - f
    return np.asarray(point - scale * residual[:-1] / residual[-1])


class PolytopeRegion:
    """Convex hull of points.

    Parameters
    ----------
    name : shown in messages
    vertices : (K, 3) points in m, at least four, not in one plane

    Attributes
    ----------
    A, b : (F, 3), (F,) half-spaces ``A x <= b`` with unit normals
    vertices : (V, 3) those of the points that are corners

    Raises
    ------
    WorldError
        When the points have no volume.
    """

    def __init__(self, name: str, vertices: ArrayLike) -> None:
        points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError) as error:
            raise WorldError(
                f"region '{name}': vertices_m {points.tolist()} have no volume; "
                "a polytope needs at least four points that are not in one plane"
            ) from error
        self.name = name
        self.vertices: Array = points[hull.vertices]
        planes = hull.equations[np.unique(np.round(hull.equations, 9), axis=0, return_index=True)[1]]
        self.A: Array = np.ascontiguousarray(planes[:, :3])
        self.b: Array = np.ascontiguousarray(-planes[:, 3])
        self._triangles: Array = _proper(points[hull.simplices])
        self.inradius_m = largest_ball(self.A, self.b)[1]
        if not self.inradius_m > 1e-6:
            raise WorldError(
                f"region '{name}': vertices_m {points.tolist()} are all but in one plane "
                f"(the largest ball inside has a radius of {self.inradius_m:.2g} m); give the region a thickness"
            )
        self.bounds: Array = np.stack([points.min(axis=0), points.max(axis=0)])
        self.height: Array = self.bounds[:, 2].copy()
        self.center: Array = self._centroid()
        for array in (self.vertices, self.A, self.b, self._triangles, self.bounds, self.height, self.center):
            array.setflags(write=False)

    def _centroid(self) -> Array:
        apex = self.vertices.mean(axis=0)
        volumes = np.abs(np.linalg.det(self._triangles - apex))
        return np.asarray(volumes @ (self._triangles.sum(axis=1) + apex) / (4.0 * volumes.sum()))

    @property
    def triangles(self) -> Array:
        """Surface, (T, 3, 3), m."""
        return self._triangles

    def signed_distance(self, points: ArrayLike) -> Array:
        """Distance (...,) in m of points (..., 3) to the surface, negative inside; exact on both sides."""
        p = np.array(points, dtype=np.float64, order="C")  # never read-only: one compiled form
        return np.asarray(signed_distance(p.reshape(-1, 3), self.A, self.b, self._triangles)).reshape(
            p.shape[:-1]
        )

    def contains(self, points: ArrayLike) -> BoolArray:
        """Whether points (..., 3) are inside or on the surface (...,)."""
        return np.asarray(np.all(np.asarray(points, dtype=np.float64) @ self.A.T <= self.b, axis=-1))

    def project(self, point: ArrayLike, margin_m: float = 0.0) -> Array:
        """Nearest point (3,) that is at least ``margin_m`` inside."""
        check_margin(self.name, margin_m, self.inradius_m)
        return _least_distance(self.A, self.b - margin_m, np.array(point, dtype=np.float64))

    def footprint(self) -> Array:
        """Outline (K, 2) seen from above, counter-clockwise."""
        return _hull_2d(self.vertices[:, :2])

    def slab_outline(self, z_lo: float, z_hi: float) -> Array:
        """Outline (K, 2), seen from above, of the part between two heights; empty when there is none."""
        points = [self.vertices[(self.vertices[:, 2] >= z_lo) & (self.vertices[:, 2] <= z_hi)]]
        edges = self._triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
        for z in (z_lo, z_hi):
            crossing = edges[(edges[:, 0, 2] < z) != (edges[:, 1, 2] < z)]
            t = (z - crossing[:, 0, 2]) / (crossing[:, 1, 2] - crossing[:, 0, 2])
            points.append(crossing[:, 0] + t[:, None] * (crossing[:, 1] - crossing[:, 0]))
        return _hull_2d(np.concatenate(points)[:, :2])


def _proper(triangles: Array) -> Array:
    """Those triangles (T, 3, 3) that have an area; points in a line on a face make some that have none."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(u, v), axis=1)
    longest = np.maximum(np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1))
    return np.ascontiguousarray(triangles[area > 1e-9 * longest**2])


def _hull_2d(points: Array) -> Array:
    if len(points) < 3:
        return np.zeros((0, 2))
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return np.zeros((0, 2))


def check_margin(name: str, margin_m: float, inradius_m: float) -> None:
    """Refuse a margin that leaves no point of a region."""
    if not margin_m <= inradius_m:
        raise WorldError(
            f"region '{name}': no point is margin_m = {margin_m:g} m inside; "
            f"the largest margin this region allows is {inradius_m:.6g} m"
        )


def polytope_from_halfspaces(name: str, a: ArrayLike, b: ArrayLike) -> PolytopeRegion:
    """Polytope ``a x <= b`` (F, 3), (F,), unit normals, as a region.

    Raises
    ------
    WorldError
        When the half-spaces have no common interior or do not bound a volume.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    centre, radius = largest_ball(a, b)
    if not 0.0 < radius < math.inf:
        raise WorldError(
            f"region '{name}': its half-spaces do not bound a volume (largest ball radius {radius:.2g} m)"
        )
    try:
        corners = HalfspaceIntersection(np.column_stack([a, -b]), centre).intersections
    except QhullError as error:
        raise WorldError(f"region '{name}': its half-spaces do not bound a volume") from error
    return PolytopeRegion(name, corners)
