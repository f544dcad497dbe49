"""Late measurements: the settled filter is the one that got them in time, and the present follows from it."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.delayed import DelayedFilter, underlying
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.placement import grid_centres
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EkfSettings, EstimatorSettings
from camnet.geometry import rotations
from camnet.simulation.statistics import _excited, _learner
from camnet.types import CameraMotion, PoseMeasurement

RATE, SPEED, RADIUS = 20.0, 0.5, 1.0
BASIS = RbfBasis.create(grid_centres(np.array([-1.5, -1.5]), np.array([1.5, 1.5]), 0.5), 0.25)
BOUNDS = np.array([[-3.0, -3.0, -1.0], [3.0, 3.0, 1.0]])
STILL = CameraMotion(np.zeros(3), rotations.IDENTITY, np.zeros(3), np.zeros(3))


def learning():
    return LearningEstimator(EstimatorSettings(), BASIS, 2, RATE, BOUNDS)


def kalman():
    return ConstantVelocityEKF(EkfSettings(), RATE)


def truth(t):
    a = SPEED / RADIUS * t
    return np.array([RADIUS * np.cos(a), RADIUS * np.sin(a), 0.0]), rotations.from_yaw(a + np.pi / 2)


def seen(k, rng):
    """A sighting of frame k, or none: drop-outs, and gaps of two seconds after every five."""
    p, q = truth(k / RATE)
    p = p + 0.005 * rng.standard_normal(3)
    hidden = k % 140 >= 100 or rng.random() < 0.02
    return None if hidden else PoseMeasurement(k / RATE, 0, 0, p, q, STILL)


def recording(count, seed=0):
    rng = np.random.default_rng(seed)
    return [(k / RATE, seen(k, rng), (k // 140) % 2) for k in range(count)]


def in_time(filter_, frames):
    for t, z, region in frames:
        if z is None:
            filter_.predict(t)
        else:
            filter_.correct(z, region)
        yield filter_


def late(delayed, frames, arrivals):
    """Feed frame i's measurement at the first frame from ``arrivals[i]`` s on, then go on to the present."""
    for t, _, _ in frames:
        for (_, z, region), arrival in zip(frames, arrivals, strict=True):
            if z is not None and t - 1 / RATE + 1e-9 < arrival <= t + 1e-9:
                delayed.correct(z, region)
        delayed.predict(t)
        yield delayed


def same(a: TargetFilter, b: TargetFilter):
    x, y = a.estimate, b.estimate
    for name in (
        "t_s",
        "p_world",
        "q_world",
        "v_world",
        "w_body",
        "seen",
        "last_seen_s",
        "region",
        "radius_m",
    ):
        np.testing.assert_array_equal(getattr(x, name), getattr(y, name), err_msg=name)
    assert a.diagnostics() == b.diagnostics()


@pytest.mark.parametrize("make", [learning, kalman])
@pytest.mark.parametrize("latency", [0.2, 0.13, 0.0])
def test_with_constant_latency_the_state_then_is_the_state_without(make, latency):
    """Bit for bit, at every frame, over gaps, drop-outs and changes of region."""
    frames = recording(420)
    lag = int(np.ceil(latency * RATE - 1e-9))
    plain, delayed = make(), DelayedFilter(make(), latency)
    arrivals = [t + latency for t, _, _ in frames]
    past = in_time(plain, frames)
    for k, now in enumerate(late(delayed, frames, arrivals)):
        if k >= lag:
            then = next(past)
            if k % 20 == 0 or k > 400:
                same(now.settled, then)
    model = underlying(delayed)
    if isinstance(model, LearningEstimator):
        np.testing.assert_array_equal(model.model(0).weights, plain.model(0).weights)
        assert model.diagnostics()["gaps_learned"] > 0


@given(st.lists(st.floats(0.0, 0.3), min_size=160, max_size=160))
@settings(max_examples=5, deadline=None)
def test_any_order_of_arrival_settles_alike(latencies):
    frames = recording(160, 1)
    arrivals = [t + x for (t, _, _), x in zip(frames, latencies, strict=True)]
    plain, delayed = kalman(), DelayedFilter(kalman(), 0.3)
    *_, plain = in_time(plain, frames[: 160 - 6])
    *_, delayed = late(delayed, frames, arrivals)
    same(delayed.settled, plain)
    assert delayed.diagnostics()["late"] == 0


@pytest.mark.parametrize("make", [learning, kalman])
def test_the_present_is_the_settled_state_and_what_came_since(make):
    """With measurements that come early: a fresh run over the settled frames and the open ones."""
    frames = recording(80, 2)
    rng = np.random.default_rng(3)
    arrivals = [t + (0.0 if rng.random() < 0.5 else 0.2) for t, _, _ in frames]
    delayed, again = DelayedFilter(make(), 0.2), make()
    *_, delayed = late(delayed, frames, arrivals)
    now = frames[-1][0]
    known = [(t, z if a <= now + 1e-9 else None, r) for (t, z, r), a in zip(frames, arrivals, strict=True)]
    *_, again = in_time(again, known)
    x, y = delayed.estimate, again.estimate
    np.testing.assert_array_equal(x.p_world, y.p_world)
    np.testing.assert_array_equal(x.v_world, y.v_world)
    np.testing.assert_array_equal(delayed.rollout(2.0, 0.2).p_world, again.rollout(2.0, 0.2).p_world)


@pytest.mark.parametrize("make", [learning, kalman])
def test_the_present_is_the_settled_filters_own_prediction(make):
    """With one latency: carried on by a roll-out, against the filter itself predicting on."""
    frames = recording(95, 4)
    delayed = DelayedFilter(make(), 0.25)
    *_, delayed = late(delayed, frames, [t + 0.25 for t, _, _ in frames])
    now = frames[-1][0]
    on = copy.deepcopy(delayed.settled)
    on.predict(now)
    x, y = delayed.estimate, on.estimate
    assert x.t_s == now
    np.testing.assert_allclose(x.p_world, y.p_world, atol=2e-4)
    assert float(rotations.angle_between(x.q_world, y.q_world)) < 2e-3
    np.testing.assert_allclose(x.v_world, y.v_world, atol=5e-3)
    np.testing.assert_allclose(x.w_body, y.w_body, atol=2e-2)
    path = delayed.rollout(1.0, 0.1)
    np.testing.assert_allclose(path.t_s, now + 0.1 * np.arange(1, 11))
    ahead, _ = truth(now)
    assert np.linalg.norm(x.p_world - ahead) < 0.05
    assert np.linalg.norm(delayed.settled.estimate.p_world - ahead) > 0.1


def test_before_the_first_measurement_nothing_is_known():
    delayed = DelayedFilter(kalman(), 0.2)
    for k in range(5):
        delayed.predict(k / RATE)
    assert delayed.estimate.region == -1
    assert np.isnan(delayed.estimate.p_world).all()
    assert delayed.estimate.radius_m == np.inf


def test_what_comes_after_the_horizon_is_left_out_and_counted():
    frames = recording(60, 5)
    delayed = DelayedFilter(kalman(), 0.1)
    *_, delayed = late(delayed, frames, [t + 0.1 for t, _, _ in frames])
    before = delayed.estimate.p_world
    delayed.correct(PoseMeasurement(1.0, 0, 0, np.full(3, 9.0), rotations.IDENTITY, STILL), 0)
    np.testing.assert_array_equal(delayed.estimate.p_world, before)
    assert delayed.diagnostics()["late"] == 1
    assert isinstance(delayed, TargetFilter)


@pytest.mark.parametrize("horizon", [-0.1, np.inf, np.nan])
def test_the_horizon_is_finite(horizon):
    with pytest.raises(ConfigError, match="horizon_s"):
        DelayedFilter(kalman(), horizon)


def test_excitation_is_told_of_the_filter_inside() -> None:
    estimator = learning()
    late = _learner(DelayedFilter(estimator, 0.1))
    assert not _excited(late, 0)
    estimator.model(0).integral.excited_s = 1.0
    assert _excited(estimator, 0)
    assert _excited(late, 0)
    assert not _excited(late, 1)
    assert not _excited(_learner(ConstantVelocityEKF(EkfSettings(), RATE)), 0)
