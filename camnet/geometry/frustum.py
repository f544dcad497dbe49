"""Field-of-view volumes: the pinhole's view frustum cut at a near and a far range along the optical axis.

The volume is held as six half-spaces ``A x <= b`` with unit normals, in the order near, far, left, right, top,
bottom. The signed distance ``max(A x - b)`` is exact inside and its sign is exact everywhere; a ball lies inside
where ``A c + r <= b`` (bell2019 uses the largest such ball at the working range, ``R = d sin psi``). Every
function takes any number of cameras in the leading dimensions.

With lens distortion the image border is not straight: each side is then moved in to the innermost border point, so
whatever is inside the frustum is inside the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import WorldError
from camnet.geometry import rotations
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.polytope import PolytopeRegion
from camnet.geometry.settings import CameraModel
from camnet.types import Array, BoolArray

__all__ = ["Frustum", "footprint", "frustum_corners"]

#: border points that stand for each side of a distorted image
_BORDER_SAMPLES = 65
#: pairs of corners joined by an edge; corners 0-3 are near, 4-7 far, both in the order of `_RING`
_EDGES = np.array(
    [(i, (i + 1) % 4) for i in range(4)]
    + [(i, i + 4) for i in range(4)]
    + [(4 + i, 4 + (i + 1) % 4) for i in range(4)]
)
#: left/right and top/bottom of the four corners in order
_RING = ((0, 2), (1, 2), (1, 3), (0, 3))


@dataclass(frozen=True, eq=False)
class Frustum:
    """One frustum or many, in one frame.

    Attributes
    ----------
    A, b : (..., 6, 3), (..., 6) half-spaces near, far, left, right, top, bottom
    corners : (..., 8, 3) near corners, then far corners, each top-left, top-right, bottom-right, bottom-left
    tangents : (..., 4) of the angles of left, right, top, bottom off the optical axis; left and top negative
    range_m : (..., 2) near and far
    """

    A: Array
    b: Array
    corners: Array
    tangents: Array
    range_m: Array

    @classmethod
    def from_camera(cls, camera: CameraModel) -> Frustum:
        """Frustum of a camera model, in the camera frame.

        Raises
        ------
        WorldError
            When the ranges are in the wrong order, or the lens distortion cannot be inverted over the image.
        """
        if not camera.near_m < camera.far_m:
            raise WorldError(
                f"camera '{camera.name}': near_m {camera.near_m:g} must be below far_m {camera.far_m:g}"
            )
        tangents = _border_tangents(Pinhole.from_settings(camera.intrinsics))
        if not (np.all(np.isfinite(tangents)) and tangents[0] < tangents[1] and tangents[2] < tangents[3]):
            raise WorldError(
                f"camera '{camera.name}': distortion {list(camera.intrinsics.distortion)} folds the image over before "
                "its border, so no field of view is defined; give coefficients that are valid over the whole image, "
                "or crop width_px and height_px"
            )
        return cls.from_tangents(tangents, camera.near_m, camera.far_m)

    @classmethod
    def from_tangents(cls, tangents: ArrayLike, near_m: float, far_m: float) -> Frustum:
        """Frustum in the camera frame from the tangents (4,) of its left, right, top and bottom angles."""
        t = np.array(tangents, dtype=np.float64)
        left, right, top, bottom = t
        normals = np.array(
            [[0, 0, -1.0], [0, 0, 1.0], [-1.0, 0, left], [1.0, 0, -right], [0, -1.0, top], [0, 1.0, -bottom]]
        )
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        rays = np.array([[t[i], t[j], 1.0] for i, j in _RING])
        return cls(
            A=normals,
            b=np.array([-near_m, far_m, 0.0, 0.0, 0.0, 0.0]),
            corners=np.concatenate([near_m * rays, far_m * rays]),
            tangents=t,
            range_m=np.array([near_m, far_m]),
        )

    @classmethod
    def stack(cls, frusta: Sequence[Frustum]) -> Frustum:
        """Many single frusta as one object with a leading dimension (C, ...)."""
        return cls(
            A=np.stack([f.A for f in frusta]),
            b=np.stack([f.b for f in frusta]),
            corners=np.stack([f.corners for f in frusta]),
            tangents=np.stack([f.tangents for f in frusta]),
            range_m=np.stack([f.range_m for f in frusta]),
        )

    def in_world(self, p_world: ArrayLike, q_world: ArrayLike) -> Frustum:
        """Frusta of cameras at p (..., 3), q (..., 4) camera to world; from the camera frame only."""
        p, r = np.asarray(p_world, dtype=np.float64), rotations.to_matrix(q_world)
        a = self.A @ np.swapaxes(r, -1, -2)
        return Frustum(
            A=a,
            b=self.b + np.squeeze(a @ p[..., None], -1),
            corners=self.corners @ np.swapaxes(r, -1, -2) + p[..., None, :],
            tangents=self.tangents,
            range_m=self.range_m,
        )

    def signed_distance(self, points: ArrayLike) -> Array:
        """``max(A x - b)`` (..., K) of points (K, 3) or (..., K, 3): the distance to the border where negative.

        Outside it is a lower bound of the distance, of the right sign.
        """
        p = np.asarray(points, dtype=np.float64)
        return np.asarray(np.max(p @ np.swapaxes(self.A, -1, -2) - self.b[..., None, :], axis=-1))

    def contains(self, points: ArrayLike) -> BoolArray:
        """Whether points (K, 3) or (..., K, 3) are inside or on the border (..., K)."""
        return np.asarray(self.signed_distance(points) <= 0.0)

    def contains_ball(self, centre: ArrayLike, radius_m: ArrayLike) -> BoolArray:
        """Whether balls with centres (K, 3) or (..., K, 3) and radii (...,) or (..., K) are inside (..., K)."""
        return np.asarray(self.signed_distance(centre) + np.asarray(radius_m, dtype=np.float64) <= 0.0)

    def inscribed_ball(self, depth_m: float) -> tuple[Array, Array]:
        """Largest ball with its centre at a depth: centre (..., 3) in the camera frame and radius (...,), m.

        For a centred image and ranges that do not bind the radius is ``depth sin psi``, psi the smallest
        half-angle (bell2019). A negative radius means a depth outside the ranges.
        """
        angle = np.arctan(self.tangents)
        middle = 0.5 * (angle[..., 0::2] + angle[..., 1::2])  # (..., 2) bisectors, across and down
        half = 0.5 * (angle[..., 1::2] - angle[..., 0::2])
        centre = np.concatenate(
            [depth_m * np.tan(middle), np.full((*middle.shape[:-1], 1), depth_m)], axis=-1
        )
        sides = np.min(depth_m * np.sin(half) / np.cos(middle), axis=-1)
        ends = np.minimum(depth_m - self.range_m[..., 0], self.range_m[..., 1] - depth_m)
        return centre, np.minimum(sides, ends)

    def smallest_half_angle(self) -> Array:
        """``psi`` (...,) in rad: half the smaller of the angles across and down."""
        angle = np.arctan(self.tangents)
        return np.asarray(0.5 * np.min(angle[..., 1::2] - angle[..., 0::2], axis=-1))

    def footprint(self, z: float) -> Array:
        """Outline (K, 2), counter-clockwise, of one frustum's cut with the plane at height z; empty if it has none."""
        a, b = self.corners[_EDGES[:, 0]], self.corners[_EDGES[:, 1]]
        above_a, above_b = a[:, 2] > z, b[:, 2] > z
        cut = above_a != above_b
        a, b = a[cut], b[cut]
        if len(a) < 3:
            return np.zeros((0, 2))
        t = ((z - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None]
        points = (a + t * (b - a))[:, :2]
        around = points - points.mean(axis=0)
        return np.asarray(points[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])

    def region(self, name: str) -> PolytopeRegion:
        """One frustum as a region: the field-of-view volume V_c of a stationary camera (harris2020, ch. 3)."""
        return PolytopeRegion(name, self.corners)


@cache
def _of_camera(camera: CameraModel) -> Frustum:
    return Frustum.from_camera(camera)


def frustum_corners(camera: CameraModel) -> Array:
    """Corners (8, 3) of a camera's frustum in the camera frame, in the order of ``Frustum.corners``."""
    return _of_camera(camera).corners.copy()


def footprint(camera: CameraModel, p_world: ArrayLike, q_world: ArrayLike, z: float) -> Array:
    """Outline (K, 2), counter-clockwise, of what a camera at a pose sees at height z; empty if it sees nothing."""
    return _of_camera(camera).in_world(p_world, q_world).footprint(z)


def _border_tangents(pinhole: Pinhole) -> Array:
    (w, h), k = pinhole.size, (_BORDER_SAMPLES if pinhole.distorted else 2)
    along_x, along_y = np.linspace(0.0, w, k), np.linspace(0.0, h, k)
    left = pinhole.normalise(np.stack([np.zeros(k), along_y], axis=1))[:, 0]
    right = pinhole.normalise(np.stack([np.full(k, w), along_y], axis=1))[:, 0]
    top = pinhole.normalise(np.stack([along_x, np.zeros(k)], axis=1))[:, 1]
    bottom = pinhole.normalise(np.stack([along_x, np.full(k, h)], axis=1))[:, 1]
    return np.array([left.max(), right.min(), top.max(), bottom.min()])
