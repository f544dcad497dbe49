"""Poses that explain where known points of a target appear in an image, and the choice between two of them.

| symbol | name | unit |
| --- | --- | --- |
| ``X_i`` | points in the body frame | m |
| ``x_i`` | normalised image coordinates, lens distortion taken out | - |
| ``e`` | root mean square over the points of the reprojection error's length | px |
| ``L`` | evidence for the branch in force: ``sum_t lambda^(T - t) (S_other - S_this) / (2 s^2)`` | - |
| ``S`` | sum of squared reprojection errors of a branch | px^2 |

Points in one plane leave two poses, about mirror images in the direction of sight, whose errors differ by what
perspective makes of the target's depth (IPPE finds both). The branch nearest the last pose is kept; evidence gathered
over frames changes it when it was the wrong one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from camnet.geometry.rotations import from_matrix
from camnet.geometry.rotations_compiled import conjugate, exp, log, multiply, rotate, to_matrix
from camnet.types import Array, Pose

__all__ = ["BranchKeeper", "Candidate", "in_one_plane", "plane_of", "solve_pose"]

#: evidence is forgotten over about this many frames
_FRAMES = 30
#: how much evidence against a branch changes it (a likelihood ratio of e^5), and where it is capped
_CHANGE, _CAP = -5.0, 10.0
#: the last pose says nothing about the branch after this time, s
_STALE_S = 1.0
_IDENTITY = np.eye(3)
_METHODS = {
    "square": cv2.SOLVEPNP_IPPE_SQUARE,
    "ippe": cv2.SOLVEPNP_IPPE,
    "sqpnp": cv2.SOLVEPNP_SQPNP,
}


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """A pose of the target in the camera frame, p (3,) m and q (4,), and its reprojection error e, pixels."""

    p: Array
    q: Array
    error_px: float


def in_one_plane(points: Array) -> bool:
    """Whether points (K, 3) lie in a plane to within a thousandth of their size."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= 1e-3 * spread[0])


def plane_of(points: Array) -> Pose:
    """Frame on the body of points (K, 3) in one plane: about their mean, z across the plane."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle)[2]
    axes[2] *= np.linalg.det(axes)
    return Pose(middle, from_matrix(axes.T))


def solve_pose(
    points: Array, frame: Pose, seen: Array, focal_px: float, method: str, refine: bool = False
) -> list[Candidate]:
    """Poses of a target whose points appear at normalised coordinates ``seen`` (K, 2), best first.

    Parameters
    ----------
    points : (K, 3) in a frame on the target, m; for ``ippe`` their z are zero, for ``square`` they are the corners of
        a square about the origin, clockwise from the top left
    frame : pose of that frame in the target's body
    method : ``ippe`` and ``square`` (two poses) or ``sqpnp``
    focal_px : focal length in which errors are stated
    refine : end with Levenberg-Marquardt
    """
    found = _solve(points, seen, _METHODS[method])
    if refine:
        found = [_refined(points, seen, r, t) for r, t in found]
    back = conjugate(frame.q)
    poses = []
    for one in _rated(points, seen, focal_px, found):
        q = multiply(one.q, back)
        poses.append(Candidate(one.p - rotate(q, frame.p), q, one.error_px))
    return poses


def _solve(points: Array, seen: Array, method: int) -> list[tuple[Array, Array]]:
    try:
        count, turns, places, _ = cv2.solvePnPGeneric(points, seen, _IDENTITY, None, flags=method)
    except cv2.error:  # the solvers give up on degenerate sets of points
        return []
    pairs = zip(turns[:count], places[:count], strict=True)
    return [(np.asarray(r, dtype=np.float64), np.asarray(t, dtype=np.float64)) for r, t in pairs]


def _refined(points: Array, seen: Array, turn: Array, place: Array) -> tuple[Array, Array]:
    r, t = cv2.solvePnPRefineLM(points, seen, _IDENTITY, None, turn, place)
    return np.asarray(r, dtype=np.float64), np.asarray(t, dtype=np.float64)


def _rated(points: Array, seen: Array, focal_px: float, found: list[tuple[Array, Array]]) -> list[Candidate]:
    out = []
    for turn, place in found:
        q = exp(turn.ravel())
        p = place.ravel()
        there = points @ to_matrix(q).T + p
        if not (np.isfinite(there).all() and (there[:, 2] > 0.0).all()):
            continue
        miss = there[:, :2] / there[:, 2:] - seen
        out.append(Candidate(p, q, focal_px * math.sqrt(float(np.sum(miss * miss)) / len(seen))))
    return sorted(out, key=lambda one: one.error_px)


class BranchKeeper:
    """Chooses between the two poses of one target seen by one camera, frame after frame.

    Parameters
    ----------
    noise_px : standard deviation s of a coordinate of a point in the image
    """

    def __init__(self, noise_px: float) -> None:
        self._variance = max(noise_px, 0.02) ** 2
        self._q_world: Array | None = None
        self._t_s = -math.inf
        self._evidence = 0.0

    def choose(
        self, candidates: list[Candidate], points: int, q_camera_world: Array, t_s: float
    ) -> Candidate:
        """Return one of the candidates (at least one, best first), seen in ``points`` points.

        ``q_camera_world`` (4,) is the camera's orientation: continuity is judged in the world.
        """
        if self._q_world is None or t_s - self._t_s > _STALE_S:
            self._evidence = 0.0
            index = 0
        else:
            back = multiply(conjugate(self._q_world), q_camera_world)
            turned = [float(np.linalg.norm(log(multiply(back, one.q)))) for one in candidates]
            index = int(np.argmin(turned))
        if len(candidates) > 1:
            index = self._weigh(candidates, points, index)
        self._q_world, self._t_s = multiply(q_camera_world, candidates[index].q), t_s
        return candidates[index]

    def _weigh(self, candidates: list[Candidate], points: int, index: int) -> int:
        """Add this frame's evidence for candidate ``index``; the other one if the sum speaks against it."""
        this, other = candidates[index].error_px ** 2, candidates[1 - index].error_px ** 2
        gain = points * (other - this) / (2.0 * self._variance)
        self._evidence = min(_CAP, (1.0 - 1.0 / _FRAMES) * self._evidence + gain)
        if self._evidence > _CHANGE:
            return index
        self._evidence = min(_CAP, -self._evidence)
        return 1 - index
