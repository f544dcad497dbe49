"""Solid regions: operating regions of agents, occluders, and anything else with an inside.

| class | shape |
| --- | --- |
| `upright.BoxRegion` | axis-aligned box |
| `upright.CylinderRegion` | upright cylinder |
| `upright.PrismRegion` | simple polygon, convex or not, between two heights |
| `polytope.PolytopeRegion` | convex hull of points |

Signed distances are exact, inside and outside. ``build_region`` makes one from settings; ``overlaps`` decides
whether two interiors meet.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import ArrayLike

from camnet.errors import WorldError
from camnet.geometry import polygon
from camnet.geometry.polytope import PolytopeRegion, largest_ball, polytope_from_halfspaces
from camnet.geometry.settings import Box, Cylinder, ExtrudedPolygon, Polytope, Shape
from camnet.geometry.upright import BoxRegion, CylinderRegion, PrismRegion
from camnet.types import Array, BoolArray

__all__ = [
    "BoxRegion",
    "CylinderRegion",
    "PolytopeRegion",
    "PrismRegion",
    "Region",
    "build_region",
    "narrowed",
    "overlaps",
]

#: regions whose common part is thinner than this (m) only touch
TOUCHING_M = 1e-6


class Region(Protocol):
    """What every region can do.

    Attributes
    ----------
    name : shown in messages
    bounds : (2, 3) smallest and largest coordinates, m
    height : (2,) lowest and highest z, m
    center : (3,) an interior point, m
    inradius_m : radius of the largest ball inside, hence the largest margin
    """

    name: str
    bounds: Array
    height: Array
    center: Array
    inradius_m: float

    def signed_distance(self, points: ArrayLike) -> Array:
        """Distance (...,) in m of points (..., 3) to the surface, negative inside; exact on both sides."""
        ...

    def contains(self, points: ArrayLike) -> BoolArray:
        """Whether points (..., 3) are inside or on the surface (...,)."""
        ...

    def project(self, point: ArrayLike, margin_m: float = 0.0) -> Array:
        """Nearest point (3,) that is at least ``margin_m`` inside; WorldError when there is none."""
        ...

    def footprint(self) -> Array:
        """Outline (K, 2) seen from above, counter-clockwise, first point not repeated."""
        ...

    def slab_outline(self, z_lo: float, z_hi: float) -> Array:
        """Outline (K, 2), seen from above, of the part between two heights; empty when there is none."""
        ...


def build_region(name: str, shape: Shape) -> Region:
    """Region from settings.

    Raises
    ------
    WorldError
        When the shape has no interior; the message quotes the values.
    """
    match shape:
        case Box():
            return BoxRegion(name, shape.min_m, shape.max_m)
        case Cylinder():
            return CylinderRegion(name, shape.center_m, shape.radius_m, shape.z_m)
        case Polytope():
            return PolytopeRegion(name, shape.vertices_m)
        case ExtrudedPolygon():
            return PrismRegion(name, shape.vertices_m, shape.z_m)


def narrowed(region: Region, depth_m: float) -> Region:
    """Return the region less ``depth_m`` on the ground at its sides; upright heights stay.

    Raises
    ------
    WorldError
        Nothing is left, or the region is an extruded polygon, which might fall apart.
    """
    if depth_m == 0.0:
        return region
    low, high = region.bounds
    wide = (
        0.5 * float((high - low)[:2].min()) if not isinstance(region, PolytopeRegion) else region.inradius_m
    )
    if isinstance(region, PrismRegion):
        raise WorldError(
            f"region {region.name!r} is an extruded polygon: an agent that may lose its pose needs a box, a cylinder "
            "or a "
            "polytope"
        )
    if wide <= depth_m:
        raise WorldError(
            f"region {region.name!r} is {wide:.3g} m wide to each side of its middle: an agent whose own position "
            "may be "
            f"off by {depth_m:.3g} m at the end of an outage cannot be kept in it; make it wider, the outages "
            "shorter or "
            "the stated bounds smaller (pose.bounds)"
        )
    if isinstance(region, BoxRegion):
        side = np.array([depth_m, depth_m, 0.0])
        return BoxRegion(region.name, tuple(low + side), tuple(high - side))
    if isinstance(region, CylinderRegion):
        middle = (float(region.center[0]), float(region.center[1]))
        return CylinderRegion(region.name, middle, region.radius_m - depth_m, tuple(region.height))
    assert isinstance(region, PolytopeRegion)
    sides = depth_m * np.linalg.norm(region.A[:, :2], axis=1)
    return polytope_from_halfspaces(region.name, region.A, region.b - sides)


def overlaps(a: Region, b: Region) -> bool:
    """Whether the interiors of two regions meet; regions that share less than a micrometre only touch.

    Two polytopes: the largest ball in both (linear programme). Otherwise one of the two is upright, and the question is
    planar: the outlines of the parts in the heights common to both.
    """
    z_lo, z_hi = max(a.height[0], b.height[0]), min(a.height[1], b.height[1])
    if z_hi - z_lo <= TOUCHING_M:
        return False
    if isinstance(a, PolytopeRegion) and isinstance(b, PolytopeRegion):
        return 2.0 * largest_ball(np.vstack([a.A, b.A]), np.append(a.b, b.b))[1] > TOUCHING_M
    if isinstance(a, CylinderRegion) and isinstance(b, CylinderRegion):
        gap = math.dist(a.center[:2], b.center[:2])
        return gap < a.radius_m + b.radius_m - TOUCHING_M
    if isinstance(b, CylinderRegion):
        a, b = b, a
    outline = b.slab_outline(z_lo, z_hi)
    if isinstance(a, CylinderRegion):
        if len(outline) == 0:
            return False
        return bool(polygon.signed_distance(a.center[None, :2], outline)[0] < a.radius_m - TOUCHING_M)
    return _planar_overlap(a.slab_outline(z_lo, z_hi), outline)


def _planar_overlap(a: Array, b: Array) -> bool:
    if len(a) == 0 or len(b) == 0:
        return False
    common = shapely.intersection(shapely.Polygon(a), shapely.Polygon(b))
    # a sliver of width w and length l has area w l and length of border 2 l
    return bool(2.0 * common.area > TOUCHING_M * common.length)
