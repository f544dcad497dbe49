"""Settings of cameras, poses and shapes. World frame: z up; camera frame: x right, y down, z forward."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Finite, Positive, Quaternion, Settings, Vector2, Vector3

__all__ = [
    "Box",
    "CameraModel",
    "Cylinder",
    "ExtrudedPolygon",
    "FixedPose",
    "Intrinsics",
    "Polytope",
    "Road",
    "Shape",
]


class Intrinsics(Settings):
    """Pinhole intrinsics in pixels, OpenCV's convention; ``distortion`` is OpenCV's (k1, k2, p1, p2, k3, ...)."""

    width_px: Annotated[int, Field(gt=0, le=20_000)]
    height_px: Annotated[int, Field(gt=0, le=20_000)]
    fx_px: Positive
    fy_px: Positive
    cx_px: Finite
    cy_px: Finite
    distortion: tuple[Finite, ...] = ()


class CameraModel(Settings):
    """A camera: intrinsics, and the near and far range of its field-of-view volume along the optical axis."""

    name: str
    intrinsics: Intrinsics
    near_m: Positive = 0.2
    far_m: Positive = 10.0


class FixedPose(Settings):
    """Pose of a fixed camera: a position, and either a quaternion (camera to world, w x y z) or a point to look at."""

    position_m: Vector3
    quaternion_wxyz: Quaternion | None = None
    look_at_m: Vector3 | None = None


class Box(Settings):
    """Axis-aligned box."""

    type: Literal["box"] = "box"
    min_m: Vector3
    max_m: Vector3


class Cylinder(Settings):
    """Upright cylinder."""

    type: Literal["cylinder"]
    center_m: Vector2
    radius_m: Positive
    z_m: Vector2


class Polytope(Settings):
    """Convex hull of points."""

    type: Literal["polytope"]
    vertices_m: Annotated[tuple[Vector3, ...], Field(max_length=1000)]


class ExtrudedPolygon(Settings):
    """Simple polygon in the ground plane (need not be convex), extruded between two heights."""

    type: Literal["extruded_polygon"]
    vertices_m: Annotated[tuple[Vector2, ...], Field(max_length=1000)]
    z_m: Vector2


Shape = Annotated[Box | Cylinder | Polytope | ExtrudedPolygon, Field(discriminator="type")]


class Road(Settings):
    """A road's centre line in the ground plane; ``closed`` joins its ends; roads that share an end meet there."""

    name: str
    points_m: Annotated[tuple[Vector2, ...], Field(max_length=20_000)]
    closed: bool = False
    width_m: Positive = 0.6
