"""Pose observer and filter of the key frames: printed law, linearisations, learning, consistency."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import chi2

from camnet.estimation.structure.camera_path import planar_path
from camnet.estimation.structure.key_frames import augmented_filter as af
from camnet.estimation.structure.key_frames.augmented_filter import FilterEvents, FilterNoise, run_filter
from camnet.estimation.structure.key_frames.pose_observer import (
    KeyFrameFeedback,
    Landmarks,
    observe_pose,
    predict_pose,
)
from camnet.estimation.structure.odometry import OdometryErrors, dead_reckon, measure_odometry
from camnet.experiments.key_frame_position_run import run_scene
from camnet.experiments.key_frame_setup import SetUp, WorldSettings, lap_length, make_scene
from camnet.experiments.key_frame_tracks import SimulatedKeyFrames
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import multiply, to_matrix

NOISE = FilterNoise(0.02, 0.001, 0.02, 0.05, 1.0, 0.004, 0.005, 0.002, 50.0, 1000.0)


def curve(images=200):
    t = np.arange(images) / 30.0
    knots = np.arange(-5.0, 10.0 * t[-1] + 6.0) / 10.0
    path = planar_path(knots, np.column_stack([np.cos(0.4 * knots), np.sin(0.4 * knots)]), 0.4 * knots, 0.3)
    return path, path.states(t)


def landmarks(truth, seen):
    mask = np.zeros(len(truth.t_s), dtype=bool)
    mask[seen] = True
    return Landmarks(mask, truth.p_world, truth.q_world)


def no_events(count, pose):
    mask = np.zeros(count, dtype=bool)
    first = mask.copy()
    first[0] = True
    return FilterEvents(
        first, pose, mask.copy(), np.full(count, np.nan), np.full(count, np.nan), mask.copy(),
        np.full(count, -1), np.zeros((count, 3)), np.zeros((count, 3, 3)),
    )  # fmt: skip


def planar(truth):
    axis = to_matrix(truth.q_world)[:, :2, 2]
    heading = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    pose = np.column_stack([truth.p_world[:, :2], heading])
    speed = np.ascontiguousarray(np.column_stack([truth.v_cam[:, 2], -truth.v_cam[:, 0]]))
    return pose, speed, np.ascontiguousarray(-truth.w_cam[:, 1])


def test_predictor_is_dead_reckoning_and_is_reset_at_the_landmark():
    path, truth = curve()
    odometry = measure_odometry(
        path, truth.t_s, OdometryErrors(scale=0.05, gyro_scale=0.02), np.random.default_rng(0)
    )
    p, q = predict_pose(truth.t_s, odometry.v_cam, odometry.w_cam, landmarks(truth, [0]))
    p_2, q_2 = dead_reckon(odometry, truth.t_s, truth.p_world[0], truth.q_world[0])
    np.testing.assert_allclose(p, p_2, atol=1e-9)
    np.testing.assert_allclose(np.abs(np.sum(q * q_2, axis=1)), 1.0, atol=1e-12)
    reset = predict_pose(truth.t_s, odometry.v_cam, odometry.w_cam, landmarks(truth, [0, 150]))[0]
    np.testing.assert_allclose(reset[:150], p[:150], atol=1e-12)
    np.testing.assert_allclose(reset[150], truth.p_world[150], atol=1e-12)


def feedback(truth, usable):
    """Exact key frames, every second one with the other sign of its quaternion."""
    r = to_matrix(truth.q_world)
    key = (np.arange(len(r)) // 100) * 100
    p_ck = np.einsum("tji,tj->ti", r[key], truth.p_world - truth.p_world[key])
    conjugate = truth.q_world[key] * [1.0, -1.0, -1.0, -1.0]
    q_ck = np.array([multiply(a, b) for a, b in zip(conjugate, truth.q_world, strict=True)])
    q_ck[::2] *= -1.0
    return KeyFrameFeedback(key // 100, usable, p_ck, q_ck)


def test_observer_follows_the_key_frame_at_its_gain():
    path, truth = curve()
    errors = OdometryErrors(scale=0.3, gyro_scale=0.3)
    odometry = measure_odometry(path, truth.t_s, errors, np.random.default_rng(0))
    usable = np.zeros(200, dtype=bool)
    usable[50:100] = True
    at_start = landmarks(truth, [0])
    key = feedback(truth, usable)
    p, q = observe_pose(truth.t_s, odometry.v_cam, odometry.w_cam, at_start, key, 3.0, 3.0)
    alone, _ = predict_pose(truth.t_s, odometry.v_cam, odometry.w_cam, at_start)
    np.testing.assert_allclose(p[:50], alone[:50], atol=1e-12)
    # key frame 0 was taken at the landmark: what it says is true, and the error settles at drift / gain
    drift = 0.3 * np.linalg.norm(truth.v_cam[99])
    assert np.linalg.norm(p[99] - truth.p_world[99]) < 1.3 * drift / 3.0
    assert np.linalg.norm(alone[99] - truth.p_world[99]) > 3.0 * drift / 3.0
    assert np.all(np.abs(np.linalg.norm(q, axis=1) - 1.0) < 1e-9)
    quick, _ = observe_pose(truth.t_s, odometry.v_cam, odometry.w_cam, at_start, key, 300.0, 300.0)
    assert np.linalg.norm(quick[99] - truth.p_world[99]) < 0.01


def test_key_frame_from_before_a_reset_is_not_used():
    path, truth = curve()
    odometry = measure_odometry(path, truth.t_s, OdometryErrors(scale=0.3), np.random.default_rng(0))
    usable = np.ones(200, dtype=bool)
    key = feedback(truth, usable)
    seen = landmarks(truth, [0, 150])
    p, _ = observe_pose(truth.t_s, odometry.v_cam, odometry.w_cam, seen, key, 3.0, 3.0)
    q_0 = truth.q_world[150]
    rest = measure_odometry(path, truth.t_s, OdometryErrors(scale=0.3), np.random.default_rng(0))
    free, _ = dead_reckon(rest, truth.t_s[150:], truth.p_world[150], q_0)
    np.testing.assert_allclose(p[150:], free, atol=1e-9)


def test_prediction_of_the_filter_is_linearised_rightly():
    rng = np.random.default_rng(1)
    x = np.array([1.0, -2.0, 0.7, 0.05, 0.02, -0.04, 0.3, 0.2, 0.1])
    args = (1.0 / 30.0, np.array([0.5, 0.2]), np.array([0.55, 0.1]), 0.8, 0.9)
    root = rng.standard_normal((9, 9))
    p = root @ root.T
    quiet = NOISE._replace(slip=0.0, gyro_noise=0.0)

    def moved(state):
        y = state.copy()
        af.predict_state(y, np.eye(9), 9, *args, quiet, 1.0, 1.0, np.zeros((2, 2)))
        return y

    f = approx_fprime(x, moved, 1e-7)
    out = p.copy()
    af.predict_state(x.copy(), out, 9, *args, quiet, 1.0, 1.0, np.zeros((2, 2)))
    np.testing.assert_allclose(out, f @ p @ f.T, atol=5e-5)


def test_revisit_is_linearised_rightly():
    """An update with a tiny prior covariance moves the state along P H^T: H is read from it."""
    x = np.array([1.0, -2.0, 0.7, 0.05, 0.02, -0.04, 0.3, 0.2, 0.1])

    def expected(state):
        c, s = np.cos(state[8]), np.sin(state[8])
        d = state[:2] - state[6:8]
        scaled = (1.0 + state[3]) * np.array([c * d[0] + s * d[1], -s * d[0] + c * d[1]])
        return np.append(scaled, state[2] - state[8])

    h = approx_fprime(x, expected, 1e-7)
    rng = np.random.default_rng(0)
    root = 0.01 * rng.standard_normal((9, 9))
    p, cov = root @ root.T, np.diag([1e-4, 2e-4, 3e-5])
    z = expected(x) + np.array([0.003, -0.002, 0.001])
    s = h @ p @ h.T + cov
    gain = p @ h.T @ np.linalg.inv(s)
    y, out = x.copy(), p.copy()
    af._revisit(y, out, 9, 6, z, cov, np.zeros((2, 2)))
    np.testing.assert_allclose(y, x + gain @ (z - expected(x)), atol=1e-7)
    np.testing.assert_allclose(out, (np.eye(9) - gain @ h) @ p, atol=1e-8)


def test_filter_without_errors_follows_the_truth():
    _, truth = curve()
    pose, speed, rate = planar(truth)
    out = run_filter(truth.t_s, speed, rate, no_events(200, pose), NOISE)
    np.testing.assert_allclose(out.pose, pose, atol=2e-4)
    assert np.all(np.linalg.eigvalsh(out.pose_cov) > 0.0)


def long_drive(errors, seed=0, visual=None, noise=NOISE, images=6000):
    """A camera on a circle of 95 s with a landmark at each turn's end; visual rotations every 60 images."""
    rng = np.random.default_rng(seed)
    t = np.arange(images) / 30.0
    knots = np.arange(-5.0, 2.0 * t[-1] + 12.0) / 2.0
    turn = 2.0 * np.pi / 95.0
    path = planar_path(
        knots, 6.8 * np.column_stack([np.cos(turn * knots), np.sin(turn * knots)]), turn * knots, 0.3
    )
    truth = path.states(t)
    odometry = measure_odometry(path, t, errors, rng)
    pose, _, _ = planar(truth)
    measured = truth.__class__(t, truth.p_world, truth.q_world, odometry.v_cam, odometry.w_cam)
    _, speed, rate = planar(measured)
    events = no_events(images, pose + rng.standard_normal(pose.shape) * [0.005, 0.005, 0.002])
    at = np.mod(t, 95.0) < 2.0
    events = events._replace(landmark=at)
    if visual is not None:
        first = np.arange(0, images - 60, 60)
        last = first + 59
        taken, z, sd = events.taken.copy(), events.turn.copy(), events.turn_sd.copy()
        taken[first] = True
        z[last] = pose[last, 2] - pose[first, 2] + visual * rng.standard_normal(len(first))
        sd[last] = visual
        events = events._replace(taken=taken, turn=z, turn_sd=sd)
    out = run_filter(t, speed, rate, events, noise)
    reckoned = predict_pose(t, odometry.v_cam, odometry.w_cam, Landmarks(at, truth.p_world, truth.q_world))[0]
    error = np.linalg.norm(out.pose[:, :2] - truth.p_world[:, :2], axis=1)
    dead = np.linalg.norm(reckoned[:, :2] - truth.p_world[:, :2], axis=1)
    return out, error, dead


def test_landmark_teaches_gyro_errors_without_images():
    out, error, dead = long_drive(OdometryErrors(gyro_scale=0.024, gyro_noise_radps=0.004))
    second = slice(3000, 5600)
    assert np.sqrt(np.mean(error[second] ** 2)) < 0.4 * np.sqrt(np.mean(dead[second] ** 2))
    # on a circle of constant rate a bias is a scale
    equivalent = out.odometry[-1, 2] + out.odometry[-1, 1] / (2.0 * np.pi / 95.0)
    assert equivalent == pytest.approx(0.024, abs=0.004)


@pytest.mark.parametrize("factor", [0.05, 0.2, 5.0, 20.0])
def test_stated_gyro_noise_that_is_wrong_does_no_harm(factor):
    """Stated 20 times too small to 20 times too large: well below dead reckoning."""
    errors = OdometryErrors(gyro_scale=0.024, gyro_noise_radps=0.02)
    told = NOISE._replace(gyro_noise=0.02 * factor)
    told_squares, dead_squares = [], []
    for seed in range(3):
        _, error, dead = long_drive(errors, seed, visual=0.006, noise=told)
        told_squares.append(np.mean(error**2))
        dead_squares.append(np.mean(dead**2))
    assert np.sqrt(np.mean(told_squares)) < 0.6 * np.sqrt(np.mean(dead_squares))


def test_multiplier_finds_the_gyro_noise():
    errors = OdometryErrors(gyro_noise_radps=0.04)
    small = long_drive(errors, visual=0.004, noise=NOISE._replace(gyro_noise=0.004))[0]
    large = long_drive(errors, visual=0.004, noise=NOISE._replace(gyro_noise=0.4))[0]
    found = [0.004 * np.sqrt(small.multiplier[-1, 0]), 0.4 * np.sqrt(large.multiplier[-1, 0])]
    assert all(0.02 < x < 0.08 for x in found), found


def test_slip_that_is_larger_than_stated_is_noticed():
    out = long_drive(OdometryErrors(slip=0.2, gyro_noise_radps=0.004), visual=0.004, images=9000)[0]
    assert out.multiplier[-1, 1] > 3.0
    quiet = long_drive(OdometryErrors(slip=0.05, gyro_noise_radps=0.004), visual=0.004, images=9000)[0]
    assert quiet.multiplier[-1, 1] < 3.0


def test_path_is_the_published_length():
    world = WorldSettings()
    assert lap_length(world) == pytest.approx(42.6, abs=0.001)
    scene = make_scene(world, OdometryErrors(), np.random.default_rng(0))
    way = np.sum(np.linalg.norm(np.diff(scene.truth.p_world, axis=0), axis=1))
    assert way == pytest.approx(6 * 42.6 + 1.0, rel=2e-3)
    assert scene.landmark[0]
    assert np.sum(np.diff(scene.landmark.astype(int)) == 1) == 6
    # looks to the right of its travel, by 78 degrees
    v = scene.truth.v_cam[200] / np.linalg.norm(scene.truth.v_cam[200])
    assert np.degrees(np.arctan2(v[0], v[2])) == pytest.approx(-78.0, abs=0.1)


def nees(loops, runs):
    """Normalised squares (runs, landmarks) of position and heading just before each landmark, of the filter alone."""
    setup = SetUp(world=WorldSettings(loops=loops), gates_px=(3.0,))
    told = setup.filter
    out = []
    for seed in range(runs):
        rng = np.random.default_rng([seed, 77])
        scale, gyro_scale, bias = rng.standard_normal(3).tolist()
        errors = OdometryErrors(
            scale=told.scale * scale,
            slip=told.slip,
            gyro_scale=told.gyro_scale * gyro_scale,
            gyro_bias_radps=(0.0, told.gyro_bias_radps * bias, 0.0),
            gyro_noise_radps=told.gyro_noise_radps,
        )
        scene = make_scene(setup.world, errors, rng)
        camera = Pinhole.from_settings(setup.world.camera)
        tracks = SimulatedKeyFrames(
            scene.points_world, scene.truth, camera, setup.key_frames, setup.noise, rng
        )
        run = run_scene(setup, scene, tracks, rng)[3.0].filters["augmented"]
        axis = to_matrix(scene.truth.q_world)[:, :2, 2]
        truth = np.column_stack([scene.truth.p_world[:, :2], np.arctan2(axis[:, 1], axis[:, 0])])
        before = np.flatnonzero(np.diff(scene.landmark.astype(int)) == 1) + 1
        e = run.before[before] - truth[before]
        e[:, 2] = np.remainder(e[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        out.append(np.einsum("ni,nij,nj->n", e, np.linalg.inv(run.before_cov[before]), e))
    return np.array(out)


@pytest.mark.slow
def test_filter_states_its_error_just_before_each_landmark():
    """50 runs whose errors are drawn from what the filter is told: mean within the two-sided 95 % interval."""
    runs = 50
    squares = nees(2, runs)
    low, high = chi2.ppf([0.025, 0.975], 3 * runs) / runs
    for at in range(squares.shape[1]):
        assert low < np.mean(squares[:, at]) < high, np.mean(squares, axis=0)
