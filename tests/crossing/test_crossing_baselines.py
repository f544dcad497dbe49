"""Baselines across gaps: last seen, the constant-velocity filter, the flow field."""

from itertools import pairwise

import numpy as np
import pytest

from camnet.estimation.crossing import (
    FixFilter,
    FixFilterSettings,
    FlowField,
    FlowSettings,
    LastSeen,
    Lesson,
    Sighting,
)


def sighting(t, p, v=(0.0, 0.0), camera=0, target=0):
    return Sighting(float(t), np.array(p, dtype=float), np.array(v, dtype=float), camera, target)


def test_last_seen_stays():
    prediction = LastSeen(3).predict(sighting(5, (1, 2), (3, 4), camera=2), 100.0)
    np.testing.assert_array_equal(prediction.p_world, [1, 2])
    np.testing.assert_array_equal(prediction.next_camera, [0, 0, 1])


def test_filter_is_the_textbook_filter_in_matrices():
    rng = np.random.default_rng(0)
    settings = FixFilterSettings(accel_psd_m2ps3=0.02, position_noise_m=3.0, first_speed_std_mps=1.0)
    fast = FixFilter(settings)
    times = np.cumsum(rng.uniform(5.0, 40.0, 30))
    fixes = np.cumsum(rng.normal(0.0, 10.0, (30, 2)), axis=0)
    fast.restart(times[0], fixes[0])
    x, P = np.concatenate([fixes[0], [0, 0]]), np.diag([9.0, 9.0, 1.0, 1.0])
    H = np.eye(2, 4)
    for k in range(1, 30):
        dt = times[k] - times[k - 1]
        F = np.block([[np.eye(2), dt * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
        Q = 0.02 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
        x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 9.0 * np.eye(2))
        x, P = x + K @ (fixes[k] - H @ x), P - K @ H @ P
        fast.update(times[k], fixes[k])
    np.testing.assert_allclose(fast.p, x[:2], atol=1e-9)
    np.testing.assert_allclose(fast.v, x[2:], atol=1e-9)
    np.testing.assert_allclose(fast.covariance, [P[0, 0], P[0, 2], P[2, 2]], atol=1e-9)
    np.testing.assert_allclose(fast.predict(times[-1] + 20.0), x[:2] + 20.0 * x[2:], atol=1e-9)


def test_filter_finds_a_straight_line():
    kalman = FixFilter(FixFilterSettings(accel_psd_m2ps3=1e-9))
    kalman.restart(0.0, np.zeros(2))
    for t in range(10, 500, 10):
        kalman.update(float(t), np.array([1.2 * t, -0.3 * t]))
    np.testing.assert_allclose(kalman.predict(600.0), [720.0, -180.0], atol=0.5)


BOUNDS = np.array([[-60.0, -60.0], [60.0, 60.0]])


def walk(field, speed, count=40):
    """Targets that walk a circle of radius 40 m, seen on its right half only; the left half is a gap."""
    rate = speed / 40.0

    def state(t, angle):
        p = 40.0 * np.array([np.cos(angle), np.sin(angle)])
        return sighting(t, p, speed * np.array([-np.sin(angle), np.cos(angle)]))

    t, half = 0.0, np.pi / rate
    for _ in range(count):
        seen = [state(t + s, -np.pi / 2 + rate * s) for s in np.arange(0.0, half + 1e-9, half / 10)]
        for before, after in pairwise(seen):
            field.observe(before, after)
        t += half
        entry = state(t + half, 3 * np.pi / 2)
        middle = state(t + half / 2, np.pi)  # somebody else whose gap ends and begins half-way
        field.learn(Lesson(seen[-1], middle, t + half / 2))
        field.learn(Lesson(middle, entry, t + half))
        t += half
    return state(t, np.pi / 2), t, half


def test_flow_across_gaps_is_learned_only_with_the_windows_across():
    errors = {}
    for across in (False, True):
        settings = FlowSettings(
            learn_across=across, prior=False, refit_after=40, regularisation=0.1, window_s=15.0
        )
        field = FlowField(settings, 1, BOUNDS)
        exit_, t, half = walk(field, speed=1.3)
        exit_ = sighting(t + 1.0, exit_.p_world, exit_.v_world)
        place = field.predict(exit_, exit_.t_s + half).p_world
        errors[across] = np.linalg.norm(place - [0.0, -40.0])
    assert errors[True] < 12.0
    assert errors[False] > 30.0


def test_flow_without_data_is_the_fading_exit_velocity():
    field = FlowField(FlowSettings(prior_memory_s=20.0, step_s=0.5), 1, BOUNDS)
    exit_ = sighting(0, (0, 0), (1.0, 0.5))
    expected = 20.0 * (1.0 - np.exp(-1.5)) * np.array([1.0, 0.5])
    np.testing.assert_allclose(field.position(exit_, 30.0), expected, rtol=1e-3)


def test_flow_uses_no_model_from_after_the_exit():
    settings = FlowSettings(prior=False, refit_after=10, headings=1)
    field = FlowField(settings, 1, BOUNDS)
    walk(field, speed=1.3, count=20)
    early = sighting(0.0, (40.0, 0.0), (0.0, 1.3))
    np.testing.assert_array_equal(field.position(early, 30.0), early.p_world)


@pytest.mark.parametrize("t", [1.0, 500.0])
def test_flow_prediction_is_finite(t):
    field = FlowField(FlowSettings(refit_after=10, headings=1), 1, BOUNDS)
    _, now, _ = walk(field, speed=1.3, count=20)
    assert np.all(np.isfinite(field.position(sighting(now + 1, (500.0, 0.0), (1, 1)), now + 1 + t)))
