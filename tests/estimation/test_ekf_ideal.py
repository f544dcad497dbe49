"""Kalman baseline against an independent linear filter and Monte Carlo; ideal predictor against the truth."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camnet.errors import ConfigError
from camnet.estimation import ConstantVelocityEKF, IdealPredictor, TargetFilter
from camnet.estimation.ekf import (
    START_SPEED_MPS,
    coast,
    predict_covariances,
    update_orientation,
    update_position,
)
from camnet.estimation.ekf_step import correct_state, predict_state
from camnet.estimation.settings import EkfSettings, EstimatorSettings
from camnet.geometry import rotations
from camnet.types import Twist

Q0 = np.array([1.0, 0.0, 0.0, 0.0])


@given(seed=st.integers(0, 10_000))
def test_position_part_is_the_linear_kalman_filter(seed: int, measurement_of: Callable) -> None:
    """Information-form filter on the stacked (p, v) of all axes, with drop-outs and irregular times."""
    rng = np.random.default_rng(seed)
    s = EkfSettings()
    ekf = ConstantVelocityEKF(s, 30.0)
    t, x, cov = 0.0, None, None
    h = np.hstack((np.eye(3), np.zeros((3, 3))))
    for _ in range(15):
        dt = rng.uniform(0.01, 0.3)
        t += dt
        seen = x is None or rng.uniform() < 0.7
        z = rng.standard_normal(3)
        if x is None:
            x = np.concatenate((z, np.zeros(3)))
            cov = np.diag([s.position_noise_m**2] * 3 + [START_SPEED_MPS**2] * 3)
        else:
            f = np.eye(6) + dt * np.eye(6, k=3)
            noise = s.accel_psd_m2ps3 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))
            x, cov = f @ x, f @ cov @ f.T + noise
            if seen:
                information = np.linalg.inv(cov)
                cov_new = np.linalg.inv(information + h.T @ h / s.position_noise_m**2)
                x = cov_new @ (information @ x + h.T @ z / s.position_noise_m**2)
                cov = cov_new
        if seen:
            ekf.correct(measurement_of(t, z, Q0), 0)
        else:
            ekf.predict(t)
        np.testing.assert_allclose(ekf.estimate.p_world, x[:3], atol=1e-8)
        np.testing.assert_allclose(ekf.estimate.v_world, x[3:], atol=1e-7)
        assert ekf.diagnostics()["position_std_m"] == pytest.approx(math.sqrt(cov[0, 0]), rel=1e-6)


def test_orientation_covariance_against_monte_carlo() -> None:
    """Small errors of (q, w) carried by the true kinematics have the predicted covariance."""
    rng = np.random.default_rng(0)
    a = 0.02 * rng.standard_normal((6, 6))
    cov, w, dt = a @ a.T + 1e-5 * np.eye(6), np.array([0.4, -0.3, 0.9]), 0.5
    errors = rng.multivariate_normal(np.zeros(6), cov, 40_000)
    mean = rotations.exp(dt * w)
    end = rotations.multiply(rotations.exp(errors[:, :3]), rotations.exp(dt * (w + errors[:, 3:])))
    turned = rotations.log(rotations.multiply(rotations.conjugate(mean), end))
    sample = np.cov(np.hstack((turned, errors[:, 3:])).T)
    _, got = predict_covariances(np.eye(2), cov, w, dt, 0.0, 0.0)
    # the filter takes the integral of the turning frame to first order: within a few per cent of the whole
    assert np.linalg.norm(got - sample) < 0.15 * np.linalg.norm(sample)


def test_coasting_turns_at_the_body_rate() -> None:
    q, w = rotations.exp([0.3, 0.1, -0.5]), np.array([0.2, 0.5, -0.4])
    t, p, qs = coast(1.0, np.zeros(3), q, np.array([1.0, 0, 0]), w, 2.0, 0.5)
    np.testing.assert_allclose(t, [1.5, 2, 2.5, 3])
    np.testing.assert_allclose(p[:, 0], [0.5, 1, 1.5, 2])
    for tau, got in zip(t - 1.0, qs, strict=True):
        np.testing.assert_allclose(got, rotations.multiply(q, rotations.exp(tau * w)), atol=1e-12)
    with pytest.raises(ConfigError, match="horizon_s"):
        coast(1.0, np.zeros(3), q, np.zeros(3), w, 0.0, 0.5)


def test_ekf_tracks_a_turning_target_with_either_sign(measurement_of: Callable) -> None:
    rng = np.random.default_rng(0)
    ekf = ConstantVelocityEKF(EkfSettings(), 30.0)
    for k in range(300):
        t = k / 30
        q = rotations.multiply(rotations.from_yaw(0.5 * t), rotations.exp(0.01 * rng.standard_normal(3)))
        ekf.correct(measurement_of(t, np.array([0.3 * t, 0, 0]), (-1) ** k * q), 0)
    e = ekf.estimate
    np.testing.assert_allclose(e.w_body, [0, 0, 0.5], atol=0.05)
    assert rotations.angle_between(e.q_world, rotations.from_yaw(0.5 * e.t_s)) < 0.02
    assert e.seen
    ekf.predict(e.t_s + 1.0)
    assert not ekf.estimate.seen
    assert ekf.estimate.radius_m > e.radius_m
    roll = ekf.rollout(2.0, 0.1)
    ekf.predict(ekf.estimate.t_s + 2.0)
    np.testing.assert_allclose(roll.p_world[-1], ekf.estimate.p_world, atol=1e-9)
    assert roll.radius_m[-1] == pytest.approx(ekf.estimate.radius_m, rel=1e-6)


def test_ideal_predictor_follows_the_truth_through_a_gap(
    replica_factory: Callable, replica_runner: Callable
) -> None:
    replica = replica_factory(1)
    result = replica_runner(replica, IdealPredictor(replica.twist, EstimatorSettings(), 30.0))
    assert result.rmse(False, 0) < 0.03
    assert math.degrees(result.rmse(False, 0, kind="orientation_rad")) < 1.5


def test_all_filters_answer_to_the_protocol() -> None:
    ideal = IdealPredictor(lambda t: Twist(np.zeros(3), np.zeros(3)), EstimatorSettings(), 30.0)
    for f in (ConstantVelocityEKF(EkfSettings(), 30.0), ideal):
        assert isinstance(f, TargetFilter)
        f.predict(1.0)
        assert f.estimate.region == -1
        assert np.isnan(f.estimate.p_world).all()
        assert np.isinf(f.rollout(1.0, 0.1).radius_m).all()
    with pytest.raises(ConfigError, match="rate_hz"):
        ConstantVelocityEKF(EkfSettings(), 0.0)


@given(seed=st.integers(0, 10_000))
def test_the_compiled_filter_is_the_readable_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, v, w = rng.standard_normal((3, 3))
    q, dt = rotations.exp(rng.standard_normal(3)), rng.uniform(0.001, 0.5)
    a, b = rng.standard_normal((2, 2)), rng.standard_normal((6, 6))
    cov_p, cov_q = a @ a.T + 0.01 * np.eye(2), b @ b.T + 0.01 * np.eye(6)
    pm = rng.standard_normal(3)
    qm = rotations.multiply(q, rotations.exp(0.3 * rng.standard_normal(3)))
    next_p, next_q = predict_covariances(cov_p, cov_q, w, dt, 0.3, 0.2)
    p1, q1 = p + dt * v, rotations.multiply(q, rotations.exp(dt * w))
    p2, v2, plain_p = update_position(p1, v, next_p, pm, 0.02)
    q2, w2, plain_q = update_orientation(q1, w, next_q, qm, 0.03)
    predict_state(p, q, v, w, cov_p, cov_q, dt, 0.3, 0.2)
    np.testing.assert_allclose(np.concatenate((p, q)), np.concatenate((p1, q1)), atol=1e-12)
    np.testing.assert_allclose(cov_q, next_q, atol=1e-10)
    correct_state(p, q, v, w, cov_p, cov_q, pm, rng.choice([-1.0, 1.0]) * qm, 0.02, 0.03)
    np.testing.assert_allclose(np.concatenate((p, q, v, w)), np.concatenate((p2, q2, v2, w2)), atol=1e-9)
    np.testing.assert_allclose(cov_p, plain_p, atol=1e-10)
    np.testing.assert_allclose(cov_q, plain_q, atol=1e-9)
