"""Obstacles of a plan: ellipsoids, boxes and cylinders, standing or moving with constant velocity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike

from camnet.control.planner.distance_kernel import (
    BOX,
    CYLINDER,
    ELLIPSOID,
    ROW,
    segment_clearance,
    signed_distance,
)
from camnet.errors import WorldError
from camnet.geometry.settings import Box, Cylinder, ExtrudedPolygon, Shape
from camnet.types import Array

__all__ = ["Obstacle", "box", "cylinder", "ellipsoid", "from_shape", "pack", "sphere"]


@dataclass(frozen=True, eq=False, slots=True)
class Obstacle:
    """A solid; ``row`` is its packed form, see `camnet.control.planner.distance_kernel`."""

    row: Array

    @property
    def center(self) -> Array:
        """Centre (3,) at the plan's start, m."""
        return self.row[1:4]

    def signed_distance(self, p_world: ArrayLike, t_s: float = 0.0) -> float:
        """Exact distance of a point (3,) ``t_s`` after the plan's start, m; negative inside."""
        return float(signed_distance(self.row, np.asarray(p_world, dtype=float), t_s, np.empty(3)))

    def segment_clearance(self, start: ArrayLike, end: ArrayLike, t_s: float = 0.0) -> float:
        """Smallest signed distance, m, of the points between ``start`` (3,) and ``end`` (3,)."""
        a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        return float(segment_clearance(self.row, a, b, t_s))


def _make(
    kind: int, center: ArrayLike, half: ArrayLike, axes: ArrayLike | None, velocity: ArrayLike
) -> Obstacle:
    c, a, v = (np.asarray(x, dtype=float).reshape(3) for x in (center, half, velocity))
    turn = np.eye(3) if axes is None else np.asarray(axes, dtype=float).reshape(3, 3)
    if not (a > 0.0).all() or not np.isfinite(np.concatenate([c, a, v])).all():
        raise WorldError(f"obstacle: half-axes {a.tolist()} must be positive, and centre {c.tolist()} finite")
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-9):
        raise WorldError(f"obstacle: axes {turn.tolist()} must be the orthonormal columns of a rotation")
    row = np.concatenate([[kind], c, v, turn.ravel(), a])
    row.setflags(write=False)
    return Obstacle(row)


_STILL = (0.0, 0.0, 0.0)


def ellipsoid(
    center: ArrayLike, half_axes: ArrayLike, axes: ArrayLike | None = None, velocity: ArrayLike = _STILL
) -> Obstacle:
    """Ellipsoid at ``center`` (3,) with ``half_axes`` (3,), m, along the columns of ``axes`` (3,3).

    Raises
    ------
    WorldError
        A half-axis is not positive, a value not finite, or the axes are not orthonormal.
    """
    return _make(ELLIPSOID, center, half_axes, axes, velocity)


def sphere(center: ArrayLike, radius_m: float, velocity: ArrayLike = _STILL) -> Obstacle:
    """Ball, for instance about another agent that flies on with ``velocity`` (3,), m/s."""
    return _make(ELLIPSOID, center, np.full(3, radius_m), None, velocity)


def box(
    center: ArrayLike, half_sizes: ArrayLike, axes: ArrayLike | None = None, velocity: ArrayLike = _STILL
) -> Obstacle:
    """Box with ``half_sizes`` (3,), m, along the columns of ``axes`` (3,3)."""
    return _make(BOX, center, half_sizes, axes, velocity)


def cylinder(
    center: ArrayLike, radius_m: float, half_height_m: float, velocity: ArrayLike = _STILL
) -> Obstacle:
    """Upright cylinder."""
    return _make(CYLINDER, center, (radius_m, radius_m, half_height_m), None, velocity)


def from_shape(shape: Shape) -> Obstacle:
    """Obstacle of a world's occluder; polytopes and polygons are taken as their boxes, turned about z at best."""
    if isinstance(shape, Box):
        low, high = np.array(shape.min_m), np.array(shape.max_m)
        return box(0.5 * (low + high), 0.5 * (high - low))
    if isinstance(shape, Cylinder):
        z_low, z_high = shape.z_m
        return cylinder((*shape.center_m, 0.5 * (z_low + z_high)), shape.radius_m, 0.5 * (z_high - z_low))
    points = np.array(shape.vertices_m)
    heights = np.array(shape.z_m) if isinstance(shape, ExtrudedPolygon) else points[:, 2]
    return _upright_box(points[:, :2], float(heights.min()), float(heights.max()))


def _upright_box(points: Array, z_low: float, z_high: float) -> Obstacle:
    """Smallest box about points (K,2) between two heights."""
    corners = np.array(shapely.MultiPoint(points).minimum_rotated_rectangle.exterior.coords)[:4]
    x, y = corners[1] - corners[0], corners[3] - corners[0]
    axes = np.eye(3)
    axes[:2, 0] = x / np.linalg.norm(x)
    axes[:2, 1] = -axes[1, 0], axes[0, 0]
    half = 0.5 * np.array([np.linalg.norm(x), np.linalg.norm(y), z_high - z_low])
    return box((*corners.mean(axis=0), 0.5 * (z_low + z_high)), half, axes)


def pack(obstacles: Iterable[Obstacle]) -> Array:
    """Rows (K, 19) for the kernels."""
    return np.array([o.row for o in obstacles], dtype=float).reshape(-1, ROW)
