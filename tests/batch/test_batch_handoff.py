"""The batch back end as a whole: it is the PyBullet environment, number for number, and its interfaces hold."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.agents import make_policies
from camnet.batch.frozen_model import FrozenModel, tabulate, warm_up
from camnet.config.load import load_scenario
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.batch_vector import BatchVectorEnv, sb3_vec_env
from camnet.env.handoff_v0 import HandoffEnv
from camnet.errors import ConfigError
from camnet.simulation.network import build_network

SEEDS = (7, 21)


@pytest.fixture(scope="module")
def held() -> FrozenModel:
    return warm_up(build_network(load_scenario("quickstart")), duration_s=160.0)


def _side_by_side(name, steps, world="quickstart", overrides=()):
    """Play the built-in rule on PyBullet and repeat its actions here; largest differences."""
    batch = BatchHandoff(
        world, 2, overrides=overrides, filter_name=name, threads=1, max_cycles=steps, auto_reset=False
    )
    shown = batch.reset(SEEDS)
    env = HandoffEnv(world, overrides=overrides, filter_name=name, max_cycles=steps)
    fields: dict[str, float] = dict.fromkeys(batch.layout.slices, 0.0)
    reward_error = 0.0
    observations, infos = env.reset(seed=SEEDS[0])[0], {}
    policies = make_policies("learned", env)
    for k in range(steps + 1):
        flat = np.array([observations[agent] for agent in env.possible_agents])
        for field, where in batch.layout.slices.items():
            fields[field] = max(fields[field], float(np.abs(flat[:, where] - shown[0][:, where]).max()))
        if k == steps:
            break
        actions = {agent: policies[agent](observations[agent]) for agent in env.possible_agents}
        observations, rewards, _, _, infos = env.step(actions)
        step = batch.step(np.stack([list(actions.values())] * 2))
        shown = step.last
        reward_error = max(reward_error, abs(rewards["camera_0"] - step.rewards[0]))
    visible = np.array_equal(env.simulation.visible, batch.simulation.gather("visible")[0])
    env.close()
    batch.close()
    return fields, reward_error, visible, infos["camera_0"]["handoff_episode"], step.finished[0]


def _check_agreement(result, tolerance=1e-4):
    fields, reward_error, visible, episode, mine = result
    assert {field: error for field, error in fields.items() if error > tolerance} == {}
    assert reward_error < 1e-6
    assert visible
    for key in ("time_in_view", "handoffs", "collisions", "region_exits", "laps"):
        assert mine[key] == episode[key], key
    for key in ("position_rmse_m", "orientation_rmse_deg", "reacquisition_delay_s"):
        known = {name: value for name, value in episode[key].items() if value is not None}
        assert {name for name, value in mine[key].items() if value is not None} == set(known), key
        assert {name: mine[key][name] for name in known} == pytest.approx(known, rel=1e-5, abs=1e-7), key
    assert mine["control_effort_m2ps"] == pytest.approx(episode["control_effort_m2ps"], rel=1e-6)
    assert mine["least_agent_distance_m"] == pytest.approx(episode["least_agent_distance_m"], abs=1e-6)


def test_one_seed_is_one_episode_on_both_back_ends():
    _check_agreement(_side_by_side("ekf", 150))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["learned", "oracle", "ekf"])
def test_a_minute_agrees(name):
    _check_agreement(_side_by_side(name, 600))


@pytest.mark.slow
def test_several_targets_wind_and_dropouts_agree():
    overrides = (
        "sensing.dropout_probability=0.2",
        "physics.wind.gust_std_mps=0.3",
        "physics.wind.mean_mps=[0.5,0,0]",
    )
    _check_agreement(_side_by_side("ekf", 300, "pursuit", overrides))


def test_numbers_do_not_depend_on_threads_or_neighbours():
    def play(environments, threads, seeds):
        env = BatchHandoff("quickstart", environments, filter_name="ekf", threads=threads, max_cycles=12)
        rng, shown = np.random.default_rng(0), [env.reset(seeds)]
        actions = rng.uniform(-1, 1, (20, 1, env.n_agents, 5))
        rewards = []
        for action in actions:
            step = env.step(np.broadcast_to(action, (environments, *action.shape[1:])))
            shown.append(step.observations)
            rewards.append(step.rewards)
        env.close()
        return np.array(shown), np.array(rewards)

    many, many_rewards = play(5, 2, [1, 2, 3, 4, 9])
    one, one_rewards = play(1, 1, [9])
    # up to the end of the first episode: the next seed is the next of the sequence
    np.testing.assert_array_equal(many[:12, 4], one[:12, 0])
    np.testing.assert_array_equal(many_rewards[:12, 4], one_rewards[:12, 0])
    again, _ = play(5, 1, [1, 2, 3, 4, 9])
    np.testing.assert_array_equal(many, again)


def test_what_the_back_end_has_not_is_refused():
    with pytest.raises(ConfigError, match="action_mode = 'velocity'"):
        BatchHandoff("quickstart", 1, action_mode="velocity")
    with pytest.raises(ConfigError, match="latency_s"):
        BatchHandoff("quickstart", 1, filter_name="ekf", overrides=["sensing.latency_s=0.1"])
    with pytest.raises(ConfigError, match="kinematic"):
        BatchHandoff("quickstart", 1, filter_name="ekf", overrides=["physics.actuation=kinematic"])
    with pytest.raises(ConfigError, match="filter_name = 'printed'"):
        BatchHandoff("quickstart", 1, filter_name="printed")
    with pytest.raises(ConfigError, match="unknown option 'max_cycle'"):
        BatchHandoff("quickstart", 1, max_cycle=3)


def test_misuse_is_told():
    env = BatchHandoff("quickstart", 2, filter_name="ekf", threads=1)
    with pytest.raises(ConfigError, match="call reset"):
        env.step(np.zeros((2, 4, 5)))
    env.reset(seed=1)
    with pytest.raises(ConfigError, match="shape"):
        env.step(np.zeros((2, 5)))
    with pytest.raises(ConfigError, match="finite"):
        env.step(np.full((2, 4, 5), np.nan))
    with pytest.raises(ConfigError, match="3 given for 2"):
        env.reset([1, 2, 3])


def test_the_table_is_the_learned_motion(held):
    network = build_network(load_scenario("quickstart"))
    table, grid = tabulate(held, network.bounds)
    x = np.array([2.7, 2.6, 0.0])  # on the road, in the gap between two regions
    sigma = held.basis(x, np.array([1.0, 0.0, 0.0, 0.0]))
    wanted = sigma @ held.weights[0][:, [0, 1, 2, 3, 4, 5, 7]]
    place = (x[:2] - grid[:2]) * grid[2]
    j, i = np.floor(place).astype(int)
    a, b = place - np.floor(place)
    cell = table[0, i : i + 2, j : j + 2]
    read = (1 - b) * ((1 - a) * cell[0, 0] + a * cell[0, 1]) + b * ((1 - a) * cell[1, 0] + a * cell[1, 1])
    np.testing.assert_allclose(read[:7], wanted, atol=2e-3)  # the last number fills the cache line
    # what was learned is the robot's motion: its speed, and it answers for it
    assert 0.25 < np.hypot(*wanted[:2]) < 0.45
    assert wanted[6] > 0.9


def test_gymnasium_vector_form():
    batch = BatchHandoff("quickstart", 3, filter_name="ekf", threads=1, max_cycles=4)
    env = BatchVectorEnv(batch, "SameStep")
    observations, infos = env.reset(seed=5)
    assert env.observation_space.contains(observations)
    assert infos == {}
    for k in range(4):
        observations, rewards, terminated, truncated, infos = env.step(env.action_space.sample())
        assert env.observation_space.contains(observations)
        assert rewards.shape == terminated.shape == truncated.shape == (3,)
        assert ("final_obs" in infos) == (k == 3)
    assert truncated.all()
    assert env.single_observation_space.contains(infos["final_obs"][0])
    assert infos["final_info"]["handoff_episode"]["length"].tolist() == [4, 4, 4]
    env.close()


@pytest.mark.parametrize("cycles", [1, 3])
def test_in_the_next_step_an_episode_begins_as_its_seed_has_it(cycles):
    def make():
        return BatchHandoff("quickstart", 2, filter_name="ekf", threads=1, max_cycles=cycles)

    env, other, still = BatchVectorEnv(make()), make(), np.zeros((2, 4, 5))
    env.reset(seed=5)
    for _ in range(cycles):
        shown, _, _, truncated, infos = env.step(still)
    assert truncated.all()
    assert infos["handoff_episode"]["length"].tolist() == [cycles] * 2
    other.reset(seed=5)
    for _ in range(cycles):
        step = other.step(still)
    np.testing.assert_array_equal(shown, step.last)
    shown, rewards, terminated, truncated, infos = env.step(still)
    assert not np.any([rewards, terminated, truncated])
    assert not infos
    np.testing.assert_array_equal(shown, other.reset([7, 8]))
    np.testing.assert_array_equal(env.step(still)[0], other.step(still).last)
    env.close()
    other.close()


def test_stable_baselines_rows():
    pytest.importorskip("stable_baselines3")
    rows = sb3_vec_env(BatchHandoff("quickstart", 2, filter_name="ekf", threads=1, max_cycles=3))
    rows.seed(11)
    assert rows.reset().shape == (8, rows.observation_space.shape[0])
    for k in range(3):
        observations, rewards, dones, infos = rows.step(np.zeros((8, 5), dtype=np.float32))
        assert observations.shape[0] == len(rewards) == len(dones) == len(infos) == 8
        assert dones.all() == (k == 2)
    assert infos[4]["episode"]["l"] == 3
    assert infos[5]["TimeLimit.truncated"]
    assert rows.observation_space.contains(infos[7]["terminal_observation"])
    rows.close()
