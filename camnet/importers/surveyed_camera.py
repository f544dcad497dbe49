"""A surveyed camera, and the checks that every reader of camera files makes: units, ranges, axes.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| K | upper triangular intrinsic matrix | 3x3 | px |
| R | rotation, world to camera (x right, y down, z forward) | 3x3 | |
| T | translation, ``x_cam = R x_world + T`` | 3 | m |
| C | optical centre, ``-R^T T`` | 3 | m |
| D | distortion in OpenCV's order (k1, k2, p1, p2, k3, ...) | any up to 14 | |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations import from_matrix, to_matrix
from camnet.geometry.settings import FixedPose, Intrinsics
from camnet.types import Array

__all__ = ["CameraRecord", "SurveyedCamera", "camera_of", "intrinsics_of", "placed_camera", "rotation_of"]

_ORTHONORMAL_TOLERANCE = 1e-3
_OPENCV_LENGTHS = (0, 4, 5, 8, 12, 14)  # the numbers of distortion coefficients that OpenCV accepts

#: widest view: image size over focal length (170 degrees); lens models end before
_WIDEST = 2.0 * math.tan(math.radians(85.0))
#: narrowest view: focal length over image size (0.1 degrees)
_NARROWEST = 0.5 / math.tan(math.radians(0.05))

#: how far the principal point may be from the image's middle, as a share of its size
_OFF_CENTRE = 0.35


@dataclass(frozen=True, eq=False, slots=True)
class CameraRecord:
    """One camera as a file describes it: R (3, 3) and T (3,) in the file's unit, or None where it states no pose."""

    name: str
    intrinsics: Intrinsics
    rotation: Array | None = None
    translation: Array | None = None


@dataclass(frozen=True, eq=False, slots=True)
class SurveyedCamera:
    """One camera.

    Attributes
    ----------
    name : the camera's, often the file's stem
    intrinsics : pinhole model and distortion
    p_world : (3,) optical centre, m
    q_world : (4,) camera frame to world, scalar first, q0 not negative
    """

    name: str
    intrinsics: Intrinsics
    p_world: Array
    q_world: Array

    def fixed_pose(self) -> FixedPose:
        """Return the pose as a world file states it."""
        x, y, z = self.p_world.tolist()
        a, b, c, d = self.q_world.tolist()
        return FixedPose(position_m=(x, y, z), quaternion_wxyz=(a, b, c, d))

    def cam_from_world(self) -> tuple[Array, Array]:
        """Return R (3, 3) and T (3,) of ``x_cam = R x_world + T``."""
        rotation = to_matrix(self.q_world).T
        return rotation, -rotation @ self.p_world


def camera_of(name: str, intrinsics: Intrinsics, rotation: Array, translation: Array) -> SurveyedCamera:
    """Return the camera of ``x_cam = R x_world + T``: R (3, 3) a rotation, T (3,) in m; its centre is ``-R^T T``."""
    return placed_camera(name, intrinsics, -rotation.T @ np.asarray(translation), rotation.T)


def placed_camera(name: str, intrinsics: Intrinsics, p_world: Array, world_r_cam: Array) -> SurveyedCamera:
    """Return the camera with its centre at ``p_world`` (3,), m, and axes ``world_r_cam`` (3, 3), camera to world."""
    p, q_world = np.array(p_world, dtype=np.float64), from_matrix(world_r_cam)
    p.setflags(write=False)
    q_world.setflags(write=False)
    return SurveyedCamera(name, intrinsics, p, q_world)


def rotation_of(where: str, r: Array) -> Array:
    """Check that R is a rotation to the file's precision and return the nearest exact one."""
    gap = float(np.max(np.abs(r @ r.T - np.eye(3))))
    if gap > _ORTHONORMAL_TOLERANCE:
        raise DataError(
            f"{where}: R is not orthonormal, R R^T differs from the identity by {gap:.3g}; "
            f"at most {_ORTHONORMAL_TOLERANCE:g} is allowed"
        )
    if np.linalg.det(r) < 0:
        raise DataError(f"{where}: R has determinant {np.linalg.det(r):.3f}, a reflection; +1 was expected")
    u, _, vt = np.linalg.svd(r)
    return np.asarray(u @ vt)


def _degrees(focal: float, size: float) -> float:
    return 2.0 * math.degrees(math.atan(0.5 * size / focal))


def intrinsics_of(
    where: str, k: Array, distortion: Sequence[float], width_px: int, height_px: int
) -> Intrinsics:
    """Check K (3, 3) and D against the size of the image and return them as intrinsics.

    Raises
    ------
    DataError
        K is not a pinhole matrix without skew, a focal length cannot be in pixels, the principal point is outside of
        the image or far from its middle, or D is longer than OpenCV's models.
    """
    if width_px <= 0 or height_px <= 0:
        raise DataError(
            f"{where}: the image size given is {width_px} x {height_px} px; both must be positive"
        )
    if k[2].tolist() != [0, 0, 1] or k[1, 0] != 0:
        raise DataError(f"{where}: K is {k.tolist()}; an upper triangle with last row 0 0 1 was expected")
    if k[0, 1] != 0:
        raise DataError(f"{where}: K has skew {k[0, 1]:g}; only cameras without skew (0) are supported")
    for name, value, size in (("fx", k[0, 0], width_px), ("fy", k[1, 1], height_px)):
        if value <= 0:
            raise DataError(f"{where}: {name} is {value:g}; a positive focal length in pixels was expected")
        if value < size / _WIDEST:
            raise DataError(
                f"{where}: {name} is {value:g}, a view of {_degrees(value, size):.1f} degrees across {size} px; a "
                f"focal length in pixels, for less than {_degrees(1.0, _WIDEST):.0f} degrees, was expected"
            )
        if value > size * _NARROWEST:
            raise DataError(
                f"{where}: {name} is {value:g}, a view of {_degrees(value, size):.2g} degrees across {size} px; a "
                "focal length in pixels was expected"
            )
    for name, value, size in (("cx", k[0, 2], width_px), ("cy", k[1, 2], height_px)):
        if not 0 < value < size:
            raise DataError(f"{where}: {name} is {value:g}; the image ends at {size} px: is its size right?")
        if abs(value / size - 0.5) > _OFF_CENTRE:
            raise DataError(
                f"{where}: {name} is {value:g}, far from the middle of {size} px: are width and height right?"
            )
    if len(distortion) > _OPENCV_LENGTHS[-1]:
        raise DataError(f"{where}: D has {len(distortion)} numbers; OpenCV's models have at most 14")
    length = next(n for n in _OPENCV_LENGTHS if n >= len(distortion))
    padded = (*distortion, *([0.0] * (length - len(distortion))))
    return Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=float(k[0, 0]),
        fy_px=float(k[1, 1]),
        cx_px=float(k[0, 2]),
        cy_px=float(k[1, 2]),
        distortion=padded if any(padded) else (),
    )
