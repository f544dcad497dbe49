"""Level pose in the frame of an old key frame, from its learned points seen again.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``P_i = u_{i/k} X_i`` | ``points`` | (N, 3) | m | learned points, key frame |
| ``[a, l, g]`` | pose | (3,) | m, rad | ahead and left of the key frame's camera, turned left by g |
| ``c_i`` | | (3,) | m | ``R(g)^T (P_i - [a, l])``, in the camera |
| ``z_i`` | ``rays`` | (N, 2) | - | ``[x, y] / z`` seen |
| ``sigma_i^2`` | | (N,) | - | ``noise^2 + (structure |[a, l]| / |P_i|)^2`` |

Gauss-Newton with Huber weights from the key frame's own pose. A learned point errs along its ray, which shows
only as far as the camera has left the ray: hence the second part of sigma. What errs in common, by slip while they were
learned, goes with the way to the key frame, too, and is added to the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.types import Array

__all__ = ["LevelPose", "level_pose"]

_STEPS, _HUBER, _LEAST_DEPTH_M = 12, 2.0, 0.1


@dataclass(frozen=True, eq=False, slots=True)
class LevelPose:
    """Pose (3,): ahead and left in m, turn in rad; its covariance (3, 3); and points that agree with it."""

    pose: Array
    cov: Array
    inliers: int


def level_pose(points: Array, rays: Array, noise: float, structure: float, common: float) -> LevelPose | None:
    """Pose of a level camera from N >= 4 known points; None where it does not settle.

    Parameters
    ----------
    points : (N, 3) in the camera axes of the key frame, m
    rays : (N, 2) normalised coordinates in the image
    noise : standard deviation of ``rays``
    structure, common : relative standard deviations of the points' distances, each by itself and in common
    """
    x = np.zeros(3)
    distance = np.linalg.norm(points, axis=1)
    step, weight, normal = np.ones(3), np.zeros(len(points)), np.eye(3)
    for _ in range(_STEPS):
        residual, rows = _rows(points, rays, x)
        sigma = np.sqrt(noise**2 + (structure * np.linalg.norm(x[:2]) / distance) ** 2)
        size = np.linalg.norm(residual, axis=1) / sigma
        weight = np.minimum(1.0, _HUBER / np.maximum(size, 1e-12)) / sigma**2
        normal = np.einsum("n,nki,nkj->ij", weight, rows, rows)
        if not np.linalg.cond(normal) < 1e9:
            return None
        step = np.linalg.solve(normal, np.einsum("n,nki,nk->i", weight, rows, residual))
        x = x + step
    if not np.linalg.norm(step) < 1e-3:
        return None
    cov = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    cov[:2, :2] += (common * np.linalg.norm(x[:2])) ** 2 * np.eye(2)
    return LevelPose(x, cov, int(np.sum(weight * sigma**2 >= 1.0)))


def _rows(points: Array, rays: Array, x: Array) -> tuple[Array, Array]:
    """Return what is seen less what is expected (N, 2), and derivatives (N, 2, 3) of the latter."""
    c, s = np.cos(x[2]), np.sin(x[2])
    dz, dl = points[:, 2] - x[0], -points[:, 0] - x[1]
    z, left = np.maximum(c * dz + s * dl, _LEAST_DEPTH_M), -s * dz + c * dl
    # derivatives of z and left in ahead, left, turn
    by_z = np.stack([np.full_like(z, -c), np.full_like(z, -s), left], axis=-1)
    by_left = np.stack([np.full_like(z, s), np.full_like(z, -c), -z], axis=-1)
    expected = np.stack([-left / z, points[:, 1] / z], axis=-1)
    rows = np.stack([-by_left / z[:, None], np.zeros_like(by_z)], axis=1)
    rows -= (expected / z[:, None])[..., None] * by_z[:, None]
    return rays - expected, rows
