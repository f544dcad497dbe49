from __future__ import annotations

import itertools

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation.adate_filter import AdateFilter
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import AdateFilterSettings, EkfSettings
from camnet.simulation.filters import FILTERS
from camnet.types import CameraMotion, PoseMeasurement

RATE = 10.0
STILL = CameraMotion(np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3))


def circle(t_s, speed=0.35, radius=4.0):
    a = speed * t_s / radius
    return radius * np.array([np.cos(a), np.sin(a), 0.0]), a + 0.5 * np.pi


def measured(t_s, rng):
    p, heading = circle(t_s)
    q = np.array([np.cos(heading / 2), 0, 0, np.sin(heading / 2)])
    return PoseMeasurement(t_s, 0, 0, p + rng.normal(scale=0.01, size=3), q, STILL)


def follow(filter_, end_s, on_s=10.0, off_s=8.0, seed=0):
    """Errors while seen and unseen, and how often the radius held, of one who is seen now and then."""
    rng = np.random.default_rng(seed)
    seen, unseen, held = [], [], []
    for k in range(round(end_s * RATE)):
        t = k / RATE
        visible = t % (on_s + off_s) < on_s
        if visible:
            filter_.correct(measured(t, rng), 0)
        else:
            filter_.predict(t)
        estimate = filter_.estimate
        away = float(np.linalg.norm(estimate.p_world - circle(t)[0]))
        (seen if visible else unseen).append(away)
        if not visible:
            held.append(away <= estimate.radius_m)
    return (
        np.sqrt(np.mean(np.square(seen))),
        np.sqrt(np.mean(np.square(unseen or [0.0]))),
        np.mean(held or [1]),
    )


@pytest.fixture
def adate():
    return AdateFilter(AdateFilterSettings(), EkfSettings(), RATE)


def test_is_a_target_filter_known_by_name(adate):
    assert isinstance(adate, TargetFilter)
    assert "adate" in FILTERS
    assert adate.estimate.region == -1
    assert np.isinf(adate.estimate.radius_m)
    with pytest.raises(ConfigError, match="rate_hz"):
        AdateFilter(AdateFilterSettings(), EkfSettings(), 0.0)


def test_over_gaps_a_turning_target_is_predicted_better_than_at_constant_velocity(adate):
    seen, unseen, held = follow(adate, 90.0)
    baseline = follow(ConstantVelocityEKF(EkfSettings(), RATE), 90.0)
    assert seen < 0.02
    assert unseen < 0.5 * baseline[1]
    assert held > 0.8
    assert adate.diagnostics()["restarts"] == 0


def test_rollout_is_what_prediction_then_says_and_changes_nothing(adate):
    follow(adate, 10.0)
    t = adate.estimate.t_s
    before = adate.estimate
    path = adate.rollout(4.0, 0.2)
    np.testing.assert_array_equal(adate.estimate.p_world, before.p_world)
    assert (np.diff(path.radius_m) > 0).all()
    for k in range(1, 21):
        adate.predict(t + 0.2 * k)
        now = adate.estimate
        np.testing.assert_allclose(now.p_world, path.p_world[k - 1], atol=0.1)
    assert not adate.estimate.seen
    speed = np.linalg.norm(np.diff(path.p_world, axis=0), axis=1) / 0.2
    np.testing.assert_allclose(speed, 0.35, atol=0.05)


def test_orientation_turns_with_the_path_over_a_gap(adate):
    follow(adate, 14.0, on_s=10.0, off_s=8.0)
    _, heading = circle(13.9)
    q = adate.estimate.q_world
    found = 2.0 * np.arctan2(q[3], q[0])
    assert np.cos(found - heading) > np.cos(0.15)


def test_the_radius_follows_what_the_re_sightings_showed(adate):
    factors = []
    for shift in (0.0, 40.0):  # the second time it comes back where nobody expected it
        if shift == 0.0:
            follow(adate, 10.0)
        rng = np.random.default_rng(1)
        t0 = adate.estimate.t_s
        for k in range(1, 61):
            adate.predict(t0 + k / RATE)
        z = measured(t0 + 6.1, rng)
        adate.correct(PoseMeasurement(z.t_s, 0, 0, z.p_cam + np.array([shift, 0, 0]), z.q_cam, STILL), 0)
        factors.append(adate.inflation)
    assert factors[1] > 3.0 * factors[0]


def test_covariances_stay_positive_definite_and_late_measurements_are_taken(adate):
    rng = np.random.default_rng(2)
    for k in range(120):
        z = measured(k / RATE, rng)
        if k % 10 == 3:
            adate.predict(k / RATE + 0.02)  # now late
        adate.correct(z, 0)
        assert np.linalg.eigvalsh(adate._cov)[0] > 0.0
    for a, b in itertools.pairwise(adate.rollout(30.0, 0.5).radius_m):
        assert b > a
