"""Poses of many images from their points alone, up to scale: a first pair, then one image after another.

1. The pair (i, j) of images whose points move most about their common shift, weighed by how many they share.
2. Its rotation and direction: from the essential matrix, and from each decomposition of the homography (points may lie
   on one plane, for which the essential matrix is ambiguous). Baseline 1.
3. Points where the pair's rays meet; every other image's pose from the points known by then (OpenCV's solvePnP), the
   image that sees most of them first; new points as they are seen twice.
4. Of all starts, the one with the smallest median reprojection error over all images.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from camnet.errors import DataError
from camnet.estimation.structure.bundle.problem import Observations
from camnet.estimation.structure.geometry import unit
from camnet.estimation.structure.triangulate import meeting_point
from camnet.estimation.structure.two_view import essential_pose, homography_poses
from camnet.geometry.rotations import conjugate, from_matrix, multiply
from camnet.types import Array

__all__ = ["bootstrap_poses"]

_LEAST_SHARED = 8


def bootstrap_poses(seen: Observations, poses: int, points: int, noise: float) -> tuple[Array, Array]:
    """Poses (P, 3), (P, 4) in the frame of the first image, of arbitrary size.

    Parameters
    ----------
    seen : observations
    poses, points : how many
    noise : standard deviation of normalised coordinates

    Raises
    ------
    DataError
        If no start reaches every image.
    """
    table = np.full((poses, points, 2), np.nan)
    table[seen.pose, seen.point] = seen.xy
    i, j = _pair(table)
    best, least = None, np.inf
    for r, u in _starts(table[i], table[j], noise):
        found = _grow(table, i, j, r, u)
        if found is not None and found[2] < least:
            best, least = found, found[2]
    if best is None:
        raise DataError(
            "no two images give a start from which every image's pose follows; more overlap is needed"
        )
    turns, shifts, _ = best
    # camera i maps x_c = R x + t: to poses in the frame of the first camera
    q = from_matrix(np.swapaxes(turns, 1, 2))
    p = -np.squeeze(np.swapaxes(turns, 1, 2) @ shifts[..., None], -1)
    return np.asarray((p - p[0]) @ turns[0].T), multiply(conjugate(q[0]), q)


def _pair(table: Array) -> tuple[int, int]:
    rays = unit(np.concatenate([table, np.ones((*table.shape[:2], 1))], axis=2))[0]
    best, most = (0, 1), -1.0
    for i in range(len(rays)):
        for j in range(i + 1, len(rays)):
            shared = np.isfinite(rays[i, :, 0] + rays[j, :, 0])
            if shared.sum() < _LEAST_SHARED:
                continue
            # parallax beyond what one turn of the camera explains: displacements about their median
            away = table[j, shared] - table[i, shared]
            value = float(np.median(np.linalg.norm(away - np.median(away, axis=0), axis=1))) * np.sqrt(
                shared.sum()
            )
            if value > most:
                best, most = (i, j), value
    if most < 0.0:
        raise DataError(f"no two images share {_LEAST_SHARED} points; a scale-free start needs that many")
    return best


def _starts(a: Array, b: Array, noise: float) -> Iterator[tuple[Array, Array]]:
    shared = np.isfinite(a[:, 0] + b[:, 0])
    u_a, u_b = (unit(np.column_stack([x[shared], np.ones(int(shared.sum()))]))[0] for x in (a, b))
    essential = essential_pose(u_a, u_b, noise)
    if essential is not None:
        yield essential
    yield from homography_poses(u_a, u_b, noise)


def _grow(table: Array, i: int, j: int, r: Array, u: Array) -> tuple[Array, Array, float] | None:
    """Extrinsics (P, 3, 3), (P, 3) of every image and the median reprojection error; None if an image has no pose."""
    count = len(table)
    turns, shifts, known = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count, dtype=bool)
    turns[i], turns[j], shifts[j] = np.eye(3), r, u
    known[[i, j]] = True
    while True:
        points = _points(table, turns, shifts, known)
        if known.all():
            break
        visible = np.isfinite(table[:, :, 0]) & np.isfinite(points[:, 0])
        shares = np.where(known, -1, visible.sum(axis=1))
        k = int(np.argmax(shares))
        if shares[k] < _LEAST_SHARED:
            return None
        mask = visible[k]
        good, rvec, tvec = cv2.solvePnP(
            points[mask], table[k, mask], np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_SQPNP
        )
        if not good:
            return None
        turns[k], shifts[k] = cv2.Rodrigues(rvec)[0], np.ravel(tvec)
        known[k] = True
    x = np.einsum("pab,mb->pma", turns, points) + shifts[:, None]
    x = np.where(x[..., 2:] > 0.0, x, np.nan)
    error = np.linalg.norm(x[..., :2] / x[..., 2:] - table, axis=2)
    error = np.where(np.isfinite(table[..., 0]) & ~np.isfinite(error), 1.0, error)
    return turns, shifts, float(np.nanmedian(error))


def _points(table: Array, turns: Array, shifts: Array, known: Array) -> Array:
    """Points (M, 3) that at least two known images see, NaN for the others."""
    out = np.full((table.shape[1], 3), np.nan)
    centres = -np.einsum("pba,pb->pa", turns, shifts)
    for m in range(table.shape[1]):
        mine = np.flatnonzero(known & np.isfinite(table[:, m, 0]))
        if len(mine) < 2:
            continue
        rays = unit(np.column_stack([table[mine, m], np.ones(len(mine))]))[0]
        met = meeting_point(centres[mine], np.einsum("pba,pb->pa", turns[mine], rays))
        if met is not None:
            out[m] = met
    return out
