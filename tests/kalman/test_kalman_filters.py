import numpy as np
import pytest

from camnet.errors import ConfigError, DataError
from camnet.estimation.kalman import (
    ExtendedKalmanFilter,
    KalmanFilter,
    LinearModel,
    UnscentedKalmanFilter,
    constant_acceleration,
    constant_velocity,
)
from camnet.estimation.pls import ConstantTurn, PowerLimitedSteering

NOTHING = np.zeros((0, 3)), np.zeros((0, 3, 3))
MOVING = np.array([0.0, 0.0, 0.0, 1.2, 0.3, -0.1, 0.5, 0.02, -0.01, 0.05])
SPREAD = np.diag([4.0] * 3 + [0.04] * 3 + [0.01] + [4e-4] * 3)


def _covariances(rng, count):
    a = rng.normal(size=(count, 3, 3))
    return a @ a.transpose(0, 2, 1) + np.eye(3)


def _scenario(rng, steps=12, gap=(4, 7)):
    """Observations of one to three observers with a gap; (obs, cov) by step."""
    out = []
    for k in range(steps):
        count = 0 if gap[0] <= k < gap[1] else 1 + k % 3
        cov = _covariances(rng, count)
        out.append((np.array([0.5 * k, -0.2 * k, 1.0]) + rng.normal(size=(count, 3)), cov))
    return out


def _batch(model: LinearModel, mean, cov, data):
    """Posterior of all states at once from the dense joint information matrix: no recursion."""
    n, steps = len(mean), len(data)
    info, vec = np.zeros((n * steps, n * steps)), np.zeros(n * steps)
    info[:n, :n] += np.linalg.inv(cov)
    vec[:n] += np.linalg.solve(cov, mean)
    w = np.linalg.inv(model.noise)
    for k, (obs, covs) in enumerate(data):
        if k:
            j = np.zeros((n, n * steps))
            j[:, n * (k - 1) : n * k], j[:, n * k : n * (k + 1)] = -model.transition, np.eye(n)
            info += j.T @ w @ j
        for z, r in zip(obs, covs, strict=True):
            s = slice(n * k, n * k + 3)
            info[s, s] += np.linalg.inv(r)
            vec[s] += np.linalg.solve(r, z)
    joint = np.linalg.inv(info)
    return (joint @ vec).reshape(steps, n), joint[-n:, -n:]


@pytest.mark.parametrize("model", [constant_velocity(0.7, 0.2), constant_acceleration(0.7, 0.05)])
@pytest.mark.parametrize("kind", [KalmanFilter, UnscentedKalmanFilter])
def test_filter_and_smoother_equal_the_dense_posterior(model, kind):
    rng = np.random.default_rng(3)
    n = len(model.transition)
    mean, cov = rng.normal(size=n), np.diag(rng.uniform(1.0, 4.0, n))
    data = _scenario(rng)
    est = kind(model, dt_s=0.7, lag=50, mean=mean, covariance=cov)
    for k, (obs, covs) in enumerate(data):
        est.update(obs, covs)
        states, last = _batch(model, mean, cov, data[: k + 1])
        np.testing.assert_allclose(est.trajectory, states, atol=1e-7)
        np.testing.assert_allclose(est.covariance, last, atol=1e-7)


def test_fixed_lag_freezes_older_states_only():
    rng = np.random.default_rng(0)
    model = constant_velocity(1.0, 0.1)
    short, whole = KalmanFilter(model, lag=3), KalmanFilter(model, lag=100)
    before = np.empty((0, 6))
    for obs, cov in _scenario(rng, steps=20):
        short.update(obs, cov)
        whole.update(obs, cov)
        now = short.trajectory
        np.testing.assert_array_equal(now[: max(0, len(now) - 4)], before[: max(0, len(now) - 4)])
        np.testing.assert_allclose(now[-4:], whole.trajectory[-4:], atol=1e-9)
        before = now


@pytest.mark.parametrize("model", [PowerLimitedSteering(), ConstantTurn()])
def test_extended_prediction_is_the_linearised_flow(model):
    est = ExtendedKalmanFilter(model, dt_s=0.5, mean=MOVING, covariance=SPREAD)
    est.update(*NOTHING)
    est.update(*NOTHING)
    end, phi, q = model.linearise(MOVING, 0.5)
    np.testing.assert_allclose(est.causal_state, end, atol=1e-12)
    np.testing.assert_allclose(est.covariance, phi @ SPREAD @ phi.T + q, atol=1e-12)


@pytest.mark.parametrize("model", [PowerLimitedSteering(), ConstantTurn()])
def test_unscented_prediction_equals_a_plain_sigma_point_sum(model):
    est = UnscentedKalmanFilter(
        model, dt_s=0.5, mean=MOVING, covariance=SPREAD, alpha=0.9, beta=2.0, kappa=0.5
    )
    est.update(*NOTHING)
    est.update(*NOTHING)
    n, alpha, beta, kappa = 10, 0.9, 2.0, 0.5
    lam = alpha**2 * (n + kappa) - n
    root = np.linalg.cholesky((n + lam) * SPREAD).T
    points = np.vstack([MOVING, MOVING + root, MOVING - root])
    wm = np.full(2 * n + 1, 0.5 / (n + lam))
    wc = wm.copy()
    wm[0], wc[0] = lam / (n + lam), lam / (n + lam) + 1 - alpha**2 + beta
    moved = np.array([model.step(s, 0.5) for s in points])
    mean = wm @ moved
    cov = (moved - mean).T @ np.diag(wc) @ (moved - mean) + model.linearise(MOVING, 0.5)[2]
    np.testing.assert_allclose(est.causal_state, mean, atol=1e-10)
    np.testing.assert_allclose(est.covariance, cov, atol=1e-10)


@pytest.mark.parametrize("kind", [ExtendedKalmanFilter, UnscentedKalmanFilter])
def test_steering_filters_follow_a_turn_with_sound_covariances(kind):
    rng = np.random.default_rng(1)
    angle = np.arange(200) / 25.0
    truth = 25.0 * np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=1)
    est = kind(PowerLimitedSteering(), lag=50)
    for k, x in enumerate(truth):
        if 100 <= k < 110:
            est.update(*NOTHING)
        else:
            est.update(x + rng.normal(size=(2, 3)), np.tile(np.eye(3), (2, 1, 1)))
        assert np.linalg.eigvalsh(est.covariance)[0] > 0.0
    error = np.linalg.norm(est.trajectory[:, :3] - truth, axis=1)
    assert np.sqrt(np.mean(error[20:] ** 2)) < 0.8  # one observation: 1.7, one step's mean: 1.2
    assert np.linalg.norm(est.causal_state[7:10] - [0, 0, 0.04]) < 0.03


def test_filterpy_agrees():
    fk = pytest.importorskip("filterpy.kalman")
    rng = np.random.default_rng(2)
    model = constant_acceleration(1.0, 0.02)
    mean, cov = rng.normal(size=9), np.eye(9)
    ours = UnscentedKalmanFilter(model, lag=0, mean=mean, covariance=cov, alpha=1.0, beta=0.1, kappa=0.0)
    points = fk.MerweScaledSigmaPoints(9, alpha=1.0, beta=0.1, kappa=0.0)
    theirs = fk.UnscentedKalmanFilter(9, 3, 1.0, lambda x: x[:3], lambda x, dt: model.transition @ x, points)
    ekf = fk.ExtendedKalmanFilter(9, 3)
    plain = ExtendedKalmanFilter(model, lag=0, mean=mean, covariance=cov)
    theirs.x, theirs.P, theirs.Q = mean.copy(), cov.copy(), model.noise
    ekf.x, ekf.P, ekf.Q, ekf.F = mean.copy(), cov.copy(), model.noise, model.transition
    h = np.eye(3, 9)
    for k in range(10):
        z, r = rng.normal(size=3), _covariances(rng, 1)[0]
        if k:
            theirs.predict()
            ekf.predict()
            theirs.update(z, R=r)
            ekf.update(z, lambda _: h, lambda x: x[:3], R=r)
        ours.update(*((z[None], r[None]) if k else NOTHING))
        plain.update(*((z[None], r[None]) if k else NOTHING))
        np.testing.assert_allclose(ours.causal_state, theirs.x, atol=1e-8)
        np.testing.assert_allclose(ours.covariance, theirs.P, atol=1e-8)
        np.testing.assert_allclose(plain.causal_state, ekf.x, atol=1e-8)
        np.testing.assert_allclose(plain.covariance, ekf.P, atol=1e-8)


def test_stone_soup_agrees():
    pytest.importorskip("stonesoup")
    from datetime import datetime, timedelta

    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    rng = np.random.default_rng(4)
    order = [0, 3, 1, 4, 2, 5]  # theirs: x vx y vy z vz
    mean, cov = rng.normal(size=6), np.eye(6)
    ours = KalmanFilter(constant_velocity(1.0, 0.3), lag=0, mean=mean, covariance=cov)
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.3)] * 3)
    start = datetime(2026, 1, 1)
    state = GaussianState(mean[order, None], cov, timestamp=start)
    ours.update(*NOTHING)
    for k in range(1, 8):
        z, r = rng.normal(size=3), _covariances(rng, 1)[0]
        predicted = KalmanPredictor(motion).predict(state, timestamp=start + timedelta(seconds=k))
        sensor = LinearGaussian(6, [0, 2, 4], r)
        detection = Detection(z[:, None], timestamp=predicted.timestamp, measurement_model=sensor)
        state = KalmanUpdater(sensor).update(SingleHypothesis(predicted, detection))
        ours.update(z[None], r[None])
        np.testing.assert_allclose(
            ours.causal_state[order], np.asarray(state.state_vector).ravel(), atol=1e-9
        )
        np.testing.assert_allclose(ours.covariance[np.ix_(order, order)], state.covar, atol=1e-9)


def test_misuse_is_refused_with_the_value():
    est = KalmanFilter(constant_velocity(1.0, 1.0))
    with pytest.raises(DataError, match="first update"):
        est.update(*NOTHING)
    with pytest.raises(DataError, match=r"shape \(2,\)"):
        est.update(np.zeros(2), np.eye(3)[None])
    with pytest.raises(DataError, match="positive definite"):
        est.update(np.zeros((1, 3)), -np.eye(3)[None])
    with pytest.raises(DataError, match="nan"):
        est.update(np.full((1, 3), np.nan), np.eye(3)[None])
    with pytest.raises(ConfigError, match="lag: -1"):
        KalmanFilter(constant_velocity(1.0, 1.0), lag=-1)
    with pytest.raises(ConfigError, match="dt_s"):
        KalmanFilter(constant_velocity(1.0, 1.0), dt_s=0.0)
    with pytest.raises(ConfigError, match="noise"):
        LinearModel(np.eye(6), -np.eye(6))
    with pytest.raises(ConfigError, match="kappa"):
        UnscentedKalmanFilter(constant_velocity(1.0, 1.0), kappa=-6.0)
