"""The built-in agents act within their spaces, and prediction is worth something."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from camnet.agents import AGENTS, make_policies
from camnet.env import handoff_v0
from camnet.errors import ConfigError
from camnet.simulation.run import decide, setpoints_for


def play(agent: str, cycles: int, seed: int = 1) -> tuple[float, dict[str, object]]:
    filter_name = "ekf" if agent == "ekf" else "learned"
    env = handoff_v0.parallel_env(max_cycles=cycles, filter_name=filter_name)
    observations, _ = env.reset(seed=seed)
    policies = make_policies(agent, env, seed)
    total, infos = 0.0, {}
    while env.agents:
        actions = {name: policies[name](observations[name]) for name in env.agents}
        for name, action in actions.items():
            assert env.action_space(name).contains(action)
        observations, rewards, _, _, infos = env.step(actions)
        total += rewards["camera_0"]
    env.close()
    return total, infos["camera_0"]["episode"]


@pytest.mark.parametrize("agent", AGENTS)
def test_every_agent_acts_within_its_space(agent: str) -> None:
    _, episode = play(agent, 5)
    assert episode["collisions"] == 0


def test_the_learned_agent_beats_random_by_far() -> None:
    learned, episode = play("learned", 330)
    random, _ = play("random", 330)
    assert episode["handoffs"] == {"attempted": 2, "completed": 2}
    assert learned > 1.5 * abs(random)


def test_the_policy_asks_for_what_the_built_in_system_asks_for() -> None:
    env = handoff_v0.parallel_env(max_cycles=120)
    observations, _ = env.reset(seed=4)
    policies = make_policies("learned", env)
    for _ in range(100):
        actions = {name: policies[name](observations[name]) for name in env.agents}
        wanted = setpoints_for(env.simulation, decide(env.simulation))
        asked = env.setpoints(actions)
        np.testing.assert_allclose(asked.p_world, wanted.p_world, atol=0.02)
        np.testing.assert_allclose(asked.gaze_rad, wanted.gaze_rad, atol=0.02)
        observations, *_ = env.step(actions)
    env.close()


def test_unknown_agents_are_named() -> None:
    env = handoff_v0.parallel_env()
    with pytest.raises(ConfigError, match="'clever': unknown; known are learned"):
        make_policies("clever", env)


def test_the_top_level_name_is_left_to_others(project_root: Path) -> None:
    spec = importlib.util.spec_from_file_location("agents", project_root / "agents" / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    with pytest.raises(ImportError, match=r"camnet\.agents"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
