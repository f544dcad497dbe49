"""Estimators of several targets with one memory: one law for the weights, everybody's data in the stack."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation import EstimatorSettings, LearningEstimator, place_basis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.learning_estimator import shared_memories
from camnet.estimation.settings import BasisSettings

RATE = 30.0
BOUNDS = np.array([[-8.0, -8.0, -1.0], [8.0, 8.0, 3.0]])
SETTINGS = EstimatorSettings(basis=BasisSettings(placement="grid", spacing_m=1.0, width_m=0.8))
BASIS = place_basis(SETTINGS.basis, [], np.full(2, -3.5), np.full(2, 3.5))


def pair(settings: EstimatorSettings = SETTINGS) -> list[LearningEstimator]:
    memories = shared_memories(settings, BASIS, 4, RATE)
    return [LearningEstimator(settings, BASIS, 4, RATE, BOUNDS, "learned_shared", memories) for _ in range(2)]


def run_pair(
    replica_factory: Callable,
    measurement_of: Callable,
    filters: list[LearningEstimator],
    late: int,
    laps: int = 2,
) -> np.ndarray:
    """Run two targets on one way, the second ``late`` frames behind; returns the second's unseen errors, m."""
    replica, rng = replica_factory(laps, radius=2.5, gap_m=2.2), np.random.default_rng(1)
    errors = []
    for k in range(len(replica.t)):
        for m, filter_ in enumerate(filters):
            j = k - m * late
            if j < 0:
                continue
            t, region = float(replica.t[k]), int(replica.region[j])
            if region >= 0:
                p = replica.p[j] + 0.01 * rng.standard_normal(3)
                filter_.correct(measurement_of(t, p, replica.q[j]), region)
            else:
                filter_.predict(t)
                if m == 1:
                    errors.append(float(np.linalg.norm(filter_.estimate.p_world - replica.p[j])))
    return np.array(errors)


def test_the_second_target_knows_what_the_first_has_shown(
    replica_factory: Callable, measurement_of: Callable
) -> None:
    """Half a lap behind, the follower crosses its first gaps on the leader's experience."""
    late = 900
    shared = run_pair(replica_factory, measurement_of, pair(), late)
    private = [LearningEstimator(SETTINGS, BASIS, 4, RATE, BOUNDS) for _ in range(2)]
    alone = run_pair(replica_factory, measurement_of, private, late)
    first = len(shared) // 3
    assert np.sqrt(np.mean(shared[:first] ** 2)) < 0.4 * np.sqrt(np.mean(alone[:first] ** 2))


def test_both_targets_feed_one_stack_in_a_fixed_order(
    replica_factory: Callable, measurement_of: Callable
) -> None:
    once, again = pair(), pair()
    for filters in (once, again):
        run_pair(replica_factory, measurement_of, filters, 200, 1)
    for j in range(4):
        a, b = once[0].model(j), again[1].model(j)
        assert a is not b
        assert once[0].model(j) is once[1].model(j)
        np.testing.assert_array_equal(a.integral.rows, b.integral.rows)
        np.testing.assert_array_equal(a.weights, b.weights)


def test_feedback_of_two_targets_is_one_step_with_the_sum() -> None:
    """The law with the sum of both feedbacks, solved densely, against one step and an added feedback."""
    rng = np.random.default_rng(3)
    model = MotionModel(SETTINGS, 12, 1.0 / RATE)
    for k in range(40):
        row = np.where(rng.random(12) < 0.4, rng.random(12), 0.0)
        row[9:] = 0.0  # kernels that no window reaches
        model.learn_window(0.1 * k, row, rng.standard_normal(8))
    model.weights = rng.standard_normal((12, 8))
    sigma, error = rng.random((2, 12)), 0.1 * rng.standard_normal((2, 8))
    s, dt = SETTINGS, 1.0 / RATE
    left = np.eye(12) + dt * s.kcl * s.gamma * (model.integral.gram + s.leakage * np.eye(12))
    right = model.weights + dt * s.gamma * (sigma.T @ error + s.kcl * model.integral.moment)
    model.step(sigma[0], error[0])
    model.add_feedback(sigma[1], error[1])
    np.testing.assert_allclose(model.weights, np.linalg.solve(left, right), rtol=1e-9, atol=1e-12)


def test_weights_advance_once_however_many_targets_hold_them(
    replica_factory: Callable, measurement_of: Callable
) -> None:
    """A target that stays unseen takes no step of its own when another one has taken it."""
    replica = replica_factory(1, radius=2.5, gap_m=2.2)
    first, second = pair()
    steps: list[float] = []
    memory = first._memories[int(replica.region[0])]
    step = memory.model.step
    memory.model.step = lambda *a: (steps.append(0.0), step(*a))[1]  # type: ignore[method-assign, func-returns-value]
    for k in range(60):
        z = measurement_of(float(replica.t[k]), replica.p[k], replica.q[k])
        first.correct(z, int(replica.region[k]))
        if k < 2:
            second.correct(z, int(replica.region[k]))
        else:
            second.predict(float(replica.t[k]))
    assert len(steps) == 59


def test_memories_of_another_size_are_refused() -> None:
    memories = shared_memories(SETTINGS, BASIS, 3, RATE)
    with pytest.raises(ConfigError, match="memories: 3 over"):
        LearningEstimator(SETTINGS, BASIS, 4, RATE, BOUNDS, memories=memories)
