"""The built-in agents act within their spaces, and prediction is worth something."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from camnet.agents import AGENTS, contexts, estimator_of, make_policies, make_team
from camnet.agents.auction import Auction
from camnet.agents.features import FEATURES
from camnet.agents.policy_file import PolicyHeader, PolicyNet, save_policy
from camnet.env import handoff_v0
from camnet.env.layout import ObservationLayout
from camnet.errors import ConfigError, DataError
from camnet.simulation.run import decide, setpoints_for


def play(agent: str, cycles: int, seed: int = 1) -> tuple[float, dict[str, object]]:
    env = handoff_v0.parallel_env(max_cycles=cycles, filter_name=estimator_of(agent))
    observations, _ = env.reset(seed=seed)
    team = make_team(agent, env, seed)
    total, infos = 0.0, {}
    while env.agents:
        actions = team({name: observations[name] for name in env.agents})
        for name, action in actions.items():
            assert env.action_space(name).contains(action)
        observations, rewards, _, _, infos = env.step(actions)
        total += rewards["camera_0"]
    env.close()
    return total, infos["camera_0"]["handoff_episode"]


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
    with pytest.raises(ConfigError, match="'clever': unknown as a policy of one agent; known are learned"):
        make_policies("clever", env)


def test_the_top_level_name_is_left_to_others(project_root: Path) -> None:
    spec = importlib.util.spec_from_file_location("agents", project_root / "agents" / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    with pytest.raises(ImportError, match=r"camnet\.agents"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


def test_policy_files_act_on_observations_of_any_length(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    shapes = (len(FEATURES), 16, 5)
    layers = [rng.normal(scale=0.3, size=shape) for shape in pairwise(shapes)]
    header = PolicyHeader(features=FEATURES, filter_name="ekf")
    ones = np.ones(len(FEATURES))
    save_policy(
        tmp_path / "p.npz", PolicyNet(header, 0 * ones, ones, tuple(layers), (np.zeros(16), np.zeros(5)))
    )
    agent = str(tmp_path / "p.npz")
    assert estimator_of(agent) == "ekf"
    for neighbours in (0, 3):  # observations of different lengths
        env = handoff_v0.parallel_env(max_cycles=5, filter_name="ekf", neighbours=neighbours)
        observations, _ = env.reset(seed=1)
        team = make_team(agent, env)
        while env.agents:
            actions = team(observations)
            assert all(env.action_space(name).contains(action) for name, action in actions.items())
            observations, *_ = env.step(actions)
        env.close()


def test_policies_for_other_features_are_refused(tmp_path: Path) -> None:
    header = PolicyHeader(features=("a", "b"))
    net = PolicyNet(header, np.zeros(2), np.ones(2), (np.zeros((2, 5)),), (np.zeros(5),))
    save_policy(tmp_path / "p.npz", net)
    env = handoff_v0.parallel_env(max_cycles=5)
    with pytest.raises(DataError, match="2 features"):
        make_team(str(tmp_path / "p.npz"), env)
    env.close()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_an_auction_gives_every_target_to_one_agent(order: tuple[int, int]) -> None:
    """Two targets come to the region of each of two agents; each agent is given the one it meets sooner."""
    env = handoff_v0.parallel_env(max_cycles=5)
    env.reset(seed=1)
    known = contexts(env)
    env.close()
    layout = ObservationLayout(2, 2)
    names = list(known)[:2]
    teams = {name: replace(known[name], layout=layout, speeds=np.ones(2)) for name in names}
    observations = {}
    for agent, name in enumerate(names):
        values: dict[str, float | np.ndarray] = {}
        for m in range(2):
            near = order[agent] == m
            values |= {
                f"target_{m}.known": 1.0,
                f"target_{m}.coming": 1.0,
                f"target_{m}.entry_time": 0.2 if near else 0.3,
                f"target_{m}.entry_radius": 0.1,
                f"target_{m}.entry_position": np.array([0.8 if m else -0.8, 0.0, -0.9]),
            }
        observations[name] = layout.encode(values)
    actions = Auction(teams)(observations)
    for agent, name in enumerate(names):
        assert np.sign(actions[name][0]) == (1.0 if order[agent] else -1.0)


@pytest.mark.parametrize("agent", ["auction", "oracle", "learned"])
def test_teams_read_named_observations_too(agent: str) -> None:
    options = {"world": "pursuit", "max_cycles": 40, "filter_name": estimator_of(agent)}
    flat, named = (handoff_v0.parallel_env(**options, observation_form=form) for form in ("flat", "dict"))
    (rows, _), (parts, _) = flat.reset(seed=5), named.reset(seed=5)
    team, other = make_team(agent, flat), make_team(agent, named)
    for _ in range(40):
        actions = team(rows)
        for name, action in other(parts).items():
            np.testing.assert_array_equal(action, actions[name])
        rows, *_ = flat.step(actions)
        parts, *_ = named.step(actions)
