"""Structure and scale of a target at rest, of the background, and the camera's way, from one bundle adjustment.

While the target rests (bell2019, section 5.1: until ``s_0``) it is a stationary object like any other. The paper learns
the distance of feature m1 from psi and odometry; with the few features of a small target, directions and rotations
from these alone are noisy, and psi divides by them (errors in variables: distances come out far too short). Here the
target's features and corners of the background enter one adjustment with the odometry (`bundle`): the background fixes
rotations and directions, odometry the scale.

| symbol | name | shape | unit | what |
| --- | --- | --- | --- | --- |
| ``p_{i/k1}`` | ``points`` | (N, 3) | m | in the frame of the first image; NaN where a point was not seen twice |
| | ``p``, ``q`` | (P, 3), (P, 4) | m, - | the camera's poses in that frame |
| ``s`` | ``common[0]`` | | - | odometry scale: only its prior speaks of it, so it stays at zero |
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from camnet.errors import DataError
from camnet.estimation.structure.bundle import BundleState, Observations, adjust, build_problem
from camnet.estimation.structure.bundle.preintegrate import preintegrate
from camnet.estimation.structure.geometry import unit
from camnet.estimation.structure.moving.known_points import PoseTrack
from camnet.estimation.structure.odometry import Odometry, OdometryErrors, dead_reckon
from camnet.estimation.structure.triangulate import meeting_point, start_points
from camnet.geometry.rotations import IDENTITY, conjugate, rotate
from camnet.types import Array, IntArray

__all__ = ["StructureAtRest", "learn_at_rest", "points_from_all"]


@dataclass(frozen=True, eq=False, slots=True)
class StructureAtRest:
    """See the module's table."""

    points: Array
    p: Array
    q: Array


def learn_at_rest(
    t_s: Array, xy: Array, noise: float, odometry: Odometry, errors: OdometryErrors, scale_sd: float
) -> StructureAtRest:
    """Adjust all points and poses of the time at rest.

    Parameters
    ----------
    t_s : (P,) times of the images used, s
    xy : (P, N, 2) normalised coordinates of the points, NaN where one is not seen
    noise : standard deviation of each coordinate
    odometry : measured velocities of the camera
    errors : its white noises and slip, as standard deviations
    scale_sd : standard deviation of its scale

    Raises
    ------
    DataError
        If fewer than two images see four points, or the adjustment has no start in front of the cameras.
    """
    there = np.isfinite(xy[..., 0])
    if len(t_s) < 2 or (there.sum(axis=1) >= 4).sum() < 2:
        raise DataError(
            f"{len(t_s)} images of {xy.shape[1]} points: at least two images must see four points"
        )
    kept = np.flatnonzero(there.sum(axis=0) >= 2)
    pose, point = np.nonzero(there[:, kept])
    seen = Observations(pose, point, xy[:, kept][pose, point], np.full(len(pose), noise))
    p, q = dead_reckon(odometry, t_s, np.zeros(3), IDENTITY)
    anchor, start = start_points(seen, len(kept), p, q)
    steps = [preintegrate(odometry, a, b, errors) for a, b in pairwise(t_s.tolist())]
    problem = build_problem(seen, anchor, list(steps), scale_sd, 1e-6)
    after, cost, _ = adjust(problem, BundleState(p, q, start, np.zeros(4)))
    if not np.isfinite(cost):
        raise DataError("a point starts behind a camera that saw it; the odometry does not fit the images")
    points = np.full((xy.shape[1], 3), np.nan)
    points[kept] = _in_first_frame(after, anchor)
    return StructureAtRest(points, after.p, after.q)


def _in_first_frame(state: BundleState, anchor: IntArray) -> Array:
    ray = np.column_stack([state.points[:, :2], np.ones(len(anchor))]) / state.points[:, 2:]
    return np.asarray(state.p[anchor] + rotate(state.q[anchor], ray))


def points_from_all(track: PoseTrack, xy: Array) -> Array:
    """Points (N, 3), m, where the rays of all images meet that have a camera pose; NaN where none meet.

    The adjustment holds a few dozen poses; of the features of a small target every image counts. ``track`` is the
    pose of the points' frame in the camera frame (from the background), ``xy`` (K, N, 2) normalised coordinates.
    """
    back = conjugate(track.q)
    centres = -rotate(back, track.p)
    rays = rotate(back[:, None], unit(np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=2))[0])
    out = np.full((xy.shape[1], 3), np.nan)
    for j in range(xy.shape[1]):
        mine = track.seen & np.isfinite(rays[:, j, 0])
        met = meeting_point(centres[mine], rays[mine, j]) if mine.sum() >= 2 else None
        if met is not None:
            out[j] = met
    return out
