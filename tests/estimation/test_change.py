"""A target that changes its ways half-way: detected, forgotten locally, learned again."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from camnet.estimation import LearningEstimator, place_basis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.learner import OutlierGate
from camnet.estimation.selection import DOptimalRule
from camnet.estimation.settings import EstimatorSettings, StackSettings
from camnet.estimation.stack import HistoryStack
from camnet.geometry import rotations
from camnet.geometry.settings import Road

BOUNDS = np.array([[-8.0, -8.0, -1.0], [8.0, 8.0, 3.0]])
LOOP = {"radius": 2.5, "gap_m": 2.2}


def _phases(factory: Callable, second: str) -> tuple[Any, int]:
    """Three laps, then six the other way round, or six at more than one and a half times the speed."""
    a = factory(3, **LOOP)
    if second == "reverse":
        b = factory(6, **LOOP)
        b.p, b.v, b.w, b.region = b.p[::-1], -b.v[::-1], b.w[::-1], b.region[::-1]
        b.q = rotations.multiply(b.q[::-1], rotations.from_yaw(math.pi))
    else:
        b = factory(6, speed=0.55, **LOOP)
    first = len(a.t)
    b.t, b.lap = a.t[-1] + 1 / 30 + b.t, a.lap[-1] + 1 + b.lap
    for name in ("t", "p", "q", "v", "w", "region", "lap"):
        setattr(a, name, np.concatenate((getattr(a, name), getattr(b, name))))
    return a, first


def _unseen(result: Any, pick: np.ndarray) -> float:
    return float(np.sqrt(np.mean(result.position_m[pick & (result.replica.region < 0)] ** 2)))


@pytest.mark.parametrize("second", ["reverse", "faster"])
def test_a_new_field_is_detected_and_relearned(
    second: str, replica_factory: Callable, replica_runner: Callable
) -> None:
    """Unseen error back within 1.5 times that of the first phase before two minutes of observation are over."""
    replica, first = _phases(replica_factory, second)
    road = Road(name="loop", closed=True, points_m=tuple(map(tuple, replica.p[:first:90, :2].tolist())))
    settings = EstimatorSettings()
    basis = place_basis(settings.basis, [road], np.full(2, -6.0), np.full(2, 6.0))
    estimator = LearningEstimator(settings, basis, 4, 30.0, BOUNDS)
    result = replica_runner(replica, estimator)
    number = np.arange(len(replica.t))
    observed_s = np.cumsum((replica.region >= 0) & (number >= first)) / 30.0
    known = _unseen(result, (number < first) & (replica.lap >= 1))
    again = _unseen(result, (observed_s > 60.0) & (observed_s < 120.0))
    surprised = _unseen(result, (number >= first) & (observed_s < 30.0))
    assert surprised > 3 * known
    assert again < 1.5 * known
    found = estimator.diagnostics()
    assert [found[f"changes_{j}"] for j in range(4)] == [1.0] * 4
    assert all(found[f"forgotten_{j}"] > 20 for j in range(4))


def test_a_target_that_stays_as_it_is_is_never_taken_for_changed(
    replica_factory: Callable, replica_runner: Callable
) -> None:
    replica = replica_factory(4, wobble=0.05, **LOOP)
    road = Road(name="loop", closed=True, points_m=tuple(map(tuple, replica.p[:1200:90, :2].tolist())))
    settings = EstimatorSettings()
    basis = place_basis(settings.basis, [road], np.full(2, -6.0), np.full(2, 6.0))
    for seed in range(2):
        estimator = LearningEstimator(settings, basis, 4, 30.0, BOUNDS)
        replica_runner(replica, estimator, seed)
        found = estimator.diagnostics()
        assert sum(found[f"changes_{j}"] for j in range(4)) == 0.0


def _window(v: float, rng: np.random.Generator) -> np.ndarray:
    out = 0.4 * np.array([v, 0, 0, 0, 0, 0, 0, 1.0])
    out[:6] += 0.01 * rng.standard_normal(6)
    return out


def test_a_small_lasting_change_is_found_though_no_window_is_far() -> None:
    rng = np.random.default_rng(0)
    gate, weights, row = OutlierGate(6.0), np.zeros((1, 8)), np.array([0.4])
    weights[0, 0], weights[0, 7] = 1.0, 1.0
    assert all(gate.passes(row, _window(1.0, rng), weights, 0.4 * k) for k in range(60))
    assert math.isinf(gate.changed_s)
    for k in range(60, 72):
        assert gate.passes(row, _window(1.2, rng), weights, 0.4 * k)
    assert gate.changed_s == 0.4 * 60
    assert gate.refused == 0
    for k in range(72, 78):
        gate.passes(row, _window(1.0, rng), weights, 0.4 * k)
    assert math.isinf(gate.changed_s)
    assert gate.changes == 1


def test_forgetting_keeps_the_books() -> None:
    """What is left after dropping entries is what a stack filled with only those would hold."""
    rng = np.random.default_rng(2)
    stacks = [HistoryStack(20, 5, 3, DOptimalRule(20, 5, 1e-2), 1e-3) for _ in range(2)]
    rows, increments = rng.standard_normal((20, 5)), rng.standard_normal((20, 3))
    drop = rng.uniform(size=20) < 0.4
    for k in range(20):
        stacks[0].offer(float(k), rows[k], increments[k])
        if not drop[k]:
            stacks[1].offer(float(k), rows[k], increments[k])
    stacks[0].forget(drop)
    for y in rng.standard_normal((40, 5)):
        for stack in stacks:
            stack.offer(0.0, y, np.zeros(3))
    np.testing.assert_allclose(stacks[0].rows, stacks[1].rows)
    np.testing.assert_allclose(stacks[0].gram, stacks[1].gram, atol=1e-12)
    np.testing.assert_allclose(stacks[0].moment, stacks[1].moment, atol=1e-12)


def test_only_old_windows_of_the_same_place_are_forgotten() -> None:
    model = MotionModel(EstimatorSettings(stack=StackSettings(size=30)), 6, 0.03)
    here, there = np.array([0.3, 0.2, 0, 0, 0, 0]), np.array([0, 0, 0, 0.1, 0.4, 0])
    for k in range(5):
        model.learn_window(float(k), here, 0.4 * np.ones(8))
        model.learn_window(float(k), there, 0.4 * np.ones(8))
    model.settle(200.0)
    before = model.weights.copy()
    assert model.forget(here, 3.0) == 3
    np.testing.assert_allclose(model.integral.gram, 2 * np.outer(here, here) + 5 * np.outer(there, there))
    np.testing.assert_allclose(model.weights[:2], 0.4 * before[:2])
    np.testing.assert_array_equal(model.weights[2:], before[2:])
    fresh = np.linalg.inv(np.eye(6) + 0.03 * (model.psi + 1e-3 * np.eye(6)))
    np.testing.assert_allclose(model._inverse, fresh[np.ix_(model._order, model._order)], atol=1e-12)
