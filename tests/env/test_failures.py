"""Agents that fail end as PettingZoo demands, and their cameras see nothing."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import api_test, parallel_api_test

from camnet.env import conformance, handoff_v0
from camnet.env.failures import Failures
from camnet.env.settings import FailureSettings
from camnet.errors import ConfigError


def make(**options: Any) -> handoff_v0.HandoffEnv:
    return handoff_v0.parallel_env(**{"max_cycles": 20, **options})


def idle(env: handoff_v0.HandoffEnv) -> dict[str, Any]:
    return {name: np.zeros(5, dtype=np.float32) for name in env.agents}


def test_a_failed_agent_ends_at_its_time_and_sees_nothing_any_more() -> None:
    env = make(failures={"schedule_s": {"camera_0": 1.0}})
    env.reset(seed=1)
    for step in range(1, 21):
        live = list(env.agents)
        observations, _, terminations, truncations, infos = env.step(idle(env))
        assert set(observations) == set(terminations) == set(live)
        assert terminations.get("camera_0", False) == (step == 10)
        if step == 9:
            assert env.simulation.visible[0, 0]  # the robot starts below camera_0
            place = env.simulation.snapshot.camera_p_world[0].copy()
        if step == 10:
            assert infos["camera_0"]["failed"]
            assert not truncations["camera_0"]
        if step > 10:
            assert live == ["camera_1", "camera_2", "camera_3"]
            assert not env.simulation.visible[0].any()
    assert env.agents == []
    assert set(infos) == {"camera_1", "camera_2", "camera_3"}
    assert all("handoff_episode" in info for info in infos.values())
    np.testing.assert_allclose(env.simulation.snapshot.camera_p_world[0], place, atol=0.1)  # it hovers
    env.reset(seed=1)
    assert len(env.agents) == 4
    assert env.simulation.working.all()
    env.close()


def test_the_episode_ends_with_the_last_agent() -> None:
    env = make(failures={"schedule_s": {f"camera_{j}": 0.5 for j in range(4)}})
    env.reset(seed=1)
    steps = 0
    while env.agents:
        *_, terminations, truncations, infos = env.step(idle(env))
        steps += 1
    assert steps == 5
    assert all(terminations.values())
    assert not any(truncations.values())
    assert all("handoff_episode" in info and info["failed"] for info in infos.values())
    env.close()


def test_lifetimes_are_exponential() -> None:
    failures = Failures(FailureSettings(rate_per_s=0.5), [str(k) for k in range(4000)], 0.1)
    failures.reset(np.random.default_rng(0))
    share = [failures.draw(0.1 * (k + 1)).mean() for k in range(40)]
    np.testing.assert_allclose(share, np.exp(-0.05 * np.arange(1, 41)), atol=0.03)


def test_pettingzoo_accepts_agents_that_fail() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        parallel_api_test(make(failures={"rate_per_s": 1.0}), 40)
        api_test(handoff_v0.env(max_cycles=20, failures={"rate_per_s": 1.0}), 80)
    conformance.check_repeatable(lambda: make(failures={"rate_per_s": 1.0}, message_loss=0.5))


def test_whoever_is_no_agent_cannot_fail() -> None:
    with pytest.raises(ConfigError, match="'camera_9' is no agent; the agents are camera_0"):
        make(failures={"schedule_s": {"camera_9": 1.0}})
    with pytest.raises(ConfigError, match="rate_per_s"):
        make(failures={"rate_per_s": -1.0})
