"""TorchRL wraps the parallel form; its roll-outs have the shapes of the network."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("torchrl")

from torchrl.envs import PettingZooWrapper  # noqa: E402 - may be missing
from torchrl.envs.utils import check_env_specs  # noqa: E402

from camnet.env import handoff_v0  # noqa: E402

_CYCLES = 6


@pytest.mark.parametrize(("action_mode", "info_form"), [("setpoint", "flat"), ("assign", "flat")])
def test_roll_outs(action_mode: str, info_form: str) -> None:
    parallel = handoff_v0.parallel_env(max_cycles=_CYCLES, action_mode=action_mode, info_form=info_form)
    group = {"cameras": parallel.possible_agents}
    env = PettingZooWrapper(env=parallel, group_map=group, use_mask=True, categorical_actions=True)
    check_env_specs(env)
    played = env.rollout(20, break_when_any_done=False)
    agents, size = len(parallel.possible_agents), parallel.observation_space("camera_0").shape
    assert played["cameras", "observation"].shape == (20, agents, *size)
    reward = played["next", "cameras", "reward"]
    assert reward.shape == (20, agents, 1)
    assert torch.isfinite(reward).all()
    assert played["next", "done"].sum() == 20 // _CYCLES
    if info_form == "flat":
        figures = played["next", "cameras", "info", "handoff_episode.time_in_view"]
        assert torch.isfinite(figures).any()
    env.close()
