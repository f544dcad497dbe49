"""The target's pace as a state: what it makes of windows, and what it does to predictions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from camnet.estimation import LearningEstimator, place_basis
from camnet.estimation.pace import Pace, scaled
from camnet.estimation.settings import EstimatorSettings, GapSettings
from camnet.geometry.settings import Road

BOUNDS = np.array([[-8.0, -8.0, -1.0], [8.0, 8.0, 3.0]])
LOOP = {"radius": 2.5, "gap_m": 2.2}
ROW = np.array([0.4])
WEIGHTS = np.array([[0.5, 0.1, 0, 0, 0, 0.2, 0, 1.0]])


def _sighting(pace: Pace, first: float, last: float, noise: float, rng: np.random.Generator) -> None:
    for factor in np.linspace(first, last, 20):
        window = 0.4 * np.append(factor * WEIGHTS[0, :7], 1.0)
        window[:3] += noise * rng.standard_normal(3)
        pace.observe(ROW, window, WEIGHTS)


def test_a_deviation_that_lasts_is_carried_over_and_noise_is_not() -> None:
    rng = np.random.default_rng(0)
    lasting, noisy = Pace(), Pace()
    for factor in rng.uniform(0.7, 1.4, 15):
        _sighting(lasting, factor, factor, 0.005, rng)
        lasting.leave()
        _sighting(lasting, factor, factor, 0.005, rng)
        lasting.leave()
    for _ in range(30):
        _sighting(noisy, 1.0, 1.0, 0.005, rng)
        noisy.leave()
    assert lasting.persistence > 0.4
    assert noisy.persistence < 0.1
    _sighting(lasting, 1.3, 1.3, 0.005, rng)
    assert lasting.scale(True) == pytest.approx(1.0 + 0.3 * lasting.persistence**0.5, abs=0.02)
    lasting.leave()
    assert lasting.scale(False) == pytest.approx(1.0 + 0.3 * lasting.persistence**0.5, abs=0.02)
    _sighting(noisy, 1.0, 1.0, 0.005, rng)
    assert noisy.scale(True) == pytest.approx(1.0, abs=0.005)


def test_another_way_is_not_another_pace() -> None:
    pace = Pace()
    for _ in range(20):
        pace.observe(ROW, 0.4 * np.array([-0.1, 0.5, 0, 0, 0, 0, 0, 1.0]), WEIGHTS)
    assert pace.scale(True) == 1.0


def test_scaled_weights_move_alike_on_the_same_path() -> None:
    out = scaled(WEIGHTS, 1.5)
    np.testing.assert_allclose(out[0], [0.75, 0.15, 0, 0, 0, 0.3, 0, 1.0])
    np.testing.assert_array_equal(WEIGHTS[0, 0], 0.5)


@pytest.mark.slow
def test_pace_helps_a_target_of_wandering_speed_and_leaves_a_steady_one_alone(
    replica_factory: Callable, replica_runner: Callable
) -> None:
    lap = replica_factory(1, **LOOP)
    road = Road(name="loop", closed=True, points_m=tuple(map(tuple, lap.p[::30, :2].tolist())))
    basis = place_basis(EstimatorSettings().basis, [road], np.full(2, -6.0), np.full(2, 6.0))
    errors = {}
    for wander in (0.0, 0.25):
        for pace in (False, True):
            values = []
            for seed in range(3):
                replica = replica_factory(8, wander=wander, seed=seed, **LOOP)
                settings = EstimatorSettings(gap=GapSettings(pace=pace))
                result = replica_runner(replica, LearningEstimator(settings, basis, 4, 30.0, BOUNDS), seed)
                values.append(result.rmse(False, 2))
            errors[wander, pace] = float(np.mean(values))
    assert errors[0.25, True] < 0.9 * errors[0.25, False]
    assert errors[0.0, True] < 1.05 * errors[0.0, False]
