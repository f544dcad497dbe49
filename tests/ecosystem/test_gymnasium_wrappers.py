"""Gymnasium's own wrappers on the single form and on the vector form."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, RecordEpisodeStatistics
from gymnasium.wrappers.vector import NormalizeObservation as NormalizeObservations
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordStatistics

import camnet.env  # noqa: F401 - registers the environments
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.batch_vector import BatchVectorEnv

_CYCLES = 12


@pytest.mark.parametrize("info_form", ["nested", "flat"])
def test_single_form(info_form: str) -> None:
    plain: Any = gymnasium.make("camnet/Handoff-Single-v0", max_cycles=_CYCLES, info_form=info_form)
    env = NormalizeObservation(RecordEpisodeStatistics(plain))
    observation, _ = env.reset(seed=1)
    earned, over, info = 0.0, False, dict[str, Any]()
    rng = np.random.default_rng(1)
    while not over:
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 5).astype(np.float32))
        earned, over = earned + float(reward), terminated or truncated
    assert info["episode"]["l"] == _CYCLES
    assert info["episode"]["r"] == pytest.approx(earned, rel=1e-5)
    share = info["handoff_episode"]["time_in_view"] if info_form == "nested" else None
    assert (info["handoff_episode.time_in_view"] if share is None else share) >= 0.0
    assert np.isfinite(observation).all()
    assert observation.shape == env.observation_space.shape
    env.close()


@pytest.mark.parametrize("info_form", ["nested", "flat"])
def test_vector_form(info_form: str) -> None:
    batch = BatchHandoff(
        "quickstart", 3, filter_name="ekf", max_cycles=_CYCLES, threads=1, info_form=info_form
    )
    env = NormalizeObservations(RecordStatistics(BatchVectorEnv(batch)))
    env.reset(seed=1)
    earned, infos = np.zeros(3), dict[str, Any]()
    rng = np.random.default_rng(1)
    for _ in range(_CYCLES):
        actions = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        observations, rewards, _, _, infos = env.step(actions)
        earned += rewards
    assert infos["episode"]["l"].tolist() == [_CYCLES] * 3
    np.testing.assert_allclose(infos["episode"]["r"], earned, rtol=1e-5)
    name = "handoff_episode.time_in_view"
    share = infos["handoff_episode"]["time_in_view"] if info_form == "nested" else infos[name]
    assert np.isfinite(np.asarray(share, dtype=float)).all()
    assert np.isfinite(observations).all()
    env.close()
