"""Failing agents, late and lost messages, and assignments: the batch is the PyBullet environment, number for number."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from camnet.agents import make_team
from camnet.env.batch_handoff import BatchHandoff, BatchStep
from camnet.env.batch_vector import BatchVectorEnv, sb3_vec_env
from camnet.env.handoff_v0 import HandoffEnv
from camnet.errors import ConfigError

FAILURES = "camnet/Handoff-Failures-v0"


class Pair:
    """One episode on both back ends, side by side, under the same actions."""

    def __init__(self, world: str, seed: int, **options: Any) -> None:
        self.one = HandoffEnv(world, filter_name="ekf", **options)
        self.batch = BatchHandoff(world, 2, filter_name="ekf", threads=1, auto_reset=False, **options)
        self.shown = self.batch.reset([seed, seed])
        self.observations: Any
        self.observations, self.infos = self.one.reset(seed=seed)
        self.failures = 0

    def compare(self) -> None:
        for j, name in enumerate(self.one.possible_agents):
            mine = self.shown[0, j]
            if name in self.observations:
                np.testing.assert_allclose(mine, self.observations[name], atol=1e-5, err_msg=name)
            else:
                assert not mine.any()
        np.testing.assert_array_equal(self.shown[0], self.shown[1])

    def step(self, actions: dict[str, Any], idle: Any) -> BatchStep:
        flat = np.array([actions.get(name, idle) for name in self.one.possible_agents])
        before = set(self.one.agents)
        self.observations, rewards, _, cut, self.infos = self.one.step(actions)
        step = self.batch.step(np.stack([flat, flat]))
        self.shown = step.last
        for j, name in enumerate(self.one.possible_agents):
            failed = name in before and bool(self.infos[name].get("failed"))
            assert step.failed[0, j] == failed
            self.failures += failed
        assert step.rewards[0] == pytest.approx(next(iter(rewards.values())), abs=1e-9)
        if not self.one.agents:
            assert step.truncated[0] == any(cut.values())
            assert step.terminated[0] == (not any(cut.values()))
        else:
            assert step.alive[0].tolist() == [name in self.one.agents for name in self.one.possible_agents]
        return step

    def close(self) -> None:
        self.one.close()
        self.batch.close()


def play(pair: Pair) -> BatchStep:
    team, step = make_team("learned", pair.one), None
    while pair.one.agents:
        pair.compare()
        live = {name: pair.observations[name] for name in pair.one.agents}
        step = pair.step(team(live), np.full(5, 0.3))
    pair.compare()
    assert step is not None
    episode = next(info["handoff_episode"] for info in pair.infos.values() if "handoff_episode" in info)
    assert step.finished[0]["time_in_view"] == episode["time_in_view"]
    assert step.finished[0]["handoffs"] == episode["handoffs"]
    return step


def test_failures_and_messages_are_those_of_the_other_back_end() -> None:
    pair = Pair(FAILURES, 7, max_cycles=70, failures={"rate_per_s": 0.1})
    play(pair)
    assert pair.failures >= 2
    pair.close()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_minute_of_failures_agrees(seed: int) -> None:
    pair = Pair(FAILURES, seed, max_cycles=600, failures={"rate_per_s": 0.02})
    play(pair)
    assert pair.failures
    pair.close()


def test_assignments_and_masks_are_those_of_the_other_back_end() -> None:
    options = {"message_delay_s": 0.15, "message_loss": 0.4, "failures": {"schedule_s": {"camera_1": 2.0}}}
    pair = Pair("quickstart", 5, max_cycles=60, action_mode="assign", **options)
    rng, step = np.random.default_rng(0), None
    while pair.one.agents:
        pair.compare()
        masks = pair.batch.action_masks()
        assert masks is not None
        for j, name in enumerate(pair.one.possible_agents):
            if name in pair.one.agents:
                np.testing.assert_array_equal(masks[0, j], pair.infos[name]["action_mask"])
        actions = {name: np.int64(rng.integers(4)) for name in pair.one.agents}
        step = pair.step(actions, 0)
    assert step is not None
    assert pair.failures == 1
    pair.batch.reset([1, 1])
    with pytest.raises(ConfigError, match=r"whole numbers in 0\.\.3"):
        pair.batch.step(np.full((2, 4), 4))
    pair.close()


def test_when_the_last_agent_fails_the_episode_ends_and_another_begins() -> None:
    times = {f"camera_{j}": 0.2 * (j + 1) for j in range(4)}
    env = BatchVectorEnv(
        BatchHandoff("quickstart", 2, filter_name="ekf", threads=1, failures={"schedule_s": times}),
        "SameStep",
    )
    env.reset(seed=1)
    for k in range(1, 9):
        shown, _, terminated, truncated, infos = env.step(np.zeros((2, 4, 5), dtype=np.float32))
        assert terminated.all() == (k == 8)
        assert not truncated.any()
        dead = (
            (k - 1) // 2 if k < 8 else 0
        )  # rows are empty from the step after the one in which an agent fails
        assert [bool(row.any()) for row in shown[0]] == [False] * dead + [True] * (4 - dead)
        failed = k // 2 if k < 8 else 0
        assert infos["alive"][1].tolist() == [False] * failed + [True] * (4 - failed)
    assert infos["final_info"]["handoff_episode"]["length"].tolist() == [8, 8]
    env.close()


def test_rows_of_failed_agents_are_done_and_then_empty() -> None:
    pytest.importorskip("stable_baselines3")
    failures = {"schedule_s": {"camera_1": 0.2}}
    rows = sb3_vec_env(
        BatchHandoff("quickstart", 2, filter_name="ekf", threads=1, max_cycles=4, failures=failures)
    )
    rows.reset()
    record = [rows.step(np.zeros((8, 5), dtype=np.float32)) for _ in range(4)]
    assert [dones.tolist() for _, _, dones, _ in record] == [
        [False] * 8,
        [False, True, False, False] * 2,
        [False] * 8,
        [True] * 8,
    ]
    assert record[1][3][1]["terminal_observation"].any()
    assert not record[1][3][1]["TimeLimit.truncated"]
    assert not record[2][0][[1, 5]].any()
    assert record[2][1][1] == 0.0 != record[2][1][0]
    assert [info["TimeLimit.truncated"] for info in record[3][3][:4]] == [True, False, True, True]
    assert rows.observation_space.contains(record[3][0][1])
    rows.close()
