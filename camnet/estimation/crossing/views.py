"""Which camera sees a point of the ground: surveyed fixed cameras with lens distortion and a range cap.

A point is seen by a camera if it is deeper than the near range, nearer than the range cap (distance to the optical
centre), and its distorted image lies in the picture. OpenCV's polynomial folds back far outside of the picture and
would show points there that the lens cannot: rays beyond the radius at which the distorted radius stops growing are
not seen. Of several cameras that see a point, the nearest one does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import MultiPolygon, Point, Polygon, distance, make_valid

from camnet.geometry import rotations
from camnet.geometry.pinhole import Pinhole
from camnet.types import Array, IntArray

__all__ = ["CameraViews", "fold_radius"]

_MAX_RADIUS = 5.0
_RADII = 5001
#: points that stand for each side of a distorted picture
_BORDER_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class CameraViews:
    """Fixed cameras over flat ground.

    Attributes
    ----------
    pinholes : C cameras
    p_world, q_world : (C, 3), (C, 4) optical centres; camera frame to world
    height_m : z of the points that are looked at
    near_m, range_cap_m : nearest depth and largest distance at which a target is recognised
    """

    pinholes: Sequence[Pinhole]
    p_world: Array
    q_world: Array
    height_m: float = 0.0
    near_m: float = 0.5
    range_cap_m: float = 80.0

    def distances(self, points: Array) -> Array:
        """Distances (n, C) from points (n, 2) to the cameras that see them, m; inf for the others."""
        world = np.column_stack([points, np.full(len(points), self.height_m)])
        out = np.full((len(points), len(self.pinholes)), np.inf)
        for c, pinhole in enumerate(self.pinholes):
            offset = world - self.p_world[c]
            reach = np.linalg.norm(offset, axis=1)
            cam = offset @ rotations.to_matrix(self.q_world[c])
            near = np.flatnonzero((cam[:, 2] >= self.near_m) & (reach <= self.range_cap_m))
            radius = np.hypot(cam[near, 0], cam[near, 1]) / cam[near, 2]
            near = near[radius < fold_radius(pinhole)]
            seen = near[pinhole.in_image(pinhole.project(cam[near]))]
            out[seen, c] = reach[seen]
        return out

    def camera_of(self, points: Array) -> IntArray:
        """Index (n,) of the nearest camera that sees each point (n, 2); -1 where none does."""
        reach = self.distances(points)
        return np.where(np.isfinite(reach).any(axis=1), reach.argmin(axis=1), -1)

    def nearest_view(self, points: Array, footprints: Sequence[Polygon | MultiPolygon]) -> IntArray:
        """Index (n,) of the camera that sees each point (n, 2) or, where none does, whose footprint is nearest."""
        cameras = self.camera_of(points)
        lost = np.flatnonzero(cameras < 0)
        if lost.size:
            where = np.array([Point(x, y) for x, y in points[lost]])
            gaps = distance(where[:, None], np.array(footprints, dtype=object)[None, :])
            cameras[lost] = np.where(np.isnan(gaps), np.inf, gaps).argmin(axis=1)
        return cameras

    def footprints(self) -> list[Polygon | MultiPolygon]:
        """Outline the ground that each camera sees within its range; empty where it sees none.

        The picture's border is undistorted, cut to rays that meet the ground between the near range and the range cap
        (half-planes of the normalised image), carried to the ground, and cut to the range cap.
        """
        return [self._footprint(c) for c in range(len(self.pinholes))]

    def _footprint(self, camera: int) -> Polygon | MultiPolygon:
        height = float(self.p_world[camera, 2]) - self.height_m
        if not 0.0 < abs(height) < self.range_cap_m:
            return Polygon()
        r = rotations.to_matrix(self.q_world[camera])
        border = self.pinholes[camera].normalise(_border(self.pinholes[camera].size))
        border = border[np.isfinite(border).all(axis=1)]
        for sign, limit_m in ((1.0, self.range_cap_m), (-1.0, self.near_m)):
            border = _clip(border, sign * (_inverse_depth(border, r, height) - 1.0 / limit_m))
        if len(border) < 3:
            return Polygon()
        rays = np.column_stack([border, np.ones(len(border))]) @ r.T
        foot = self.p_world[camera, :2]
        ground = foot + rays[:, :2] / _inverse_depth(border, r, height)[:, None]
        reach = Point(*foot).buffer(float(np.sqrt(self.range_cap_m**2 - height**2)), quad_segs=64)
        return make_valid(Polygon(ground)).intersection(reach)


def fold_radius(pinhole: Pinhole) -> float:
    """Radius in normalised coordinates at which the distorted radius stops growing; inf if it never does below 5."""
    k1, k2, _, _, k3, k4, k5, k6 = pinhole.distortion[:8]
    r = np.linspace(0.0, _MAX_RADIUS, _RADII)
    r2 = r * r
    bent = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    falling = np.flatnonzero(np.diff(bent) <= 0.0)
    return float(r[falling[0]]) if falling.size else float("inf")


def _border(size: Array) -> Array:
    """Pixels (n, 2) around the picture."""
    t = np.linspace(0.0, 1.0, _BORDER_SAMPLES, endpoint=False)[:, None]
    corners = size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return np.concatenate(
        [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )


def _inverse_depth(points: Array, r: Array, height_m: float) -> Array:
    """1 / depth (n,) at which rays through normalised image points (n, 2) meet the ground; negative if behind."""
    return np.asarray(-(points @ r[2, :2] + r[2, 2]) / height_m)


def _clip(polygon: Array, value: Array) -> Array:
    """Cut a polygon (n, 2) to where a linear function, ``value`` (n,) at its corners, is not negative."""
    kept = []
    for k in range(len(polygon)):
        a, b = polygon[k - 1], polygon[k]
        if (value[k - 1] >= 0.0) != (value[k] >= 0.0):
            kept.append(a + value[k - 1] / (value[k - 1] - value[k]) * (b - a))
        if value[k] >= 0.0:
            kept.append(b)
    return np.array(kept).reshape(-1, 2)
