"""One run of the moving-target experiment: structure at rest, poses, the causal filter, and the gaps.

Everything is in the scene frame: the first camera frame with its axes renamed (x forward, y left, z up). Nothing but
images and odometry enters; truth is for the errors alone, which are of positions relative to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.camera_path import forward_camera
from camnet.estimation.structure.moving.known_points import PoseTrack, track_poses
from camnet.estimation.structure.moving.rest import learn_at_rest, points_from_all
from camnet.estimation.structure.moving.twist_filter import TwistFilter, TwistState
from camnet.estimation.structure.odometry import OdometryErrors
from camnet.experiments.moving_target_scene import MovingScene, MovingSetUp
from camnet.geometry.rotations import conjugate, from_matrix, log, multiply, rotate, to_matrix
from camnet.types import Array

__all__ = [
    "TO_SCENE",
    "Learned",
    "SceneTracks",
    "heading_error",
    "learn_structure",
    "scale_errors",
    "scene_tracks",
    "scene_truth",
    "stretches",
]

#: camera axes of the first frame to scene axes
TO_SCENE = forward_camera(0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Learned:
    """What the time at rest taught, in the first camera frame: target's features (12, 3) and corners (40, 3), m."""

    features: Array
    corners: Array


@dataclass(frozen=True, eq=False, slots=True)
class SceneTracks:
    """Measured poses: camera in the scene (K,) and target (origin: mean of its features) in the scene.

    ``p``, ``q`` (K, 3), (K, 4): target to scene, NaN where it is not seen; ``covariance`` (K, 6, 6) of
    ``[dp (scene); dr (body)]``; ``p_camera``, ``q_camera``: camera to scene; ``in_camera``: the raw track.
    """

    t_s: Array
    p: Array
    q: Array
    covariance: Array
    p_camera: Array
    q_camera: Array
    in_camera: PoseTrack


def learn_structure(setup: MovingSetUp, scene: MovingScene) -> Learned:
    """Bundle adjustment of the time at rest, then the features from all of its images."""
    o = setup.odometry
    noise = OdometryErrors(speed_noise_mps=o.speed_noise_mps, gyro_noise_radps=o.gyro_noise_radps)
    rest = np.flatnonzero(scene.t_s < setup.rest_s)
    few = rest[np.unique(np.linspace(0, len(rest) - 1, setup.rest_images).astype(int))]
    xy = np.concatenate([scene.xy_target, scene.xy_corners], axis=1)
    found = learn_at_rest(scene.t_s[few], xy[few], scene.noise, scene.odometry, noise, max(o.scale_sd, 1e-3))
    corners = found.points[scene.xy_target.shape[1] :]
    camera = track_poses(scene.t_s[rest], scene.xy_corners[rest], corners, scene.noise)
    return Learned(points_from_all(camera, scene.xy_target[rest]), corners)


def scale_errors(scene: MovingScene, learned: Learned) -> tuple[float, float]:
    """Relative error of the target's distance at first sight, and the shape's RMS error after alignment, m."""
    first = scene.path.states(scene.t_s[0])
    world = scene.target.p_world[0] + scene.arms @ scene.target.r_world[0].T
    true = (world - first.p_world) @ to_matrix(first.q_world[0])
    ours, truth = learned.features, true
    scale = float(np.linalg.norm(ours.mean(axis=0)) / np.linalg.norm(truth.mean(axis=0))) - 1.0
    a, b = ours - ours.mean(axis=0), truth - truth.mean(axis=0)
    u, s, v = np.linalg.svd(a.T @ b)
    s[2] *= np.linalg.det(u @ v)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    aligned = s.sum() / np.sum(a * a) * (a @ turn)
    return scale, float(np.sqrt(np.mean(np.sum((aligned - b) ** 2, axis=1))))


def scene_tracks(scene: MovingScene, learned: Learned) -> SceneTracks:
    """Pose of the camera from the corners and of the target from its features, at every image."""
    middle = learned.features.mean(axis=0)
    body = rotate(TO_SCENE, learned.features - middle)
    camera = track_poses(scene.t_s, scene.xy_corners, rotate(TO_SCENE, learned.corners), scene.noise)
    target = track_poses(scene.t_s, scene.xy_target, body, scene.noise)
    back = conjugate(camera.q)
    p_camera = -rotate(back, camera.p)
    q = multiply(back, target.q)
    big = np.zeros((len(scene.t_s), 6, 6))
    big[:, :3, :3], big[:, 3:, 3:] = to_matrix(back), np.eye(3)
    covariance = big @ target.covariance @ np.swapaxes(big, 1, 2)
    return SceneTracks(scene.t_s, p_camera + rotate(back, target.p), q, covariance, p_camera, back, target)


def scene_truth(scene: MovingScene) -> tuple[Array, Array, Array]:
    """Return true position relative to the camera (K, 3), turn of the body since the start (K, 4), velocity (K, 3).

    All in scene axes; the position is that of the mean of the features.
    """
    truth = scene.path.states(scene.t_s)
    first = multiply(TO_SCENE, conjugate(truth.q_world[0]))
    middle = scene.arms.mean(axis=0)
    r = scene.target.r_world
    p = scene.target.p_world + r @ middle
    spin = np.column_stack([np.zeros((len(r), 2)), scene.target.yaw_rate])
    v = scene.target.v_world + np.cross(spin, r @ middle)
    q = from_matrix(r)
    turn = multiply(multiply(first, multiply(q, conjugate(q[0]))), conjugate(first))
    return rotate(first, p - truth.p_world), turn, rotate(first, v)


def stretches(
    setup: MovingSetUp, scene: MovingScene, tracks: SceneTracks
) -> list[tuple[list[TwistState], list[TwistState]]]:
    """Return filtered and smoothed states of every seen stretch, each from its own measurements."""
    out = []
    good = np.flatnonzero(np.isfinite(tracks.p[:, 0]) & scene.seen)
    parts = np.split(good, np.flatnonzero(np.diff(scene.t_s[good]) > 1.0) + 1)
    flow = TwistFilter(setup.filter)
    for part in parts:
        flow.restart()
        for k in part:
            flow.update(float(scene.t_s[k]), tracks.p[k], tracks.q[k], tracks.covariance[k])
        out.append((list(flow.stretch), flow.smooth()))
    return out


def heading_error(q: Array, turn: Array) -> Array:
    """Error of the heading (...,), rad: the part about the scene's vertical of ``q turn^-1``."""
    return np.asarray(log(multiply(q, conjugate(turn)))[..., 2])
