"""SuperSuit makes a vector environment of the parallel form, and Stable-Baselines3 learns on it."""

from __future__ import annotations

import numpy as np
import pytest

supersuit = pytest.importorskip("supersuit")
torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO  # noqa: E402 - both may be missing
from stable_baselines3.common.vec_env import VecMonitor  # noqa: E402

from camnet.env import handoff_v0  # noqa: E402


def test_ppo_learns_on_concatenated_environments() -> None:
    parallel = handoff_v0.parallel_env(max_cycles=8, terminate_on_collision=False)
    agents = len(parallel.possible_agents)
    vector = supersuit.pettingzoo_env_to_vec_env_v1(parallel)
    vector = supersuit.concat_vec_envs_v1(vector, 2, num_cpus=1, base_class="stable_baselines3")
    assert vector.num_envs == 2 * agents
    rows = VecMonitor(vector)
    torch.manual_seed(1)  # the vector environment takes no seed
    model = PPO("MlpPolicy", rows, n_steps=16, batch_size=32, n_epochs=1, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(2 * 16 * rows.num_envs)
    assert any(
        not np.array_equal(a, b.detach()) for a, b in zip(before, model.policy.parameters(), strict=True)
    )
    assert {episode["l"] for episode in model.ep_info_buffer} == {8}
    assert all(np.isfinite(episode["r"]) for episode in model.ep_info_buffer)
    shown = rows.reset()
    assert shown.shape == (2 * agents, *parallel.observation_space("camera_0").shape)
    rows.close()
