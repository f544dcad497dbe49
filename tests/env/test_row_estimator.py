"""The environment's estimator in rows of arrays: the same run as with the class, certificates included."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rounding import assert_records_alike

from camnet.agents import make_team
from camnet.env import handoff_v0
from camnet.errors import ConfigError
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.types import Array

_DECISIONS = 900


def _play(monkeypatch: pytest.MonkeyPatch, rows: bool) -> tuple[handoff_v0.HandoffEnv, Array, list[Any]]:
    """Play a lap and a half of ``quickstart``; the environment, all observations and all certificates."""
    if not rows:
        monkeypatch.setattr(handoff_v0, "rows_can", lambda network: False)
    env = handoff_v0.parallel_env(world="quickstart", max_cycles=_DECISIONS)
    observations: Any = env.reset(seed=3)[0]
    team = make_team("learned", env)
    seen, told = [], []
    for _ in range(_DECISIONS):
        observations, _, _, _, infos = env.step(team(observations))
        seen.append(np.stack([observations[name] for name in env.possible_agents]))
        told.append(infos[env.possible_agents[0]]["certificate"])
    return env, np.stack(seen), told


def test_rows_run_as_the_class_does(monkeypatch: pytest.MonkeyPatch) -> None:
    env, seen, told = _play(monkeypatch, rows=True)
    other, expected, expected_told = _play(monkeypatch, rows=False)
    rows, oracle = env.simulation.driving[0], other.simulation.driving[0]
    assert env.simulation.perceived is not None
    assert isinstance(oracle, LearningEstimator)
    np.testing.assert_allclose(seen, expected, atol=1e-6)
    assert_records_alike(told, expected_told, scale=1.0, steps=_DECISIONS)
    # gaps: the same cameras at the same instants, the same misses; excitation in the same windows
    for gap, like in zip(env.simulation.gaps[0].gaps, other.simulation.gaps[0].gaps, strict=True):
        assert (gap.from_camera, gap.to_camera, gap.lost_s, gap.seen_s) == (
            like.from_camera, like.to_camera, like.lost_s, like.seen_s,
        )  # fmt: skip
        assert gap.error_m == pytest.approx(like.error_m, abs=1e-9)
    ours, theirs = rows.diagnostics(), oracle.diagnostics()
    assert len(env.simulation.gaps[0].gaps) > 3
    assert np.isfinite(ours["excited_s_0"])
    assert ours == pytest.approx({name: theirs[name] for name in ours}, abs=1e-9)
    after, before = env.simulation.statistics, other.simulation.statistics
    ours_errors, theirs_errors = after.episode(env.simulation), before.episode(other.simulation)
    assert str(ours_errors["handoffs"]) == str(theirs_errors["handoffs"])
    assert ours_errors["position_rmse_m"]["seen"] == pytest.approx(
        theirs_errors["position_rmse_m"]["seen"], abs=1e-9
    )


def test_rows_advance_one_by_one_where_sight_lines_are_asked_for() -> None:
    env = handoff_v0.parallel_env(world="loop_8", max_cycles=30)
    observations: Any = env.reset(seed=1)[0]
    team = make_team("learned", env)
    for _ in range(30):
        observations, *_ = env.step(team(observations))
    rows = env.simulation.driving
    assert env.simulation.perceived is None
    assert not isinstance(rows[0], LearningEstimator)
    now = env.simulation.snapshot
    assert np.linalg.norm(rows[0].estimate.p_world - now.target_p_world[0]) < 0.2
    with pytest.raises(ConfigError, match="both must be positive"):
        rows[0].rollout(0.0, 1.0)
