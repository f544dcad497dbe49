"""Simulated tracks and odometry: what they say without errors, and the size of the errors they add."""

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation.structure.camera_path import CameraPath, planar_path
from camnet.estimation.structure.odometry import (
    OdometryErrors,
    OdometrySpread,
    dead_reckon,
    measure_odometry,
)
from camnet.estimation.structure.tracks import SimulatedTracks, match
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import angle_between
from camnet.geometry.settings import Intrinsics

CAMERA = Pinhole.from_settings(
    Intrinsics(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0)
)
KNOTS = np.linspace(0.0, 6.0, 25)
PATH = planar_path(KNOTS, np.column_stack([np.sin(0.5 * KNOTS), 0.3 * KNOTS]), 0.2 * np.sin(KNOTS), 0.3)
T = np.arange(0.0, 6.0, 1.0 / 30.0)


def tracks(noise_px, rng=None, **options):
    points = np.array([4.0, 0.5, 0.3]) + np.random.default_rng(1).uniform(-2.0, 2.0, (40, 3))
    return points, SimulatedTracks(
        points, PATH, CAMERA, T, noise_px, rng or np.random.default_rng(0), **options
    )


def test_tracks_without_noise_are_projections_of_what_is_in_view():
    points, frames = tracks(0.0)
    for frame, t in zip(frames, T, strict=True):
        now = PATH.states(t)
        pixels = CAMERA.project_world(points, now.p_world[0], now.q_world[0])
        inside = CAMERA.in_image(pixels)
        np.testing.assert_array_equal(frame.ids, np.flatnonzero(inside))
        np.testing.assert_allclose(frame.pixels, pixels[inside], atol=1e-9)
        assert frame.t_s == t


def test_noise_has_the_stated_size_and_the_seed_fixes_it():
    clean = [f.pixels for f in tracks(0.0)[1]]
    noisy = [f.pixels for f in tracks(0.7)[1]]
    again = [f.pixels for f in tracks(0.7)[1]]
    off = np.concatenate([n - c for n, c in zip(noisy, clean, strict=True)])
    assert np.std(off) == pytest.approx(0.7, rel=0.03)
    assert all(np.array_equal(a, b) for a, b in zip(noisy, again, strict=True))


def test_points_are_seen_from_their_front_only():
    _, frames = tracks(0.0, normals_world=np.tile([1.0, 0.0, 0.0], (40, 1)))
    assert all(len(f.ids) == 0 for f in frames)
    _, frames = tracks(0.0, normals_world=np.tile([-1.0, 0.0, 0.0], (40, 1)))
    assert sum(len(f.ids) for f in frames) > 1000


def test_matching_finds_numbers_and_leaves_holes():
    frame = next(iter(tracks(0.0)[1]))
    ids = np.array([frame.ids[2], 39_000, frame.ids[0]])
    pixels, there = match(frame, ids)
    np.testing.assert_array_equal(there, [True, False, True])
    np.testing.assert_array_equal(pixels[[0, 2]], frame.pixels[[2, 0]])
    assert np.isnan(pixels[1]).all()


def test_exact_odometry_leads_back_to_the_path():
    odometry = measure_odometry(PATH, np.arange(0.0, 6.01, 0.005), OdometryErrors(), np.random.default_rng(0))
    fine = np.arange(0.0, 6.0, 0.005)
    start = PATH.states(0.0)
    p, q = dead_reckon(odometry, fine, start.p_world[0], start.q_world[0])
    truth = PATH.states(fine)
    assert np.abs(p - truth.p_world).max() < 1e-4
    assert angle_between(q, truth.q_world).max() < 1e-4


def test_odometry_errors_are_those_stated():
    t = np.arange(0.0, 6.0, 0.02)
    truth = PATH.states(t)
    errors = OdometryErrors(scale=0.02, gyro_bias_radps=(0.0, 0.01, 0.0), gyro_scale=0.03)
    o = measure_odometry(PATH, t, errors, np.random.default_rng(0))
    np.testing.assert_allclose(o.v_cam, 1.02 * truth.v_cam, atol=1e-12)
    np.testing.assert_allclose(o.w_cam, 1.03 * truth.w_cam + [0.0, 0.01, 0.0], atol=1e-12)
    long = np.arange(0.0, 6.0, 0.0005)
    slipping = measure_odometry(
        PATH, long, OdometryErrors(slip=0.05, slip_time_s=0.02), np.random.default_rng(3)
    )
    still = PATH.states(long).v_cam
    share = np.linalg.norm(slipping.v_cam, axis=1) / np.linalg.norm(still, axis=1) - 1.0
    assert np.std(share) == pytest.approx(0.05, rel=0.15)
    drawn = [OdometrySpread(scale_sd=0.1).draw(np.random.default_rng(k)).scale for k in range(400)]
    assert np.std(drawn) == pytest.approx(0.1, rel=0.1)


def test_bad_input_is_refused():
    with pytest.raises(ConfigError, match="noise_px -1"):
        tracks(-1.0)
    with pytest.raises(ConfigError, match="increasing"):
        CameraPath(np.array([0.0, 0.0]), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)))
