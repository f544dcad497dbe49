"""Camera path and points from tracked images, with or without odometry: all poses at once.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| ``dp``, ``dR`` | odometry | m, - | ``R_i^T (p_j - p_i)``, ``q_i^-1 q_j`` from image to image |
| share, ``s_R`` | ``step_share``, ``step_turn_rad`` | -, rad | SD of a step's components by its length; SD of a turn |
| ``s`` | ``scale_sd`` | - | SD of the odometry's scale, common to all steps |
| S | extent | m | ``sqrt(sum |p_i - mean p|^2)``; its relative SD, from H^-1, is the scale's |
| chi2 | | | squares of the odometry's residuals after the adjustment, 6 (P - 1) of them |

Points start where rays from the odometry's poses meet and the whole is adjusted by `bundle`, first with ten times the
noise.
Without odometry the pair of images with the largest parallax gives the first two poses (essential matrix, and each
decomposition of a homography, whichever fits all images best), the others follow from the points; the size of the
result is then arbitrary: its extent is 1.

Odometry and images that do not belong together show in chi2 or in the reprojection error: ``consistent`` is then false.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field
from scipy.stats import chi2

from camnet.errors import DataError
from camnet.estimation.structure.bootstrap import bootstrap_poses
from camnet.estimation.structure.bundle.covariance import covariance
from camnet.estimation.structure.bundle.plain import residuals
from camnet.estimation.structure.bundle.preintegrate import Step
from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState, Observations, build_problem
from camnet.estimation.structure.bundle.solver import adjust
from camnet.estimation.structure.tracks import TrackedFrame
from camnet.estimation.structure.triangulate import start_points
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import conjugate, multiply, to_matrix
from camnet.settings import Positive, Settings
from camnet.types import Array, IntArray, Pose

__all__ = ["Reconstruction", "ReconstructionSettings", "reconstruct"]

_FLOOR_M, _COARSE, _CONFIDENCE, _WORST_NOISE = 1e-4, 10.0, 0.9999, 4.0


class ReconstructionSettings(Settings):
    """See the module's table; ``noise_px`` is that of a corner, ``huber`` in units of it."""

    noise_px: Positive = 0.5
    huber: Positive = 3.0
    step_share: Positive = 0.1
    step_turn_rad: Positive = 0.02
    scale_sd: Positive = 0.1
    least_views: int = Field(default=2, ge=2)


@dataclass(frozen=True, eq=False, slots=True)
class Reconstruction:
    """Result.

    Attributes
    ----------
    t_s : (P,) times, s
    p, q : (P, 3), (P, 4) camera poses in the frame of the first camera, m (without odometry: extent 1)
    ids, points : (M,), (M, 3) numbers and positions of the points in that frame
    metric : whether there was odometry, so that lengths are metres
    scale : estimated odometry scale s, ``v_odometry = (1 + s) v``; 0 without odometry
    scale_sd : relative standard deviation of the size of the result; None without odometry
    reprojection_px : root mean square of the reprojection errors a coordinate
    odometry_chi2, odometry_limit : squares of the odometry's residuals, and their 99.99 % limit; None without odometry
    consistent : whether images and odometry fit each other
    """

    t_s: Array
    p: Array
    q: Array
    ids: IntArray
    points: Array
    metric: bool
    scale: float
    scale_sd: float | None
    reprojection_px: float
    odometry_chi2: float | None
    odometry_limit: float | None
    consistent: bool


def reconstruct(
    frames: Sequence[TrackedFrame],
    camera: Pinhole,
    odometry: Sequence[Pose] | None,
    settings: ReconstructionSettings,
) -> Reconstruction:
    """Reconstruct path and points.

    Parameters
    ----------
    frames : P >= 2 tracked images
    camera : the pinhole
    odometry : the odometry's camera poses at the images, camera frame to any frame; None: result without scale
    settings : see `ReconstructionSettings`

    Raises
    ------
    DataError
        If fewer than two images share enough points, or no start fits.
    """
    seen, ids = _observations(frames, camera, settings)
    if odometry is None:
        p, q = bootstrap_poses(seen, len(frames), len(ids), settings.noise_px / float(np.mean(camera.focal)))
    else:
        p, q = _relative(odometry)
    problem, state = _adjusted(seen, len(ids), p, q, odometry is not None, settings)
    if odometry is None:
        state = _unit_extent(state)
    return _result(frames, camera, ids, problem, state, odometry is not None, settings)


def _observations(
    frames: Sequence[TrackedFrame], camera: Pinhole, settings: ReconstructionSettings
) -> tuple[Observations, IntArray]:
    """Observations of the points that enough images saw, and the points' numbers."""
    every, count = np.unique(np.concatenate([f.ids for f in frames]), return_counts=True)
    ids = every[count >= settings.least_views]
    if len(frames) < 2 or len(ids) < 5:
        raise DataError(
            f"{len(frames)} images share {len(ids)} points: two images and five points in common are needed"
        )
    pose, point, pixels = [], [], []
    for k, frame in enumerate(frames):
        kept = np.isin(frame.ids, ids)
        pose.append(np.full(int(kept.sum()), k))
        point.append(np.searchsorted(ids, frame.ids[kept]))
        pixels.append(frame.pixels[kept])
    xy = camera.normalise(np.concatenate(pixels))
    sd = np.full(len(xy), settings.noise_px / float(np.mean(camera.focal)))
    return Observations(np.concatenate(pose), np.concatenate(point), xy, sd), ids


def _relative(poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Poses in the frame of the first."""
    p, q = np.array([x.p for x in poses]), np.array([x.q for x in poses])
    return (p - p[0]) @ to_matrix(q[0]), multiply(conjugate(q[0]), q)


def _steps(p: Array, q: Array, settings: ReconstructionSettings) -> list[Step | None]:
    r = to_matrix(q)
    out: list[Step | None] = []
    for i in range(len(p) - 1):
        shift = r[i].T @ (p[i + 1] - p[i])
        sd = settings.step_share * float(np.linalg.norm(shift)) + _FLOOR_M
        none = np.zeros((3, 3))
        turn = multiply(conjugate(q[i]), q[i + 1])
        out.append(Step(shift, turn, none, none, sd**2 * np.eye(3), settings.step_turn_rad))
    return out


def _adjusted(
    seen: Observations, count: int, p: Array, q: Array, odometry: bool, settings: ReconstructionSettings
) -> tuple[BundleProblem, BundleState]:
    """Adjust twice, first with ten times the noise."""
    anchor, points = start_points(seen, count, p, q)
    none: list[Step | None] = [None] * (len(p) - 1)
    steps = _steps(p, q, settings) if odometry else none
    problem = build_problem(seen, anchor, steps, settings.scale_sd, 1.0, huber=settings.huber)
    state = BundleState(p, q, points, np.zeros(4))
    coarse = problem._replace(weight=problem.weight / _COARSE)
    for version in (coarse, problem):
        state, cost, _ = adjust(version, state, 200, 1e-9)
        if not np.isfinite(cost):
            raise DataError(
                "the images fit no start: points would lie behind cameras; are odometry and images in one order?"
            )
    return problem, state


def _unit_extent(state: BundleState) -> BundleState:
    extent = _extent(state.p)
    points = state.points.copy()
    points[:, 2] *= extent
    return state._replace(p=state.p / extent, points=points)


def _extent(p: Array) -> float:
    return float(np.sqrt(np.sum((p - p.mean(axis=0)) ** 2)))


def _result(
    frames: Sequence[TrackedFrame], camera: Pinhole, ids: IntArray, problem: BundleProblem, state: BundleState,
    metric: bool, settings: ReconstructionSettings,
) -> Reconstruction:  # fmt: skip
    errors, poses = residuals(problem, state), len(state.p)
    count = 2 * len(problem.pose)
    pixels = float(np.sqrt(np.mean(errors[:count] ** 2))) * settings.noise_px
    square, limit, sd = None, None, None
    consistent = pixels <= _WORST_NOISE * settings.noise_px
    if metric:
        square = float(np.sum(errors[count : count + 6 * (poses - 1)] ** 2))
        limit = float(chi2.ppf(_CONFIDENCE, 6 * (poses - 1)))
        consistent = consistent and square <= limit
        sd = _scale_sd(problem, state)
    ray = np.column_stack([state.points[:, :2], np.ones(len(ids))]) / state.points[:, 2:]
    a = problem.anchor
    points = np.squeeze(to_matrix(state.q)[a] @ ray[..., None], -1) + state.p[a]
    return Reconstruction(
        np.array([f.t_s for f in frames]), state.p, state.q, ids, points, metric, float(state.common[0]), sd,
        pixels, square, limit, bool(consistent),
    )  # fmt: skip


def _scale_sd(problem: BundleProblem, state: BundleState) -> float:
    """Relative standard deviation of the extent of the path."""
    extent, centred = _extent(state.p), state.p - state.p.mean(axis=0)
    gradient = np.zeros(6 * (len(state.p) - 1))
    for i in range(1, len(state.p)):
        gradient[6 * (i - 1) : 6 * (i - 1) + 3] = centred[i] / extent
    of_poses = covariance(problem, state)[: len(gradient), : len(gradient)]
    return float(np.sqrt(gradient @ of_poses @ gradient) / extent)
