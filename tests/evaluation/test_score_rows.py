"""Scores of many episodes at once are those of each alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.evaluation.score_rows import RecorderRows, set_distances
from camnet.evaluation.scores import EpisodeRecorder, Instant
from camnet.evaluation.set_metrics import gospa, ospa

EPISODE = {
    "handoffs": {"attempted": 4, "completed": 3},
    "time_in_view": 0.5,
    "reacquisition_delay_s": {"mean": 0.25},
    "control_effort_m2ps": 1.0,
    "least_agent_distance_m": None,
    "collisions": 0,
    "region_exits": 2,
    "duration_s": 20.0,
    "time_inside": 0.7,
    "entries": 4,
}


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 6), st.integers(0, 2**31))
def test_distances_of_sets_are_those_of_the_solver(targets: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, estimates = rng.normal(0, 2, (2, 5, targets, 3))
    known = rng.random((5, targets)) < 0.7
    away = np.linalg.norm(truth[:, :, None] - estimates[:, None], axis=3)
    mine = set_distances(away, known, 2.0)
    for e in range(5):
        there = estimates[e, known[e]]
        assert mine[0][e] == pytest.approx(ospa(truth[e], there, 2.0), abs=1e-9)
        assert mine[1][e] == pytest.approx(gospa(truth[e], there, 2.0), abs=1e-7)


@pytest.mark.parametrize("targets", [1, 2, 4])
def test_many_episodes_score_as_each_alone(targets: int) -> None:
    """Targets and estimates that wander among each other, so that matches break and identities switch."""
    rng, episodes = np.random.default_rng(targets), 5
    rows = RecorderRows(episodes, targets, 1.0)
    alone = [EpisodeRecorder(1.0) for _ in range(episodes)]
    truth, estimates = rng.normal(0, 1, (2, episodes, targets, 3))
    known = np.zeros((episodes, targets), dtype=bool)
    for k in range(200):
        truth += rng.normal(0, 0.15, truth.shape)
        estimates += 0.1 * (truth - estimates) + rng.normal(0, 0.3, truth.shape)
        known |= rng.random(known.shape) < 0.05
        seen, rewards = rng.random(known.shape) < 0.5, rng.normal(size=episodes)
        live = np.arange(episodes) if k < 150 else np.array([0, 3])
        shown = np.where(known[..., None], estimates, np.nan)
        rows.add(live, rewards[live], truth[live], shown[live], known[live], seen[live])
        for e in live:
            alone[e].add(float(rewards[e]), Instant(truth[e], shown[e], known[e], seen[e]))
    switches = 0.0
    for e in range(episodes):
        mine, theirs = rows.score(e, EPISODE), alone[e].score(EPISODE)
        assert list(mine) == list(theirs)
        for name, value in theirs.items():
            if math.isnan(value):
                assert math.isnan(mine[name]), name
            else:
                assert mine[name] == pytest.approx(value, rel=1e-9), name
        switches += mine["id_switches"]
    assert targets == 1 or switches > 10
