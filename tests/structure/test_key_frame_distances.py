"""Key frames: distances, dwell time, relative pose and pose in an old key frame, on simple scenes."""

import numpy as np
import pytest
from scipy.stats import chi2

from camnet.estimation.structure.camera_path import planar_path
from camnet.estimation.structure.geometry import distance_ratios, excitation
from camnet.estimation.structure.key_frames.feature_observer import _step, observe
from camnet.estimation.structure.key_frames.key_frame import (
    KeyFrameMotion,
    measure_key_frame,
    observe_key_frame,
    observer_gains,
)
from camnet.estimation.structure.key_frames.map_pose import level_pose
from camnet.estimation.structure.key_frames.relative_pose import relative_poses
from camnet.estimation.structure.key_frames.settings import KeyFrameSettings, RelativePoseSettings
from camnet.geometry.rotations import exp, from_yaw, rotate, to_matrix

FOCAL = 1000.0
DWELL = 0.7516


def drive(images=90, turn=0.2, count=40, seed=0):
    """A camera that drives by a wall and looks at it: motion, points (N, 3), directions (T, N, 3), true distances."""
    rng = np.random.default_rng(seed)
    t = np.arange(images) / 30.0
    knots = np.arange(-5.0, 10.0 * t[-1] + 6.0) / 10.0
    path = planar_path(
        knots, np.column_stack([0.45 * knots, 0.02 * knots**2]), -np.pi / 2 + turn * np.sin(knots), 0.3
    )
    truth = path.states(t)
    points = np.column_stack(
        [rng.uniform(-0.4, 1.8, count), rng.uniform(-1.9, -1.1, count), rng.uniform(0.0, 1.0, count)]
    )
    p_cam = np.einsum("tji,tnj->tni", to_matrix(truth.q_world), points - truth.p_world[:, None])
    d = np.linalg.norm(p_cam, axis=2)
    motion = KeyFrameMotion(t, truth.p_world, truth.q_world, truth.v_cam)
    return motion, points, p_cam / d[..., None], d


def run(settings, motion, u_ic, seen):
    track, poses = measure_key_frame(settings, FOCAL, motion, u_ic, seen)
    return track, observe_key_frame(settings, DWELL, FOCAL, track, poses)


def test_distances_are_learned_from_exact_data():
    motion, _, u_ic, d = drive()
    settings = KeyFrameSettings()
    _, record = run(settings, motion, u_ic, np.ones(d.shape, dtype=bool))
    assert record.usable[-1]
    error = np.abs(record.th[..., 0] - d) / d
    assert error[0].mean() > 0.05
    assert error[-1].max() < 0.01
    gone = np.linalg.norm(motion.p_world[-1] - motion.p_world[0])
    assert record.d_kc[-1] == pytest.approx(gone, rel=0.01)
    assert np.nanmax(np.abs(record.learned[-1] - d[0]) / d[0]) < 0.01


def test_dwell_clock_counts_informative_time_of_all_features_that_remain():
    motion, _, u_ic, d = drive()
    settings = KeyFrameSettings()
    track, record = run(settings, motion, u_ic, np.ones(d.shape, dtype=bool))
    informative = excitation(u_ic, track.u_kc[:, None]) > settings.lambda_a
    informative[0] = False
    # counted again, feature by feature
    clock = np.cumsum((informative & np.isfinite(record.learned)) / 30.0, axis=0)
    expected = np.all((clock >= DWELL) | ~record.alive, axis=1)
    np.testing.assert_array_equal(record.usable, expected & (record.alive.sum(axis=1) >= 20))
    first = int(np.argmax(record.usable))
    # a feature that is not past its time holds the key frame back; losing it lets it go
    late = int(np.argmin(clock[first - 1]))
    assert not record.usable[first - 1]
    seen = np.ones(d.shape, dtype=bool)
    seen[first - 3 :, clock[first - 1] < DWELL] = False
    assert run(settings, motion, u_ic, seen)[1].usable[first - 1]
    assert clock[first - 1, late] < DWELL


def test_fewer_than_twenty_features_are_not_used():
    motion, _, u_ic, d = drive()
    seen = np.ones(d.shape, dtype=bool)
    seen[60:, 19:] = False
    assert not run(KeyFrameSettings(), motion, u_ic, seen)[1].usable[60:].any()
    seen[60:, 19] = True
    assert run(KeyFrameSettings(), motion, u_ic, seen)[1].usable[-1]


def test_features_out_of_view_are_predicted_exactly_with_exact_velocities():
    motion, _, u_ic, d = drive(images=120)
    seen = np.ones(d.shape, dtype=bool)
    seen[80:, 10:20] = False
    record = run(KeyFrameSettings(), motion, u_ic, seen)[1]
    error = np.abs(record.th[..., 0] - d)[:, 10:20]
    # |p_hat - p| stays what it was: the predictor moves points rigidly
    assert np.max(error[80:]) < np.max(error[79]) + 0.01
    assert np.max(error[-1]) < 0.02


def test_corner_that_slips_is_lost_and_wrong_samples_are_refused():
    motion, _, u_ic, d = drive()
    wrong = u_ic.copy()
    z = wrong[40:, 3] / wrong[40:, 3, 2:]
    z[:, 0] += 25.0 / FOCAL
    wrong[40:, 3] = z / np.linalg.norm(z, axis=1, keepdims=True)
    record = run(KeyFrameSettings(), motion, wrong, np.ones(d.shape, dtype=bool))[1]
    assert record.alive[39, 3]
    assert not record.alive[40:, 3].any()
    assert record.alive[-1].sum() >= 35


def test_step_is_the_implicit_step_of_the_printed_law():
    motion, _, u_ic, d = drive()
    settings = KeyFrameSettings()
    track, _ = run(settings, motion, u_ic, np.ones(d.shape, dtype=bool))
    t, i, dt, learned = 50, 7, 1.0 / 30.0, 1.7
    rng = np.random.default_rng(3)
    xi = 0.3 * rng.standard_normal(3)
    rho = 1.6 * xi + 0.02 * rng.standard_normal(3)
    track.flow_power[t, i], track.flow_drive[t, i] = xi @ xi, xi @ rho
    th = np.array([1.3, 0.6, 1.5])
    ups = track.ups[t, i]
    y_xi = np.zeros((6, 3))
    y_xi[:3, 0] = xi
    y_xi[3:, 1:] = np.outer(xi, ups)
    r_u = track.r_kc[t] @ track.u_ik[i]
    y_x = np.zeros((4, 3))
    y_x[:3, 0], y_x[:3, 1], y_x[3, 2] = track.u_ic[t, i], -track.u_kc[t], 1.0
    u_x = np.append(r_u, 1.0) * learned
    a = settings.k * y_xi.T @ y_xi + settings.k_x * y_x.T @ y_x
    b = settings.k * y_xi.T @ np.concatenate([rho, rho]) + settings.k_x * y_x.T @ u_x
    way = np.append(track.way_m[t, i] - track.way_m[t - 1, i], 0.0)
    expected = np.linalg.solve(np.eye(3) + dt * a, th + way + dt * b)
    assert expected.min() > 0.5
    _step(observer_gains(settings, FOCAL), track, t, i, dt, learned, th)
    np.testing.assert_allclose(th, expected, rtol=1e-12)


def test_compiled_observer_is_the_plain_one():
    motion, _, u_ic, d = drive(images=50, count=24)
    s = KeyFrameSettings()
    track, _ = measure_key_frame(s, FOCAL, motion, u_ic, np.ones(d.shape, dtype=bool))
    gains = observer_gains(s, FOCAL)
    for compiled, plain in zip(observe(gains, track), observe.py_func(gains, track), strict=True):
        np.testing.assert_allclose(compiled, plain, atol=1e-12)


def test_psi_of_exact_data_gives_the_distances():
    motion, _, u_ic, d = drive()
    track, _ = measure_key_frame(KeyFrameSettings(), FOCAL, motion, u_ic, np.ones(d.shape, dtype=bool))
    psi = distance_ratios(u_ic[60], track.u_kc[60], track.r_kc[60], u_ic[0])
    np.testing.assert_allclose(psi[:, 0] * d[0], d[60], rtol=1e-6)


def expected_pose(motion, by):
    """Expected rotation and direction of the key frame at the last image, with a steady gyro error of ``by`` rad."""
    r = to_matrix(motion.q_world)
    share = np.linspace(0.0, 1.0, len(r))
    wrong = to_matrix(exp(np.outer(share, [0.0, by, 0.0]))) @ (np.swapaxes(r, 1, 2) @ r[0])
    # p' = R v by the wrong rotations, in the key frame
    gone = np.diff(motion.p_world, axis=0) @ r[0]
    right = np.swapaxes(np.swapaxes(r, 1, 2) @ r[0], 1, 2)
    at = np.swapaxes(wrong, 1, 2)
    steps = np.einsum("tij,tkj,tk->ti", at[:-1], right[:-1], gone)
    p = -wrong[-1] @ steps.sum(axis=0)
    return wrong[-1:], (p / np.linalg.norm(p))[None], (np.swapaxes(r, 1, 2) @ r[0])[-1:]


def test_relative_pose_finds_the_error_of_the_gyro():
    motion, _, u_ic, d = drive()
    r_0, u_0, r_true = expected_pose(motion, 0.03)
    out = relative_poses(
        u_ic[0],
        u_ic[-1:],
        np.ones((1, d.shape[1]), dtype=bool),
        r_0,
        u_0,
        FOCAL,
        RelativePoseSettings(noise_px=0.05),
    )
    np.testing.assert_allclose(to_matrix(exp(out.turn))[0] @ r_0[0], r_true[0], atol=2e-3)


def test_relative_pose_states_its_error():
    motion, _, u_ic, d = drive()
    r_0, u_0, _ = expected_pose(motion, 0.0)
    rng = np.random.default_rng(0)
    runs = 200
    x = u_ic[[0, -1], :, :2] / u_ic[[0, -1], :, 2:]
    seen = np.ones((1, d.shape[1]), dtype=bool)
    squares = []
    for _ in range(runs):
        noisy = np.concatenate(
            [x + 1.0 / FOCAL * rng.standard_normal(x.shape), np.ones((*x.shape[:2], 1))], axis=2
        )
        u = noisy / np.linalg.norm(noisy, axis=2, keepdims=True)
        # the prior on the direction is drawn, too
        sideways = np.cross(u_0, [[0.0, 1.0, 0.0]])
        off = u_0 + 0.005 * rng.standard_normal() * sideways
        out = relative_poses(u[0], u[1:], seen, r_0, off / np.linalg.norm(off), FOCAL, RelativePoseSettings())
        squares.append((out.turn[0, 1] / out.turn_sd[0]) ** 2)
    # the stated deviation carries priors on tilt that are not drawn here: it may be too large, never too small
    assert 0.3 < np.mean(squares) < chi2.ppf(0.999, runs) / runs


def test_pose_in_an_old_key_frame():
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-1, 1, 30), rng.uniform(-0.5, 0.5, 30), rng.uniform(1, 2, 30)])
    truth = np.array([0.15, -0.3, 0.1])
    # camera axes right, down, forward; left is -x, and a turn to the left is about -y
    q = exp(np.array([0.0, -truth[2], 0.0]))
    p_cam = (points - np.array([-truth[1], 0.0, truth[0]])) @ to_matrix(q)
    rays = p_cam[:, :2] / p_cam[:, 2:]
    found = level_pose(points, rays, 1e-3, 0.0, 0.0)
    np.testing.assert_allclose(found.pose, truth, atol=1e-9)
    squares = []
    for _ in range(200):
        noisy = level_pose(points, rays + 1e-3 * rng.standard_normal(rays.shape), 1e-3, 0.0, 0.0)
        e = noisy.pose - truth
        squares.append(e @ np.linalg.solve(noisy.cov, e))
    low, high = chi2.ppf([0.0005, 0.9995], 600) / 200
    assert low < np.mean(squares) < 1.3 * high
    assert found.inliers == 30
    # heading by the yaw of the world agrees with the turn used here
    assert rotate(from_yaw(0.1), np.array([1.0, 0.0, 0.0]))[1] > 0.0
