"""The sliding window and the sources of the key frame's pose on the published scene, with features that come and go."""

import numpy as np
import pytest

from camnet.estimation.structure.bundle.window import SlidingBundle
from camnet.estimation.structure.key_view import KeyFrameViews, ViewSettings
from camnet.estimation.structure.odometry import OdometryErrors, measure_odometry
from camnet.estimation.structure.tracks import SimulatedTracks, TrackedFrame
from camnet.estimation.structure.two_view import turn_between
from camnet.experiments.distance_observers_scene import SetUp, make_scene
from camnet.geometry.rotations import angle_between, conjugate, multiply, to_matrix

SETUP = SetUp()


def scene_and_frames(seed, noise_px, errors=None):
    rng = np.random.default_rng(seed)
    scene = make_scene(SETUP, rng)
    odometry = scene.odometry
    if errors is not None:
        odometry = measure_odometry(scene.path, np.arange(0.0, scene.t_s[-1] + 0.02, 0.01), errors, rng)
    tracks = SimulatedTracks(scene.points_world, scene.path, scene.camera, scene.t_s, noise_px, rng)
    return scene, odometry, tracks


def depths_at(scene, k):
    now = scene.path.states(scene.t_s[k])
    return ((scene.points_world - now.p_world[0]) @ to_matrix(now.q_world[0]))[:, 2]


def test_a_window_on_exact_data_finds_depths_and_the_path_though_features_come_and_go():
    scene, odometry, tracks = scene_and_frames(2, 0.0, OdometryErrors())
    bundle = SlidingBundle(scene.camera, odometry, SETUP.bundle)
    for k, frame in enumerate(tracks):
        kept = (np.arange(48) + k // 10) % 5 > 0 if k > 30 else np.ones(48, dtype=bool)
        bundle.update(TrackedFrame(frame.t_s, frame.ids[kept], frame.pixels[kept]))
    np.testing.assert_allclose(bundle.depths(), depths_at(scene, -1), atol=0.01)
    start, now = scene.path.states(0.0), scene.path.states(scene.t_s[-1])
    p = to_matrix(start.q_world[0]).T @ (now.p_world[0] - start.p_world[0])
    np.testing.assert_allclose(bundle.p, p, atol=0.01)
    assert angle_between(bundle.q, multiply(conjugate(start.q_world[0]), now.q_world[0])) < 1e-3
    assert np.abs(bundle.common).max() < 5e-3


def test_a_gyro_bias_is_found():
    errors = OdometryErrors(gyro_bias_radps=(0.0, 0.0012, 0.0))
    scene, odometry, tracks = scene_and_frames(2, 0.2, errors)
    bundle = SlidingBundle(scene.camera, odometry, SETUP.bundle.model_copy(update={"noise_px": 0.2}))
    for frame in tracks:
        bundle.update(frame)
    assert bundle.common[2] == pytest.approx(0.0012, abs=4e-4)


def test_the_camera_at_rest_leaves_the_start():
    scene, odometry, tracks = scene_and_frames(2, 0.5)
    bundle = SlidingBundle(scene.camera, odometry, SETUP.bundle)
    for frame in list(tracks)[:10]:
        bundle.update(frame)
    np.testing.assert_allclose(bundle.depths(), 0.5, atol=1e-9)


def test_the_gyro_gives_the_key_frame_better_than_the_images_of_a_small_board():
    """Errors of rotation and direction, rad; the essential matrix of a plane is ambiguous and is not asked here."""
    errors = {}
    for source in ("gyro", "homography"):
        turns, directions = [], []
        for seed in range(3):
            scene, odometry, tracks = scene_and_frames(seed, 0.5)
            views = KeyFrameViews(scene.camera, odometry, ViewSettings(rotation=source))
            start = scene.path.states(0.0)
            for k, frame in enumerate(tracks):
                view = views.view(frame)
                if k < 90 or k % 10:
                    continue
                now = scene.path.states(frame.t_s)
                r_c = to_matrix(now.q_world[0])
                turns.append(turn_between(view.r_kc, r_c.T @ to_matrix(start.q_world[0])))
                p = r_c.T @ (start.p_world[0] - now.p_world[0])
                directions.append(np.arccos(np.clip(view.u_kc @ p / np.linalg.norm(p), -1.0, 1.0)))
        errors[source] = np.mean(turns), np.mean(directions)
    assert errors["gyro"][0] < errors["homography"][0] < 0.1
    assert errors["gyro"][1] < errors["homography"][1] < 0.2
