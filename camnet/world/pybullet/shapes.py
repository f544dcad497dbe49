"""Solids in the engine's terms: boxes and cylinders as such, everything else as convex pieces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet as pb
import shapely
from scipy.spatial import ConvexHull

from camnet.errors import WorldError
from camnet.geometry.settings import Box, Cylinder, ExtrudedPolygon, Polytope, Shape
from camnet.types import Array

__all__ = ["Solid", "box", "cylinder", "hull", "pieces", "sheet"]


@dataclass(frozen=True, eq=False, slots=True)
class Solid:
    """Arguments for PyBullet's collision and visual shape, and where the shape's origin lies, (3,) m."""

    collision: dict[str, Any]
    visual: dict[str, Any]
    origin: Array


def box(size: Array, origin: Array, lift: float = 0.0) -> Solid:
    """Box of full edge lengths ``size`` (3,) about ``origin`` (3,), shifted up by ``lift`` in its own frame."""
    half, shift = (0.5 * np.asarray(size)).tolist(), [0.0, 0.0, lift]
    return Solid(
        {"shapeType": pb.GEOM_BOX, "halfExtents": half, "collisionFramePosition": shift},
        {"shapeType": pb.GEOM_BOX, "halfExtents": half, "visualFramePosition": shift},
        np.asarray(origin, dtype=float),
    )


def cylinder(radius: float, height: float, origin: Array) -> Solid:
    """Upright cylinder about ``origin`` (3,)."""
    return Solid(
        {"shapeType": pb.GEOM_CYLINDER, "radius": radius, "height": height},
        {"shapeType": pb.GEOM_CYLINDER, "radius": radius, "length": height},
        np.asarray(origin, dtype=float),
    )


def hull(points: Array) -> Solid:
    """Convex hull of ``points`` (K,3), about their mean."""
    origin = points.mean(axis=0)
    local = points - origin
    convex = ConvexHull(local)
    triangles = convex.simplices.copy()
    for k, plane in enumerate(convex.equations):
        a, b, c = local[triangles[k]]
        if np.dot(np.cross(b - a, c - a), plane[:3]) < 0:  # outward faces run counter-clockwise
            triangles[k] = triangles[k][::-1]
    # flat shading: every triangle has its own corners
    corners, normals = local[triangles].reshape(-1, 3), np.repeat(convex.equations[:, :3], 3, axis=0)
    mesh = {"vertices": corners.tolist(), "indices": list(range(len(corners))), "normals": normals.tolist()}
    return Solid(
        {"shapeType": pb.GEOM_MESH, "vertices": local[convex.vertices].tolist()},
        {"shapeType": pb.GEOM_MESH, **mesh},
        origin,
    )


def sheet(quads: Array) -> Solid:
    """Horizontal quadrilaterals (K,4,3), corners counter-clockwise from above: only for pictures."""
    corners = quads.reshape(-1, 3)
    first = 4 * np.arange(len(quads))[:, None]
    indices = (first + np.array([0, 1, 2, 0, 2, 3])).ravel().tolist()
    normals = np.tile([0.0, 0.0, 1.0], (len(corners), 1)).tolist()
    mesh = {"vertices": corners.tolist(), "indices": indices, "normals": normals}
    return Solid({}, {"shapeType": pb.GEOM_MESH, **mesh}, np.zeros(3))


def _prisms(shape: ExtrudedPolygon, name: str) -> list[Solid]:
    polygon = shapely.Polygon(shape.vertices_m)
    if not polygon.is_valid:
        raise WorldError(
            f"occluder {name!r}: vertices_m make no simple polygon ({shapely.is_valid_reason(polygon)})"
        )
    solids = []
    for triangle in shapely.constrained_delaunay_triangles(polygon).geoms:
        flat = np.asarray(triangle.exterior.coords)[:3, :2]
        solids.append(hull(np.vstack([np.column_stack([flat, np.full(3, z)]) for z in shape.z_m])))
    return solids


def pieces(shape: Shape, name: str) -> list[Solid]:
    """Convex solids whose union is ``shape``.

    Raises
    ------
    WorldError
        A polygon crosses itself.
    """
    if isinstance(shape, Box):
        low, high = np.array(shape.min_m), np.array(shape.max_m)
        return [box(high - low, 0.5 * (low + high))]
    if isinstance(shape, Cylinder):
        z_low, z_high = shape.z_m
        return [cylinder(shape.radius_m, z_high - z_low, np.array([*shape.center_m, 0.5 * (z_low + z_high)]))]
    if isinstance(shape, Polytope):
        return [hull(np.array(shape.vertices_m))]
    return _prisms(shape, name)
