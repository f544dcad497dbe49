"""Every registered environment conforms, and so do random ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pettingzoo
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camnet.env import PRESETS, conformance, handoff_v0, strategies
from camnet.env.single import built_in


def maker(name: str, **options: Any) -> Callable[[], Any]:
    return lambda: pettingzoo.make("parallel", name, **options)


@pytest.mark.parametrize("name", PRESETS)
def test_every_registered_environment_conforms(name: str) -> None:
    conformance.check_containment(maker(name, max_cycles=4), episodes=1)
    conformance.check_repeatable(maker(name, max_cycles=2))


@pytest.mark.parametrize("name", ["camnet/Handoff-Pursuit-v0", "camnet/Handoff-Failures-v0"])
def test_pettingzoo_accepts_registered_environments(name: str) -> None:
    conformance.check_pettingzoo(maker(name, max_cycles=3), cycles=3)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("mode", ["setpoint", "velocity", "assign"])
def test_every_registered_environment_conforms_over_whole_episodes(name: str, mode: str) -> None:
    conformance.check_all(maker(name, max_cycles=40, action_mode=mode), episodes=1)


def check_random(options: dict[str, Any], seed: int) -> None:
    def make() -> handoff_v0.HandoffEnv:
        return handoff_v0.parallel_env(**options)

    conformance.check_containment(make, episodes=1, seed=seed)


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(strategies.environments(max_cycles=4), st.integers(0, 2**31))
def test_random_environments_conform(options: dict[str, Any], seed: int) -> None:
    check_random(options, seed)


@pytest.mark.slow
@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(strategies.environments(), st.integers(0, 2**31))
def test_a_thousand_random_environments_conform(options: dict[str, Any], seed: int) -> None:
    check_random(options, seed)


@settings(max_examples=2, deadline=None, suppress_health_check=list(HealthCheck))
@given(strategies.environments(max_cycles=4))
def test_random_environments_repeat(options: dict[str, Any]) -> None:
    first, second = (handoff_v0.parallel_env(**options) for _ in range(2))
    digests = {conformance.episode_digest(env, 5) for env in (first, second, second)}
    assert len(digests) == 1
    first.close()
    second.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "completed", "in_view"),
    [
        ("camnet/Handoff-Quickstart-v0", 0.95, 0.5),
        ("camnet/Handoff-Loop-8-v0", 0.95, 0.5),
        ("camnet/Handoff-Grid-16-v0", 0.9, 0.45),
        ("camnet/Handoff-Pursuit-v0", 0.85, 0.4),
        ("camnet/Handoff-Failures-v0", 0.7, 0.4),
    ],
)
def test_the_built_in_system_solves_every_registered_environment(
    name: str, completed: float, in_view: float
) -> None:
    env = maker(name, max_cycles=1200)()
    observations, _ = env.reset(seed=1)
    act = built_in(env)
    while env.agents:
        observations, *_, infos = env.step(act({name: observations[name] for name in env.agents}))
    episode = next(info["handoff_episode"] for info in infos.values() if "handoff_episode" in info)
    env.close()
    handoffs = episode["handoffs"]
    assert handoffs["attempted"] >= 3
    assert handoffs["completed"] >= completed * handoffs["attempted"]
    assert episode["time_in_view"] >= in_view
    assert episode["collisions"] == 0
    assert np.isfinite(episode["control_effort_m2ps"])
