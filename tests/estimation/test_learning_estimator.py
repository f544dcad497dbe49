"""The whole estimator on the kinematic replica: gaps, memory per region, double cover, misuse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from rounding import assert_rounded_alike

from camnet.errors import ConfigError
from camnet.estimation import ConstantVelocityEKF, LearningEstimator, TargetFilter, place_basis
from camnet.estimation.propagate import PRIORS, roll_out
from camnet.estimation.settings import (
    BasisSettings,
    EkfSettings,
    EstimatorSettings,
    GapSettings,
    StackSettings,
)
from camnet.geometry.settings import Road

BOUNDS = np.array([[-8.0, -8.0, -1.0], [8.0, 8.0, 3.0]])
LOOP = {"radius": 2.5, "gap_m": 2.2}
PRINTED = EstimatorSettings(leakage=0.0, gap=GapSettings(prior="none", learn_across=False))
VARIANTS = {
    "default": EstimatorSettings(),
    "shared": EstimatorSettings(share=True),
    "relative": EstimatorSettings(frame="relative"),
    "rates": EstimatorSettings(alpha=0.0),
    "mixed": EstimatorSettings(alpha=0.5),
    "sign": EstimatorSettings(switching="sign"),
    "constant_velocity": EstimatorSettings(gap=GapSettings(prior="constant_velocity")),
    "headings": EstimatorSettings(basis=BasisSettings(inputs="position_heading")),
    "small_stack": EstimatorSettings(stack=StackSettings(size=60)),
}


@pytest.fixture(scope="module")
def build(replica_factory: Callable) -> Callable[..., LearningEstimator]:
    lap = replica_factory(1, **LOOP)
    road = Road(name="loop", closed=True, points_m=tuple(map(tuple, lap.p[::30, :2].tolist())))

    def make(settings: EstimatorSettings) -> LearningEstimator:
        basis = place_basis(settings.basis, [road], np.full(2, -6.0), np.full(2, 6.0))
        return LearningEstimator(settings, basis, 4, 30.0, BOUNDS)

    return make


@pytest.fixture(scope="module")
def run(replica_factory: Callable, replica_runner: Callable, build: Callable) -> Callable[[str], Any]:
    """Results over three laps, each computed once."""
    replica = replica_factory(3, **LOOP)

    @cache
    def result(name: str) -> Any:
        if name == "ekf":
            return replica_runner(replica, ConstantVelocityEKF(EkfSettings(), 30.0))
        settings = PRINTED if name == "printed" else VARIANTS.get(name)
        return replica_runner(replica, build(settings or EstimatorSettings(form="stacked")))

    return result


@pytest.mark.parametrize("name", VARIANTS)
def test_gaps_are_bridged_at_once_and_known_after_one_crossing(name: str, run: Callable) -> None:
    learned, ekf = run(name), run("ekf")
    assert learned.rmse(False, 0, 0) <= 1.1 * ekf.rmse(False, 0, 0)
    assert learned.rmse(False, 2) <= 0.1 * ekf.rmse(False, 2)
    kind = "orientation_rad"
    assert learned.rmse(False, 2, 99, kind) <= 0.25 * ekf.rmse(False, 2, 99, kind)
    assert learned.rmse(True, 1) < 0.012


def test_orientation_on_the_first_lap_is_no_worse_than_coasting(
    replica_factory: Callable, replica_runner: Callable, build: Callable
) -> None:
    """Over noise seeds: both know only how the target left, so one lap alone is luck."""
    replica, kind = replica_factory(1, **LOOP), "orientation_rad"
    learned = [
        replica_runner(replica, build(EstimatorSettings()), seed).rmse(False, 0, 0, kind) for seed in range(4)
    ]
    ekf = [
        replica_runner(replica, ConstantVelocityEKF(EkfSettings(), 30.0), seed).rmse(False, 0, 0, kind)
        for seed in range(4)
    ]
    assert np.mean(learned) <= 1.1 * np.mean(ekf)


def test_printed_predictor_stalls_between_regions(run: Callable) -> None:
    """Without the remedies the kernels of the gap are never excited: no lap makes it better than coasting."""
    printed, ekf = run("printed"), run("ekf")
    assert printed.rmse(False, 2) > 1.1 * ekf.rmse(False, 2)
    assert printed.rmse(False, 2) > 10 * run("default").rmse(False, 2)
    assert printed.rmse(True, 1) < 0.012  # in view it is fine


def test_stacked_form_cannot_learn_orientation_on_a_loop(run: Callable) -> None:
    """Double cover: after one revolution the same place comes back with -q, and the learned rates cancel."""
    kind = "orientation_rad"
    assert run("stacked").rmse(False, 2) <= 0.1 * run("ekf").rmse(False, 2)  # positions do not mind
    assert run("stacked").rmse(False, 1, 99, kind) > 5 * run("default").rmse(False, 1, 99, kind)


def test_radius_covers_the_error_after_the_first_lap(run: Callable) -> None:
    result = run("default")
    replica = result.replica
    unseen = (replica.region < 0) & (replica.lap >= 1)
    assert np.mean(result.position_m[unseen] <= result.radius_m[unseen]) > 0.9
    assert result.radius_m[unseen].max() < 2.0


def test_outliers_do_not_spoil_what_was_learned(
    replica_factory: Callable, build: Callable, measurement_of: Callable, run: Callable
) -> None:
    """Every hundredth pose is half a metre off; the gate keeps most such windows out."""
    replica, estimator = replica_factory(3, **LOOP), build(EstimatorSettings())
    rng = np.random.default_rng(0)
    errors = []
    for k in range(len(replica.t)):
        if replica.region[k] >= 0:
            p = replica.p[k] + (0.5 if k % 100 == 50 else 0.01) * rng.standard_normal(3)
            estimator.correct(measurement_of(replica.t[k], p, replica.q[k]), int(replica.region[k]))
        else:
            estimator.predict(float(replica.t[k]))
            if replica.lap[k] >= 2:
                errors.append(np.linalg.norm(estimator.estimate.p_world - replica.p[k]))
    assert np.sqrt(np.mean(np.square(errors))) < 0.5 * run("ekf").rmse(False, 2)
    assert sum(v for name, v in estimator.diagnostics().items() if name.startswith("outliers")) > 0


Q0 = np.array([1.0, 0.0, 0.0, 0.0])


def _straight(
    build: Callable, measurement_of: Callable, seconds: float, region: int = 0
) -> LearningEstimator:
    """A target seen for some seconds on a straight line through the loop's east side."""
    estimator = build(EstimatorSettings())
    for k in range(round(30 * seconds) + 1):
        t = k / 30
        estimator.correct(measurement_of(t, np.array([2.5, -1.0 + 0.4 * t, 0.0]), Q0), region)
    return estimator


def test_before_the_first_measurement_nothing_is_known(build: Callable) -> None:
    estimator = build(EstimatorSettings())
    assert isinstance(estimator, TargetFilter)
    estimator.predict(3.0)
    e = estimator.estimate
    assert e.region == -1
    assert not e.seen
    assert np.isnan(e.p_world).all()
    assert math.isinf(e.radius_m)
    assert np.isnan(estimator.rollout(1.0, 0.1).p_world).all()


def test_what_happens_between_two_measurements_is_not_a_loss(
    build: Callable, measurement_of: Callable
) -> None:
    estimator = _straight(build, measurement_of, 2.0)
    estimator.predict(2.0 + 1 / 60)
    assert estimator.estimate.seen
    estimator.predict(2.0 + 3 / 30)
    assert estimator.estimate.seen
    estimator.predict(2.0 + 4 / 30)
    assert not estimator.estimate.seen
    assert estimator.estimate.last_seen_s == 2.0
    assert estimator.estimate.region == 0


def test_rollout_foretells_what_predict_will_say(build: Callable, measurement_of: Callable) -> None:
    estimator = _straight(build, measurement_of, 3.0)
    estimator.predict(3.2)
    before = estimator.estimate
    roll = estimator.rollout(5.0, 0.05)
    np.testing.assert_array_equal(estimator.estimate.p_world, before.p_world)
    assert roll.t_s[0] == pytest.approx(3.25)
    assert len(roll.t_s) == 100
    for k in range(100):
        estimator.predict(3.2 + 0.05 * (k + 1))
    np.testing.assert_allclose(estimator.estimate.p_world, roll.p_world[-1], atol=0.02)
    assert estimator.estimate.radius_m == pytest.approx(roll.radius_m[-1], rel=0.1)


def test_a_rollout_leaves_out_only_kernels_without_weight(
    build: Callable, replica_factory: Callable, replica_runner: Callable
) -> None:
    """The same path as with all kernels, but for the order of the sums."""
    estimator = build(EstimatorSettings())
    replica_runner(replica_factory(1, **LOOP), estimator)
    basis, now, gap = estimator._basis, estimator.estimate, GapSettings()
    weights = estimator.model(now.region).weights
    assert 0 < np.count_nonzero(weights.any(axis=1)) < basis.size
    path = estimator.rollout(8.0, 0.1)
    p, q = roll_out(
        now.p_world, now.q_world, estimator._prior, 0.1, 80, 1, PRIORS[gap.prior], gap.turn_memory_s, gap.handover_s,
        False, weights, basis.centres, basis.precision, basis.heading_scale_m, *BOUNDS,
        estimator._road_offset(), estimator._roads,
    )  # fmt: skip
    assert_rounded_alike(path.p_world, p, scale=10.0, steps=80)
    assert_rounded_alike(path.q_world, q, scale=1.0, steps=80)


def test_a_region_keeps_its_memory_while_the_target_is_elsewhere(
    build: Callable, measurement_of: Callable
) -> None:
    estimator = _straight(build, measurement_of, 3.0)
    estimator.correct(measurement_of(3.0, np.array([0.0, 2.5, 0.0]), Q0), 1)
    weights = estimator.model(0).weights.copy()
    windows = estimator.model(0).integral.count
    assert windows > 4
    for k in range(60):
        t = 3.0 + (k + 1) / 30
        estimator.correct(measurement_of(t, np.array([0.0, 2.5, 0.0]), Q0), 1)
    np.testing.assert_array_equal(estimator.model(0).weights, weights)
    assert estimator.model(0).integral.count == windows
    assert estimator.model(1).integral.count > 2
    # back again: the stack has gone on teaching meanwhile, so the weights are further along
    estimator.correct(measurement_of(5.1, np.array([2.5, -1.0, 0.0]), Q0), 0)
    moved = estimator.model(0).weights
    moment, psi = estimator.model(0).integral.moment, estimator.model(0).psi
    assert np.linalg.norm(moment - psi @ moved) < np.linalg.norm(moment - psi @ weights)


def test_a_short_sighting_and_a_single_pose_do_no_harm(build: Callable, measurement_of: Callable) -> None:
    estimator = _straight(build, measurement_of, 2.0)
    estimator.predict(4.0)
    estimator.correct(measurement_of(4.1, np.array([2.5, 0.6, 0.0]), Q0), 0)
    estimator.predict(6.0)
    estimator.correct(measurement_of(6.1, np.array([2.5, 1.4, 0.0]), Q0), 1)
    assert np.isfinite(estimator.estimate.p_world).all()
    np.testing.assert_allclose(estimator.estimate.p_world, [2.5, 1.4, 0.0], atol=1e-9)
    assert estimator.diagnostics()["gaps_learned"] == 0.0


def test_correct_alone_spans_a_gap_without_predict(build: Callable, measurement_of: Callable) -> None:
    """A caller that never calls ``predict`` gets the same gap learned."""
    estimators = [_straight(build, measurement_of, 2.0) for _ in range(2)]
    for k in range(60, 150):
        estimators[0].predict((k + 1) / 30)
    for e in estimators:
        for k in range(150, 190):
            t = (k + 1) / 30
            e.correct(measurement_of(t, np.array([2.5, -1.0 + 0.4 * t, 0.0]), Q0), 0)
        assert e.diagnostics()["gaps_learned"] == 1.0
    np.testing.assert_allclose(estimators[0].model(0).integral.gram, estimators[1].model(0).integral.gram)


def test_a_delayed_measurement_is_moved_to_the_present(build: Callable, measurement_of: Callable) -> None:
    estimator = _straight(build, measurement_of, 2.0)
    estimator.predict(2.1)
    estimator.correct(measurement_of(2.0 + 1 / 30, np.array([2.5, -1.0 + 0.4 * (2.0 + 1 / 30), 0.0]), Q0), 0)
    e = estimator.estimate
    assert e.t_s == pytest.approx(2.1)
    np.testing.assert_allclose(e.p_world, [2.5, -1.0 + 0.4 * 2.1, 0.0], atol=0.02)


def test_same_input_same_bits(replica_factory: Callable, replica_runner: Callable, build: Callable) -> None:
    replica = replica_factory(1, **LOOP)
    a, b = (replica_runner(replica, build(EstimatorSettings())) for _ in range(2))
    np.testing.assert_array_equal(a.position_m, b.position_m)


def test_misuse_is_named(build: Callable, measurement_of: Callable) -> None:
    estimator = build(EstimatorSettings())
    with pytest.raises(ConfigError, match=r"region 4.*0 \.\.\. 3"):
        estimator.correct(measurement_of(0.0, np.zeros(3), Q0), 4)
    with pytest.raises(ConfigError, match="dt_s 0"):
        estimator.rollout(1.0, 0.0)
    basis = estimator._basis
    with pytest.raises(ConfigError, match="tracking_bounds"):
        LearningEstimator(EstimatorSettings(), basis, 1, 30.0, BOUNDS[::-1])
    with pytest.raises(ConfigError, match="rate_hz"):
        LearningEstimator(EstimatorSettings(), basis, 1, 0.0, BOUNDS)


def test_a_frame_missed_now_and_then_is_no_loss(
    replica_factory: Callable, replica_runner: Callable, build: Callable, measurement_of: Callable
) -> None:
    """One measurement in ten is dropped; gaps go on being learned, and windows come as often as frames allow."""
    replica = replica_factory(2, **LOOP)
    dropped = np.random.default_rng(4).random(len(replica.t)) < 0.1
    patchy = replace(replica, region=np.where(dropped, -1, replica.region))
    whole, torn = (replica_runner(r, build(EstimatorSettings())).filter for r in (replica, patchy))
    windows = [sum(f.model(j).integral.count for j in range(4)) for f in (whole, torn)]
    assert windows[1] > 0.75 * windows[0]
    assert 5 <= torn.diagnostics()["gaps_learned"] <= whole.diagnostics()["gaps_learned"] + 1
    # more than two in a row are a loss
    t = float(replica.t[-1])
    torn.correct(measurement_of(t + 0.1, replica.p[-1], replica.q[-1]), 0)
    for k in range(1, 5):
        torn.predict(t + 0.1 + k / 30.0)
        assert torn.estimate.seen == (k < 4)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_five_laps_over_seeds(
    seed: int, replica_factory: Callable, replica_runner: Callable, build: Callable
) -> None:
    replica = replica_factory(5, wobble=0.02 + 0.01 * seed, **LOOP)
    learned = replica_runner(replica, build(EstimatorSettings()), seed)
    ekf = replica_runner(replica, ConstantVelocityEKF(EkfSettings(), 30.0), seed)
    assert learned.rmse(False, 0, 0) <= 1.1 * ekf.rmse(False, 0, 0)
    kind = "orientation_rad"
    assert learned.rmse(False, 2, 99, kind) <= 0.25 * ekf.rmse(False, 2, 99, kind)
    assert learned.rmse(False, 2) <= 0.1 * ekf.rmse(False, 2)
