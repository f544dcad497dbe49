"""Upright solids: axis-aligned boxes, cylinders, and prisms over simple polygons.

Each is its outline seen from above, times an interval of heights; so with ``d`` the signed distance to the outline
and ``v = max(z_lo - z, z - z_hi)`` the signed distance to the solid is ``max(d, v)`` inside and
``|(max(d, 0), max(v, 0))|`` outside, exactly. The nearest point a margin inside is found for the outline and for the
height apart.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike

from camnet.compiled import cached_njit
from camnet.errors import WorldError
from camnet.geometry import polygon
from camnet.geometry.polytope import check_margin
from camnet.types import Array, BoolArray

__all__ = ["BoxRegion", "CylinderRegion", "PrismRegion"]

#: corners of the polygon that stands for a circle on maps
CIRCLE_CORNERS = 64


def _slab(region: BoxRegion | CylinderRegion | PrismRegion, z_lo: float, z_hi: float) -> Array:
    if min(z_hi, region.height[1]) < max(z_lo, region.height[0]):
        return np.zeros((0, 2))
    return region.footprint()


@cached_njit
def _prism_distance(planar: Array, points: Array, z_lo: float, z_hi: float) -> Array:
    """Distance (K,) of points (K, 3) to a prism, from their distance (K,) to its outline."""
    out = np.empty(planar.shape[0])
    for k in range(planar.shape[0]):
        vertical = max(z_lo - points[k, 2], points[k, 2] - z_hi)
        inner = max(planar[k], vertical)
        out[k] = math.sqrt(max(planar[k], 0.0) ** 2 + max(vertical, 0.0) ** 2) if inner > 0.0 else inner
    return out


@cached_njit
def _cylinder_distance(points: Array, cx: float, cy: float, radius: float, z_lo: float, z_hi: float) -> Array:
    radial = np.sqrt((points[:, 0] - cx) ** 2 + (points[:, 1] - cy) ** 2) - radius
    return _prism_distance(radial, points, z_lo, z_hi)


@cached_njit
def _box_project(p: Array, lo: Array, hi: Array, margin: float) -> Array:
    out = np.empty(3)
    for i in range(3):
        out[i] = min(max(p[i], lo[i] + margin), hi[i] - margin)
    return out


@cached_njit
def _box_distance(points: Array, lo: Array, hi: Array) -> Array:
    out = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        inner, outer = -math.inf, 0.0
        for i in range(3):
            d = max(lo[i] - points[k, i], points[k, i] - hi[i])
            inner = max(inner, d)
            outer += max(d, 0.0) ** 2
        out[k] = math.sqrt(outer) if inner > 0.0 else inner
    return out


class BoxRegion:
    """Axis-aligned box between ``min_m`` (3,) and ``max_m`` (3,)."""

    def __init__(self, name: str, min_m: ArrayLike, max_m: ArrayLike) -> None:
        lo, hi = np.array(min_m, dtype=np.float64), np.array(max_m, dtype=np.float64)
        if not np.all(lo < hi):
            raise WorldError(
                f"region '{name}': min_m {lo.tolist()} must be below max_m {hi.tolist()} in every coordinate"
            )
        self.name = name
        self.bounds: Array = np.stack([lo, hi])
        self.height: Array = self.bounds[:, 2].copy()
        self.center: Array = 0.5 * (lo + hi)
        self.inradius_m = 0.5 * float(np.min(hi - lo))
        for array in (self.bounds, self.height, self.center):
            array.setflags(write=False)

    def signed_distance(self, points: ArrayLike) -> Array:
        """See `camnet.geometry.regions.Region`."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        return np.asarray(_box_distance(p.reshape(-1, 3), self.bounds[0], self.bounds[1])).reshape(
            p.shape[:-1]
        )

    def contains(self, points: ArrayLike) -> BoolArray:
        """See `camnet.geometry.regions.Region`."""
        return np.asarray(self.signed_distance(points) <= 0.0)

    def project(self, point: ArrayLike, margin_m: float = 0.0) -> Array:
        """See `camnet.geometry.regions.Region`."""
        if not margin_m <= self.inradius_m:
            check_margin(self.name, margin_m, self.inradius_m)
        return np.asarray(
            _box_project(np.asarray(point, dtype=np.float64), self.bounds[0], self.bounds[1], margin_m)
        )

    def footprint(self) -> Array:
        """See `camnet.geometry.regions.Region`."""
        (x0, y0, _), (x1, y1, _) = self.bounds
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])

    def slab_outline(self, z_lo: float, z_hi: float) -> Array:
        """See `camnet.geometry.regions.Region`."""
        return _slab(self, z_lo, z_hi)


@cached_njit
def _cylinder_project(p: Array, cx: float, cy: float, radius: float, z_lo: float, z_hi: float) -> Array:
    dx, dy = p[0] - cx, p[1] - cy
    d = math.sqrt(dx * dx + dy * dy)
    out = np.empty(3)
    out[0], out[1] = p[0], p[1]
    if d > radius:
        out[0], out[1] = cx + radius * dx / d, cy + radius * dy / d
    out[2] = min(max(p[2], z_lo), z_hi)
    return out


class CylinderRegion:
    """Upright cylinder: centre (2,), radius, heights (2,), all in m."""

    def __init__(self, name: str, center_m: ArrayLike, radius_m: float, z_m: ArrayLike) -> None:
        z_lo, z_hi = _heights(name, z_m)
        if not radius_m > 0.0:
            raise WorldError(f"region '{name}': radius_m is {radius_m}; it must be positive")
        self.name = name
        self.radius_m = float(radius_m)
        x, y = (float(c) for c in np.asarray(center_m, dtype=np.float64))
        self.center: Array = np.array([x, y, 0.5 * (z_lo + z_hi)])
        self.height: Array = np.array([z_lo, z_hi])
        self.bounds: Array = np.array(
            [[x - radius_m, y - radius_m, z_lo], [x + radius_m, y + radius_m, z_hi]]
        )
        self.inradius_m = min(self.radius_m, 0.5 * (z_hi - z_lo))
        self._dimensions = (x, y, self.radius_m, z_lo, z_hi)
        for array in (self.bounds, self.height, self.center):
            array.setflags(write=False)

    def signed_distance(self, points: ArrayLike) -> Array:
        """See `camnet.geometry.regions.Region`."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        return np.asarray(_cylinder_distance(p.reshape(-1, 3), *self._dimensions)).reshape(p.shape[:-1])

    def contains(self, points: ArrayLike) -> BoolArray:
        """See `camnet.geometry.regions.Region`."""
        return np.asarray(self.signed_distance(points) <= 0.0)

    def project(self, point: ArrayLike, margin_m: float = 0.0) -> Array:
        """See `camnet.geometry.regions.Region`."""
        if not margin_m <= self.inradius_m:
            check_margin(self.name, margin_m, self.inradius_m)
        x, y, radius, z_lo, z_hi = self._dimensions
        p = np.asarray(point, dtype=np.float64)
        return np.asarray(_cylinder_project(p, x, y, radius - margin_m, z_lo + margin_m, z_hi - margin_m))

    def footprint(self) -> Array:
        """See `camnet.geometry.regions.Region`; a circle comes back as a polygon of 64 corners on it."""
        angle = 2.0 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
        return self.center[:2] + self.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def slab_outline(self, z_lo: float, z_hi: float) -> Array:
        """See `camnet.geometry.regions.Region`."""
        return _slab(self, z_lo, z_hi)


class PrismRegion:
    """Simple polygon (K, 2), convex or not, between two heights (2,), all in m."""

    def __init__(self, name: str, vertices_m: ArrayLike, z_m: ArrayLike) -> None:
        z_lo, z_hi = _heights(name, z_m)
        self.name = name
        self.vertices: Array = _simple_polygon(name, np.array(vertices_m, dtype=np.float64).reshape(-1, 2))
        plane = shapely.Polygon(self.vertices)
        # the line from the centre of the largest circle to where it touches the border
        circle = shapely.maximum_inscribed_circle(plane)
        self.inradius_m = min(float(circle.length), 0.5 * (z_hi - z_lo))
        point = np.array(plane.centroid.coords)
        # the centroid, unless it is outside or all but outside
        if -self._planar_distance(point)[0] < 0.5 * circle.length:
            point = np.array(circle.coords)
        self.center: Array = np.array([*point[0], 0.5 * (z_lo + z_hi)])
        self.height: Array = np.array([z_lo, z_hi])
        self.bounds: Array = np.array(
            [[*self.vertices.min(axis=0), z_lo], [*self.vertices.max(axis=0), z_hi]], dtype=np.float64
        )
        self._corners: dict[float, Array] = {}
        for array in (self.vertices, self.bounds, self.height, self.center):
            array.setflags(write=False)

    def _planar_distance(self, points: Array) -> Array:
        return np.asarray(polygon.signed_distance(points, self.vertices))

    def signed_distance(self, points: ArrayLike) -> Array:
        """See `camnet.geometry.regions.Region`."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        planar = self._planar_distance(p.reshape(-1, 3))
        return np.asarray(_prism_distance(planar, p.reshape(-1, 3), *self.height)).reshape(p.shape[:-1])

    def contains(self, points: ArrayLike) -> BoolArray:
        """See `camnet.geometry.regions.Region`."""
        return np.asarray(self.signed_distance(points) <= 0.0)

    def project(self, point: ArrayLike, margin_m: float = 0.0) -> Array:
        """See `camnet.geometry.regions.Region`."""
        corners = self._corners.get(margin_m)
        if corners is None:
            corners = self._corners[margin_m] = polygon.erosion_corners(self.vertices, margin_m)
        if len(corners) == 0 or 2.0 * margin_m > self.height[1] - self.height[0]:
            check_margin(self.name, margin_m, min(self.inradius_m, margin_m * (1.0 - 1e-9)))
        p = np.asarray(point, dtype=np.float64)
        xy = polygon.nearest_in_erosion(p, self.vertices, margin_m, corners)
        z = min(max(float(p[2]), self.height[0] + margin_m), self.height[1] - margin_m)
        return np.array([xy[0], xy[1], z])

    def footprint(self) -> Array:
        """See `camnet.geometry.regions.Region`."""
        return self.vertices.copy()

    def slab_outline(self, z_lo: float, z_hi: float) -> Array:
        """See `camnet.geometry.regions.Region`."""
        return _slab(self, z_lo, z_hi)


def _heights(name: str, z_m: ArrayLike) -> tuple[float, float]:
    z_lo, z_hi = (float(z) for z in np.asarray(z_m, dtype=np.float64))
    if not z_lo < z_hi:
        raise WorldError(f"region '{name}': z_m [{z_lo:g}, {z_hi:g}] must be [lowest, highest], lowest first")
    return z_lo, z_hi


def _simple_polygon(name: str, vertices: Array) -> Array:
    if len(vertices) > 1 and np.array_equal(vertices[0], vertices[-1]):
        vertices = vertices[:-1]
    vertices = vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]
    listed = f"region '{name}': vertices_m {vertices.tolist()}"
    if len(vertices) < 3:
        raise WorldError(f"{listed} are fewer than the three different points of a polygon")
    plane = shapely.Polygon(vertices)
    if not plane.is_valid:
        raise WorldError(
            f"{listed} cross or touch themselves ({shapely.is_valid_reason(plane)}); "
            "list the corners in order around the border"
        )
    if not plane.area > 1e-12:
        raise WorldError(f"{listed} enclose no area")
    return np.ascontiguousarray(vertices if plane.exterior.is_ccw else vertices[::-1])
