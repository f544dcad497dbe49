"""Rotation and direction of a key frame from two views of the same points.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``u_{i/k}``, ``u_{i/c}`` | ``u_ik``, ``u_ic`` | (N, 3) | - | directions of N >= 4 points in the two frames |
| ``R_{k/c}``, ``u_{k/c}`` | ``r_kc``, ``u_kc`` | (3, 3), (3,) | - | key frame in the camera frame |
| ``n_i = u_{i/c} x R_{k/c} u_{i/k}`` | | (N, 3) | - | normals of the epipolar planes: ``n_i^T u_{k/c} = 0`` |
| ``E = u_{k/c}^x R_{k/c}`` | | (3, 3) | - | essential matrix, ``u_ic^T E u_ik = 0`` |
| ``H`` | | (3, 3) | - | homography of a plane, ``x_c ~ H x_k`` on normalised coordinates |
| ``sigma_u``, ``sigma_0`` | ``image_rad``, ``expected_rad`` | | rad | noise of directions, error of the expected one |

Four sources, as bell2019 leaves open (section 2.1):

- `essential_pose`: five points and RANSAC (OpenCV), for points that are not on one plane;
- `homography_pose`: for points on a plane; of the decompositions that keep the points in front, the one nearest what
  is expected;
- `aided_direction`: the gyro's rotation, and the direction that fits ``n_i^T u = 0`` in the sense of least squares,
  ``min sum (n_i^T u)^2 / (2 sigma_u^2) + |u - u_0|^2 / sigma_0^2`` about the expected direction u_0;
- the expected pose itself, by odometry since the key frame (`odometry.dead_reckon`).

Points that fill a small part of the image say little of the direction along the line of sight: there the normals are
all but parallel and the expected direction decides, with weights that follow from the stated noise.
"""

from __future__ import annotations

import cv2
import numpy as np

from camnet.errors import ConfigError
from camnet.types import Array

__all__ = ["aided_direction", "essential_pose", "homography_pose", "homography_poses", "turn_between"]

_LEAST_ESSENTIAL, _LEAST_HOMOGRAPHY = 5, 4


def _normalised(u: Array, least: int) -> Array:
    if u.ndim != 2 or len(u) < least:
        raise ConfigError(f"{len(u)} points: at least {least} are needed for two views")
    return np.asarray(u[:, :2] / u[:, 2:])


def essential_pose(u_ik: Array, u_ic: Array, noise: float) -> tuple[Array, Array] | None:
    """``R_{k/c}`` (3, 3) and ``u_{k/c}`` (3,) from points in general position; None where none is found.

    Parameters
    ----------
    u_ik, u_ic : (N, 3) directions, N >= 5, in front of the cameras
    noise : standard deviation of normalised coordinates (pixels / focal length)

    Raises
    ------
    ConfigError
        If there are fewer than five points.
    """
    x_k, x_c = _normalised(u_ik, _LEAST_ESSENTIAL), _normalised(u_ic, _LEAST_ESSENTIAL)
    essential, inliers = cv2.findEssentialMat(
        x_k, x_c, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=3.0 * max(noise, 1e-9)
    )
    if np.shape(essential) != (3, 3):
        return None
    count, r_kc, t, _ = cv2.recoverPose(essential, x_k, x_c, np.eye(3), mask=inliers.copy())
    return None if count < _LEAST_ESSENTIAL else (np.asarray(r_kc), np.asarray(t[:, 0]))


def homography_pose(
    u_ik: Array, u_ic: Array, noise: float, expected: tuple[Array, Array]
) -> tuple[Array, Array] | None:
    """``R_{k/c}`` (3, 3) and ``u_{k/c}`` (3,) from points on a plane; None where none is found.

    Parameters
    ----------
    u_ik, u_ic : (N, 3) directions, N >= 4, in front of the cameras
    noise : standard deviation of normalised coordinates (pixels / focal length)
    expected : rotation and direction that choose among the decompositions

    Raises
    ------
    ConfigError
        If there are fewer than four points.
    """
    best: tuple[Array, Array] | None = None
    least = np.inf
    for r_kc, u_kc in homography_poses(u_ik, u_ic, noise):
        away = turn_between(r_kc, expected[0]) + float(np.arccos(np.clip(u_kc @ expected[1], -1.0, 1.0)))
        if away < least:
            best, least = (r_kc, u_kc), away
    return best


def homography_poses(u_ik: Array, u_ic: Array, noise: float) -> list[tuple[Array, Array]]:
    """Every decomposition ``R_{k/c}``, ``u_{k/c}`` of a homography that keeps the plane in front of the key frame.

    The arguments and the error raised are those of `homography_pose`.
    """
    x_k, x_c = _normalised(u_ik, _LEAST_HOMOGRAPHY), _normalised(u_ic, _LEAST_HOMOGRAPHY)
    homography, _ = cv2.findHomography(x_k, x_c, cv2.RANSAC, 3.0 * max(noise, 1e-9))
    if np.shape(homography) != (3, 3):
        return []
    _, turns, shifts, normals = cv2.decomposeHomographyMat(homography, np.eye(3))
    out = []
    for turn, shift, n in zip(turns, shifts, normals, strict=True):
        r_kc, t = np.array(turn, dtype=np.float64), np.array(shift, dtype=np.float64)
        length, side = np.linalg.norm(t), u_ik @ n[:, 0]
        # the plane must be in front of the key frame for every point
        if length > 0.0 and np.min(side) * np.max(side) > 0.0:
            sign = 1.0 if np.median(side) > 0.0 else -1.0
            out.append((r_kc, np.asarray(sign * t[:, 0] / length)))
    return out


def turn_between(a: Array, b: Array) -> float:
    """Angle in rad between two rotations (3, 3)."""
    return float(np.arccos(np.clip(0.5 * (np.trace(a.T @ b) - 1.0), -1.0, 1.0)))


def aided_direction(
    u_ik: Array, u_ic: Array, r_kc: Array, expected: Array, image_rad: float, expected_rad: float
) -> Array:
    """``u_{k/c}`` (3,) from a known rotation and the direction that is expected.

    Parameters
    ----------
    u_ik, u_ic : (N, 3) directions of the points; any N
    r_kc : (3, 3) rotation, from the gyro
    expected : (3,) direction by odometry
    image_rad, expected_rad : standard deviations of ``u_ik``, ``u_ic``, and of ``expected``, rad
    """
    n = np.cross(u_ic, u_ik @ r_kc.T)
    # u = u_0 + B a on the plane across u_0: two unknowns
    least = np.eye(3)[np.argmin(np.abs(expected))]
    b1 = np.cross(expected, least)
    b1 /= np.linalg.norm(b1)
    rows = n @ np.column_stack([b1, np.cross(expected, b1)])
    weight = 0.5 / image_rad**2
    normal = weight * rows.T @ rows + np.eye(2) / expected_rad**2
    a = np.linalg.solve(normal, -weight * rows.T @ (n @ expected))
    u = expected + a[0] * b1 + a[1] * np.cross(expected, b1)
    return np.asarray(u / np.linalg.norm(u))
