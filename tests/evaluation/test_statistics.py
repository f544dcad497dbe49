"""Intervals cover as often as they claim; a comparison on common seeds sees what separate means hide."""

from __future__ import annotations

import numpy as np

from camnet.evaluation.statistics import compare, interval


def test_intervals_cover_the_mean_about_as_often_as_they_claim(monkeypatch) -> None:
    monkeypatch.setattr("camnet.evaluation.statistics._RESAMPLES", 500)
    rng, hits = np.random.default_rng(0), 0
    for _ in range(200):
        low, high = interval(rng.exponential(size=60), rng)["ci95"]
        hits += low <= 1.0 <= high
    assert 0.88 <= hits / 200 <= 0.98


def test_figures_that_do_not_exist_are_left_out() -> None:
    rng = np.random.default_rng(0)
    assert interval(np.array([np.nan, np.nan]), rng) is None
    assert interval(np.array([2.0, np.nan, 2.0]), rng) == {"mean": 2.0, "ci95": [2.0, 2.0], "n": 2}


def test_a_small_steady_gain_is_found_under_large_common_luck() -> None:
    rng = np.random.default_rng(1)
    luck = rng.normal(scale=10.0, size=60)
    theirs, ours = luck, luck + 0.5 + rng.normal(scale=0.5, size=60)
    found = compare(ours, theirs, rng)
    assert found["p"] < 0.01
    assert found["ci95"][0] > 0.2
    assert compare(luck, luck, rng)["p"] == 1.0


def test_no_difference_is_seldom_called_one(monkeypatch) -> None:
    monkeypatch.setattr("camnet.evaluation.statistics._RESAMPLES", 500)
    rng = np.random.default_rng(2)
    alarms = sum(compare(rng.normal(size=25), rng.normal(size=25), rng)["p"] < 0.05 for _ in range(200))
    assert alarms <= 20
