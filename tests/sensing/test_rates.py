"""Rates by regression: exact on constant twists, against NumPy's polynomial fit, and with the stated noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.geometry import rotations as rot
from camnet.sensing.rates import RateRegression, regress_rates

V, W = np.array([0.3, -0.2, 0.1]), np.array([0.1, -0.2, 1.1])


def constant_twist(t, q0=(0.5, 0.5, -0.5, 0.5)):
    return np.array([1.0, 2.0, 3.0]) + t[:, None] * V, rot.multiply(np.array(q0), rot.exp(t[:, None] * W))


@pytest.mark.parametrize("degree", [1, 2])
@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_constant_twist_is_recovered_exactly_at_uneven_times_and_any_sign(degree, seed):
    rng = np.random.default_rng(seed)
    t = 100.0 + np.cumsum(rng.uniform(0.01, 0.08, 20))
    p, q = constant_twist(t)
    q *= rng.choice([-1.0, 1.0], 20)[:, None]
    twist = regress_rates(t, p, q, degree)
    np.testing.assert_allclose(twist.v, V, atol=1e-9)
    np.testing.assert_allclose(twist.w, W, atol=1e-9)


@pytest.mark.parametrize("degree", [1, 2])
def test_positions_agree_with_polyfit_and_orientations_with_polyfit_of_logs(degree):
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(5, 6, 20))
    p, q = constant_twist(t)
    p, q = p + 0.02 * rng.normal(size=p.shape), rot.multiply(q, rot.exp(0.02 * rng.normal(size=p.shape)))
    r = rot.log(rot.multiply(rot.conjugate(q[-1]), q))
    twist = regress_rates(t, p, q, degree)
    peer = np.polyfit(t - t[-1], np.hstack([p, r]), degree)[-2]
    np.testing.assert_allclose(np.hstack([twist.v, twist.w]), peer, rtol=1e-9)


def test_degree_two_has_no_lag_under_constant_acceleration_and_degree_one_half_a_window():
    t = np.arange(20) / 30.0
    p = 0.5 * np.array([2.0, 0.0, -1.0]) * t[:, None] ** 2
    q = np.broadcast_to(rot.IDENTITY, (20, 4))
    np.testing.assert_allclose(regress_rates(t, p, q, 2).v, np.array([2.0, 0, -1.0]) * t[-1], atol=1e-10)
    np.testing.assert_allclose(regress_rates(t, p, q, 1).v, np.array([2.0, 0, -1.0]) * t[-1] / 2, atol=1e-10)


def test_angular_velocity_at_the_newest_sample_when_the_axis_moves():
    # a coning motion, integrated finely by its own kinematics
    h, n = 1e-4, 1000
    q, t = [rot.IDENTITY], np.arange(n + 1) * h
    w = np.stack([0.8 * np.cos(5 * t), 0.8 * np.sin(5 * t), 1.5 + 0 * t], axis=1)
    for k in range(n):
        q.append(rot.multiply(q[-1], rot.exp(h * 0.5 * (w[k] + w[k + 1]))))
    q = np.array(q)[-101::5]
    twist = regress_rates(t[-101::5], np.zeros((21, 3)), q, 2)
    np.testing.assert_allclose(twist.w, w[-1], atol=2e-4)


@pytest.mark.parametrize(("degree", "factor"), [(1, 12.0), (2, 192.0)])
def test_noise_is_as_stated(degree, factor):
    rng = np.random.default_rng(3)
    n, dt, s = 20, 1 / 30, 0.01
    t = np.arange(n) * dt
    p, q = constant_twist(t)
    errors = [regress_rates(t, p + s * rng.normal(size=p.shape), q, degree).v - V for _ in range(1500)]
    np.testing.assert_allclose(np.std(errors, axis=0), s * np.sqrt(factor / n**3) / dt, rtol=0.12)


def test_the_moving_window_is_the_regression_over_its_samples():
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.02, 0.05, 60))
    p, q = rng.normal(size=(60, 3)), rot.normalise(rng.normal(size=(60, 4)))
    moving = RateRegression(20)
    for k in range(60):
        moving.push(t[k], p[k], q[k])
        if k < 19:
            assert moving.rates() is None
            continue
        peer, own = regress_rates(t[k - 19 : k + 1], p[k - 19 : k + 1], q[k - 19 : k + 1]), moving.rates()
        np.testing.assert_allclose(own.v, peer.v, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(own.w, peer.w, rtol=1e-9, atol=1e-12)


def test_early_rates_and_gaps():
    t = np.arange(12) / 30.0
    p, q = constant_twist(t)
    moving = RateRegression(10, min_samples=4, max_gap_s=0.5)
    for k in range(12):
        moving.push(t[k], p[k], q[k])
        assert (moving.rates() is None) == (k < 3)
    moving.push(t[-1] + 1.0, p[0], q[0])
    assert moving.rates() is None
    moving.reset()
    assert moving.rates() is None


def test_times_that_determine_nothing_give_none():
    p, q = np.zeros((5, 3)), np.tile(rot.IDENTITY, (5, 1))
    assert regress_rates(np.zeros(5), p, q) is None
    assert regress_rates([0.0, 0.0, 1.0, 1.0, 1.0], p, q, 2) is None
    assert regress_rates([0.0, 0.0, 1.0, 1.0, 1.0], p, q, 1) is not None


def test_misuse_is_named():
    moving = RateRegression(5)
    moving.push(1.0, np.zeros(3), rot.IDENTITY)
    with pytest.raises(ValueError, match=r"0\.5 s after one at 1\.0 s"):
        moving.push(0.5, np.zeros(3), rot.IDENTITY)
    with pytest.raises(ValueError, match="window 3"):
        RateRegression(3, degree=2)
