"""RLlib learns on the parallel form."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

ray = pytest.importorskip("ray")
pytest.importorskip("ray.rllib")

from ray.rllib.algorithms.ppo import PPOConfig  # noqa: E402 - may be missing
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv  # noqa: E402
from ray.tune.registry import register_env  # noqa: E402

from camnet.env import handoff_v0  # noqa: E402

_CYCLES = 8


def _make(config: dict[str, Any]) -> ParallelPettingZooEnv:
    return ParallelPettingZooEnv(handoff_v0.parallel_env(max_cycles=_CYCLES, info_form="flat"))


def test_ppo_learns_one_policy_for_all_cameras() -> None:
    os.environ["RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO"] = "0"
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, ignore_reinit_error=True)
    try:
        register_env("camnet_handoff", _make)
        config = (
            PPOConfig()
            .environment("camnet_handoff")
            .env_runners(num_env_runners=0, rollout_fragment_length=2 * _CYCLES)
            .multi_agent(policies={"shared"}, policy_mapping_fn=lambda agent, *_, **__: "shared")
            .training(train_batch_size_per_learner=2 * _CYCLES, minibatch_size=16, num_epochs=1)
            .debugging(seed=1)
        )
        learner = config.build_algo()
        results = [learner.train() for _ in range(2)]
        for result in results:
            figures = result["env_runners"]
            assert figures["episode_len_mean"] == _CYCLES
            assert np.isfinite(figures["episode_return_mean"])
            assert np.isfinite(result["learners"]["shared"]["policy_loss"])
        learner.stop()
    finally:
        ray.shutdown()
