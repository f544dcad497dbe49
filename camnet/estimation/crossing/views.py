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
from shapely import MultiPolygon, Point, Polygon, distance, unary_union

from camnet.geometry import rotations
from camnet.geometry.pinhole import Pinhole
from camnet.types import Array, IntArray

__all__ = ["CameraViews", "fold_radius"]

_MAX_RADIUS = 5.0
_RADII = 5001
_AZIMUTHS = 720


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

    def footprints(self, step_m: float = 0.5) -> list[Polygon | MultiPolygon]:
        """Outline the ground that each camera sees within its range; empty where it sees none.

        The ground is cut into slices about the camera's foot; in each, what is seen is found every ``step_m``.
        """
        return [self._footprint(c, step_m) for c in range(len(self.pinholes))]

    def _footprint(self, camera: int, step_m: float) -> Polygon | MultiPolygon:
        foot = self.p_world[camera, :2]
        radius = np.arange(0.5 * step_m, self.range_cap_m + step_m, step_m)
        width = 2.0 * np.pi / _AZIMUTHS
        azimuth = (np.arange(_AZIMUTHS) + 0.5) * width
        direction = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
        points = foot + radius[None, :, None] * direction[:, None, :]
        single = CameraViews(
            (self.pinholes[camera],),
            self.p_world[camera : camera + 1],
            self.q_world[camera : camera + 1],
            self.height_m,
            self.near_m,
            self.range_cap_m,
        )
        seen = (single.camera_of(points.reshape(-1, 2)) == 0).reshape(_AZIMUTHS, -1)
        sectors = [
            _sector(foot, azimuth[k], 0.501 * width, radius[a] - 0.5 * step_m, radius[b] + 0.5 * step_m)
            for k in np.flatnonzero(seen.any(axis=1))
            for a, b in _runs(seen[k])
        ]
        return unary_union(sectors) if sectors else Polygon()


def fold_radius(pinhole: Pinhole) -> float:
    """Radius in normalised coordinates at which the distorted radius stops growing; inf if it never does below 5."""
    k1, k2, _, _, k3, k4, k5, k6 = pinhole.distortion[:8]
    r = np.linspace(0.0, _MAX_RADIUS, _RADII)
    r2 = r * r
    bent = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    falling = np.flatnonzero(np.diff(bent) <= 0.0)
    return float(r[falling[0]]) if falling.size else float("inf")


def _runs(seen: Array) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], seen.astype(np.int64), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _sector(foot: Array, azimuth: float, half: float, inner: float, outer: float) -> Polygon:
    left = np.array([np.cos(azimuth - half), np.sin(azimuth - half)])
    right = np.array([np.cos(azimuth + half), np.sin(azimuth + half)])
    return Polygon([foot + inner * left, foot + outer * left, foot + outer * right, foot + inner * right])
