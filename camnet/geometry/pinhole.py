"""Pinhole camera with OpenCV's lens distortion.

| symbol | name | meaning |
| --- | --- | --- |
| ``x, y`` | normalised coordinates | ``x_cam / z_cam``, ``y_cam / z_cam`` |
| ``u, v`` | pixels | ``u = fx x_d + cx``, ``v = fy y_d + cy`` |
| ``k1..k6`` | radial | OpenCV's order: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]] |
| ``p1, p2``, ``s1..s4`` | tangential, thin prism | |
| ``tx, ty`` | tilt of the sensor, rad | |

The image spans ``[0, width] x [0, height]`` pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from camnet.geometry import rotations
from camnet.geometry.settings import Intrinsics
from camnet.types import Array, BoolArray, Pose

__all__ = ["Pinhole", "camera_pose_from_extrinsics", "extrinsics_from_camera_pose"]

#: Newton steps of the inverse distortion; quadratic convergence needs five or six
_NEWTON_STEPS = 20
_COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A pinhole camera; build it with ``Pinhole.from_settings``.

    Attributes
    ----------
    focal, centre : (2,), (2,) in pixels
    size : (2,) width and height in pixels
    distortion : (14,) OpenCV's coefficients, zero where not given
    """

    focal: Array
    centre: Array
    size: Array
    distortion: Array

    @classmethod
    def from_settings(cls, intrinsics: Intrinsics) -> Pinhole:
        """Camera from validated intrinsics."""
        distortion = np.zeros(14)
        distortion[: len(intrinsics.distortion)] = intrinsics.distortion
        arrays = (
            np.array([intrinsics.fx_px, intrinsics.fy_px]),
            np.array([intrinsics.cx_px, intrinsics.cy_px]),
            np.array([intrinsics.width_px, intrinsics.height_px], dtype=np.float64),
            distortion,
        )
        for array in arrays:
            array.setflags(write=False)
        return cls(*arrays)

    @property
    def matrix(self) -> Array:
        """``K`` (3, 3)."""
        return np.array(
            [[self.focal[0], 0.0, self.centre[0]], [0.0, self.focal[1], self.centre[1]], [0.0, 0.0, 1.0]]
        )

    @property
    def distorted(self) -> bool:
        """Whether any distortion coefficient is not zero."""
        return bool(np.any(self.distortion))

    def project(self, points_cam: ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) in the camera frame, m; NaN for points not in front of the camera."""
        p = np.asarray(points_cam, dtype=np.float64)
        depth = np.where(p[..., 2:] > 0.0, p[..., 2:], np.nan)
        return np.asarray(self.focal * _distort(p[..., :2] / depth, self.distortion) + self.centre)

    def project_world(self, points_world: ArrayLike, p_world: ArrayLike, q_world: ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) in the world, seen by a camera at pose p (3,), q (4,) camera to world."""
        offset = np.asarray(points_world, dtype=np.float64) - np.asarray(p_world, dtype=np.float64)
        return self.project(offset @ rotations.to_matrix(q_world))

    def in_image(self, pixels: ArrayLike) -> BoolArray:
        """Whether pixels (..., 2) lie in the image (...,); NaN does not."""
        u = np.asarray(pixels, dtype=np.float64)
        return np.asarray(np.all((u >= 0.0) & (u <= self.size), axis=-1))

    def normalise(self, pixels: ArrayLike) -> Array:
        """Normalised, undistorted coordinates (..., 2) of pixels (..., 2); NaN where the distortion has no inverse."""
        seen = (np.asarray(pixels, dtype=np.float64) - self.centre) / self.focal
        if not self.distorted:
            return np.asarray(seen)
        x = seen.copy()
        with np.errstate(all="ignore"):
            for _ in range(_NEWTON_STEPS):
                residual, jacobian = (
                    _distort(x, self.distortion) - seen,
                    _distortion_jacobian(x, self.distortion),
                )
                det = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
                step = np.stack(
                    [
                        jacobian[..., 1, 1] * residual[..., 0] - jacobian[..., 0, 1] * residual[..., 1],
                        jacobian[..., 0, 0] * residual[..., 1] - jacobian[..., 1, 0] * residual[..., 0],
                    ],
                    axis=-1,
                )
                x = x - step / det[..., None]
            wrong = np.max(np.abs(_distort(x, self.distortion) - seen), axis=-1) > 1e-9
        return np.where(wrong[..., None], np.nan, x)

    def unproject(self, pixels: ArrayLike) -> Array:
        """Rays (..., 3) of unit length in the camera frame through pixels (..., 2)."""
        x = self.normalise(pixels)
        ray = np.concatenate([x, np.ones_like(x[..., :1])], axis=-1)
        return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))

    def field_of_view(self) -> tuple[float, float]:
        """Horizontal and vertical angle in rad between the middles of opposite image borders."""
        (w, h), (cx, cy) = self.size, self.centre
        left, right, top, bottom = self.unproject([[0.0, cy], [w, cy], [cx, 0.0], [cx, h]])
        return float(np.arccos(left @ right)), float(np.arccos(top @ bottom))


def _distort(x: NDArray[Any], d: Array) -> NDArray[Any]:
    """OpenCV's distortion of normalised coordinates (..., 2); also of complex ones, for exact derivatives."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tx, ty = d
    a, b = x[..., 0], x[..., 1]
    r2 = a * a + b * b
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    bent = np.stack(
        [
            a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a) + r2 * (s1 + r2 * s2),
            b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b + r2 * (s3 + r2 * s4),
        ],
        axis=-1,
    )
    return bent if tx == 0.0 and ty == 0.0 else _tilt(bent, tx, ty)


def _tilt(x: NDArray[Any], tx: float, ty: float) -> NDArray[Any]:
    """Image on a sensor turned by ``tx`` about x, then ``ty`` about y, scaled so that the optical axis stays."""
    cx, sx, cy, sy = np.cos(tx), np.sin(tx), np.cos(ty), np.sin(ty)
    turn = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]]
    )
    onto = np.array([[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]])
    homogeneous = np.concatenate([x, np.ones_like(x[..., :1])], axis=-1) @ (onto @ turn).T
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])


def _distortion_jacobian(x: Array, d: Array) -> Array:
    """Jacobian (..., 2, 2) of the distortion, by a complex step: exact to rounding."""
    columns = [_distort(x + 1j * _COMPLEX_STEP * axis, d).imag / _COMPLEX_STEP for axis in np.eye(2)]
    return np.stack(columns, axis=-1)


def camera_pose_from_extrinsics(r_cam_from_world: ArrayLike, t_cam: ArrayLike) -> Pose:
    """Camera pose in the world from ``x_cam = R x_world + t``, as calibration files (KRTD, OpenCV) state it.

    Parameters
    ----------
    r_cam_from_world : (3, 3) rotation matrix
    t_cam : (3,) translation, m

    Returns
    -------
    Pose
        Optical centre ``-R^T t`` and the quaternion camera to world.
    """
    r = np.asarray(r_cam_from_world, dtype=np.float64)
    return Pose(-r.T @ np.asarray(t_cam, dtype=np.float64), rotations.from_matrix(r.T))


def extrinsics_from_camera_pose(pose: Pose) -> tuple[Array, Array]:
    """``R`` (3, 3) and ``t`` (3,) with ``x_cam = R x_world + t``: the inverse of ``camera_pose_from_extrinsics``."""
    r = rotations.to_matrix(pose.q).T
    return r, -r @ pose.p
