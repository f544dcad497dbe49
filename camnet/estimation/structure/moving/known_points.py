"""Pose of a camera and points known in another frame, image after image: Gauss-Newton on the reprojection error.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``X_i`` | ``points`` | (N, 3) | m | points in their frame b |
| ``t``, ``q`` | ``t``, ``q`` | (3,), (4,) | m, - | ``x_i = R(q) X_i + t`` in the camera frame |
| ``z_i`` | ``xy`` | (N, 2) | - | seen, normalised coordinates; NaN where not |
| ``J`` | | (2, 6) | | derivative of ``x_xy / x_z`` for ``t + dt``, ``R Exp(dr)`` |
| ``C`` | ``covariance`` | (6, 6) | m, rad | ``s^2 (sum J^T J)^-1``, s the noise of a coordinate; order dt, dr |

An image starts from the pose in the one before; where there is none within ``_STALE_S`` (the first image, a
re-sighting) from OpenCV's SQPnP. A pose needs four points and a reprojection error that fits the noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import exp, multiply, normalise, to_matrix
from camnet.types import Array, BoolArray

__all__ = ["PoseTrack", "track_poses"]

_STALE_S = 0.5
_STEPS, _ENOUGH, _LEAST = 10, 1e-9, 4
#: an image is no use beyond this many times the noise, root mean square over its points
_GATE = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class PoseTrack:
    """Poses at K times.

    Attributes
    ----------
    t_s : (K,) s
    seen : (K,) whether the image gave a pose; the rest is NaN
    p, q : (K, 3) m, (K, 4) frame of the points to camera frame
    covariance : (K, 6, 6) of translation (camera axes, m) and turn (axes of the points' frame, rad)
    """

    t_s: Array
    seen: BoolArray
    p: Array
    q: Array
    covariance: Array


@cached_njit
def _refine(points: Array, xy: Array, t: Array, q: Array, normal: Array) -> float:
    """Move t, q to the least error; returns its mean square over the points (inf behind the camera)."""
    gradient = np.empty(6)
    jac = np.empty((2, 6))
    square = math.inf
    for step in range(_STEPS):
        r = to_matrix(q)
        normal[:] = 0.0
        gradient[:] = 0.0
        total, count = 0.0, 0
        for i in range(len(points)):
            if not math.isfinite(xy[i, 0]):
                continue
            y = r @ points[i]
            x = y + t
            if x[2] <= 1e-3:
                return math.inf
            u, v, inv = x[0] / x[2], x[1] / x[2], 1.0 / x[2]
            e0, e1 = xy[i, 0] - u, xy[i, 1] - v
            total += e0 * e0 + e1 * e1
            count += 1
            for k in range(3):
                # column k of -R X^x: R (e_k x X)
                a, b = (k + 1) % 3, (k + 2) % 3
                turn = np.empty(3)
                for m in range(3):
                    turn[m] = r[m, b] * points[i, a] - r[m, a] * points[i, b]
                jac[0, 3 + k] = inv * (turn[0] - u * turn[2])
                jac[1, 3 + k] = inv * (turn[1] - v * turn[2])
            jac[0, 0], jac[0, 1], jac[0, 2] = inv, 0.0, -u * inv
            jac[1, 0], jac[1, 1], jac[1, 2] = 0.0, inv, -v * inv
            for m in range(6):
                gradient[m] += jac[0, m] * e0 + jac[1, m] * e1
                for n in range(6):
                    normal[m, n] += jac[0, m] * jac[0, n] + jac[1, m] * jac[1, n]
        square = total / max(2 * count, 1)
        if step == _STEPS - 1:
            break
        delta = np.empty(6)
        delta[:] = np.linalg.solve(normal + 1e-12 * np.eye(6), gradient)
        t += delta[:3]
        q[:] = normalise(multiply(q, exp(delta[3:])))
        if np.max(np.abs(delta)) < _ENOUGH:
            break
    return square


def track_poses(t_s: Array, xy: Array, points: Array, noise: float) -> PoseTrack:
    """Pose of the points' frame in the camera frame at every time.

    Parameters
    ----------
    t_s : (K,) times, s, increasing
    xy : (K, N, 2) normalised coordinates, NaN where a point is not seen
    points : (N, 3) points in their frame, m; those with NaN are left out
    noise : standard deviation of each coordinate
    """
    known = np.isfinite(points[:, 0])
    points, xy = np.ascontiguousarray(points[known]), np.ascontiguousarray(xy[:, known])
    count = len(t_s)
    p, q, covariance = (
        np.full((count, 3), np.nan),
        np.full((count, 4), np.nan),
        np.full((count, 6, 6), np.nan),
    )
    seen = np.zeros(count, dtype=bool)
    last = -1
    for k in range(count):
        if np.isfinite(xy[k, :, 0]).sum() < _LEAST:
            continue
        fresh = last < 0 or t_s[k] - t_s[last] > _STALE_S
        start = _start(points, xy[k]) if fresh else (p[last].copy(), q[last].copy())
        normal = np.zeros((6, 6))
        if start is None or not _refine(points, xy[k], start[0], start[1], normal) < (_GATE * noise) ** 2:
            start = _start(points, xy[k])
            if start is None or not _refine(points, xy[k], start[0], start[1], normal) < (_GATE * noise) ** 2:
                continue
        (p[k], q[k]), covariance[k], seen[k] = start, noise**2 * np.linalg.inv(normal), True
        last = k
    return PoseTrack(np.asarray(t_s), seen, p, q, covariance)


def _start(points: Array, xy: Array) -> tuple[Array, Array] | None:
    mine = np.isfinite(xy[:, 0])
    good, turn, place = cv2.solvePnP(points[mine], xy[mine], np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_SQPNP)
    if not good:
        return None
    rotvec: Array = np.asarray(np.ravel(turn), dtype=np.float64)
    return np.asarray(np.ravel(place), dtype=np.float64), exp(rotvec)
