"""Branches on worlds whose branch weights are known, and hidden from what learns."""

import numpy as np
import pytest

from camnet.association.futures import LEAVES, FutureLessons, Futures
from camnet.association.settings import FutureSettings
from camnet.experiments.traffic_futures import hidden_labels, predict_traffic
from camnet.importers.traffic import BusyRegion
from camnet.motion.track import Track

_TURNS = np.array(
    [[0.7, 0.3], [0.55, 0.45], [0.15, 0.85]]
)  # of the first junction, and of the second after each turn


def _world(n, seed):
    """One exit, two unseen junctions of two ways each: four next views, each with a time of its own."""
    rng = np.random.default_rng(seed)
    first = (rng.random(n) > _TURNS[0, 0]).astype(int)
    second = (rng.random(n) > _TURNS[1 + first, 0]).astype(int)
    outcome = 2 * first + second
    away = np.array([20.0, 30.0, 45.0, 60.0])[outcome] * np.exp(0.1 * rng.normal(size=n))
    t_s = np.sort(rng.uniform(0, 1e4, n))
    p = 0.5 * rng.normal(size=(n, 2))
    v = np.tile([5.0, 0.0], (n, 1)) + 0.3 * rng.normal(size=(n, 2))
    return FutureLessons(np.zeros(n, int), p, v, t_s, outcome, away)


def _truth():
    first = np.repeat(_TURNS[0], 2)
    return first * _TURNS[1:].ravel()


def _loss(model, test):
    out = []
    for k in range(len(test.view)):
        branches = model.predict(0, test.p_world[k], test.v_world[k], test.t_s[k])
        p = next(b.weight for b in branches if b.outcome == test.outcome[k])
        out.append(-np.log(0.99 * p + 0.01 / 5))
    return float(np.mean(out))


@pytest.mark.parametrize("seed", range(5))
def test_after_200_gaps_the_loss_is_near_that_of_the_generating_probabilities(seed):
    model = Futures(_world(200, seed), 4, FutureSettings(calibrate=False))
    test = _world(2000, 100 + seed)
    best = float(np.mean(-np.log(_truth()[test.outcome])))
    loss = _loss(model, test)
    assert loss < best + 0.05
    assert loss < np.log(4.0)


def test_weights_sum_to_one_and_densities_integrate_to_one():
    model = Futures(_world(200, 0), 4)
    branches = model.predict(0, np.zeros(2), np.array([5.0, 0.0]), 1e4)
    assert sum(b.weight for b in branches) == pytest.approx(1.0)
    assert [b.weight for b in branches] == sorted((b.weight for b in branches), reverse=True)
    t = np.linspace(0.01, 300, 30_000)
    for b in branches:
        if len(b.times_s):
            assert np.trapezoid(b.density(t), t) == pytest.approx(1.0, abs=1e-3)


def test_intervals_hold_what_they_state_on_new_crossings():
    model, test = Futures(_world(300, 1), 4), _world(1000, 2)
    held = []
    for k in range(len(test.view)):
        found = model.predict(0, test.p_world[k], test.v_world[k], test.t_s[k])
        low, high = next(b for b in found if b.outcome == test.outcome[k]).interval(0.8)
        held.append(low <= test.away_s[k] <= high)
    assert 0.75 <= np.mean(held) <= 0.85


def test_branches_that_change_by_time_of_day_are_followed():
    n = 600
    a, rng = _world(n, 3), np.random.default_rng(0)
    late = a.t_s > 5000.0
    outcome = np.where(late, np.where(rng.random(n) < 0.9, 3, 0), np.where(rng.random(n) < 0.9, 0, 3))
    day = FutureLessons(a.view, a.p_world, a.v_world, a.t_s, outcome, a.away_s)
    forgets = Futures(day, 4, FutureSettings(recency_s=600.0, calibrate=False))
    keeps = Futures(day, 4, FutureSettings(calibrate=False))
    exit_ = 0, np.zeros(2), np.array([5.0, 0.0]), 1e4
    weight = [next(b.weight for b in m.predict(*exit_) if b.outcome == 3) for m in (forgets, keeps)]
    assert weight[0] == pytest.approx(0.9, abs=0.08)
    assert weight[1] == pytest.approx(0.5, abs=0.1)


def _traffic(n=300, seed=0):
    """Vehicles from (0, 0) to a left or a right view, or away for good, at 1 Hz."""
    rng = np.random.default_rng(seed)
    tracks = []
    for k in range(n):
        speed, kind, start = rng.normal(10, 0.5), rng.random(), float(np.round(12.0 * k))
        end = {0: [200.0, 0.0], 1: [100.0, 150.0], 2: [90.0, -60.0]}[
            0 if kind < 0.6 else 1 if kind < 0.9 else 2
        ]
        corners = np.array([[-40.0, 0.0], [60.0, 0.0], end])
        way = np.r_[0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T))]
        t = np.arange(0.0, way[-1] / speed, 1.0)
        p = np.stack([np.interp(t * speed, way, corners[:, d]) for d in (0, 1)] + [0 * t], axis=1)
        tracks.append(Track(str(k), start + t, p))
    return tracks


_PLACES = [
    BusyRegion((-20.0, -20.0), (20.0, 20.0), 1),
    BusyRegion((150.0, -25.0), (210.0, 25.0), 1),
    BusyRegion((70.0, 110.0), (130.0, 160.0), 1),
]


def test_traffic_is_predicted_with_the_outcome_of_leaving():
    found = predict_traffic(_traffic(), _PLACES, 1800.0, 3700.0)
    assert found["crossings"]["tested"] > 100
    rows = {row["next"]: row["weight"] for row in found["branches"] if row["view"] == 0}
    assert rows["view 1"] == pytest.approx(0.6, abs=0.12)
    assert rows["leaves"] == pytest.approx(0.1, abs=0.08)
    assert found["log_loss"]["learned"] < found["log_loss"]["equal"]
    assert found["time"]["median_error_s"] < 1.5


def test_hidden_labels_of_traffic_are_found_by_travel_time():
    found = hidden_labels(_traffic(120), _PLACES, 3.0)
    assert found["entries"] > 50
    assert found["rank1_at_once"] > 0.9


def test_leaving_has_no_time():
    model = Futures(_world(50, 0), 4)
    branch = next(b for b in model.predict(0, np.zeros(2), np.zeros(2), 0.0) if b.outcome == LEAVES)
    assert np.isnan(branch.quantile(0.5))
    assert branch.density(np.ones(2)).tolist() == [0.0, 0.0]
