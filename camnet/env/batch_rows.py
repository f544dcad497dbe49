"""Rows of a batch for Stable-Baselines3, which has to be installed (extra ``train``).

Read `camnet.env.batch_vector` first; its `sb3_vec_env` makes them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from camnet.copies import ExactCopies
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.checks import checked_seed, no_options
from camnet.env.infos import finished_info
from camnet.errors import ConfigError
from camnet.types import BoolArray

__all__ = ["AgentRows"]


class AgentRows(ExactCopies, VecEnv):
    """Every agent of every environment as one row, for one policy shared by all.

    Row ``e N + j`` is agent j of environment e: observation (D,) of `camnet.env.layout`, action (5,), the
    environment's shared reward. In the info of a row whose episode has ended: ``terminal_observation``,
    ``TimeLimit.truncated``, and in the first agent's also ``episode`` (``r``, ``l``, as this library's ``Monitor`` has
    it) and ``handoff_episode`` (see `camnet.env.infos`).

    Parameters
    ----------
    env : the environments; they must start episodes by themselves
    """

    def __init__(self, env: BatchHandoff) -> None:
        self.env, self._n = env, env.n_agents
        observation = spaces.Box(env.layout.low, env.layout.high, dtype=np.float32)
        super().__init__(env.environments * self._n, observation, env.action_space)
        self._first_seed: int | None = None
        self._shape = (env.environments, self._n, *(env.action_space.shape or ()))
        self._actions: NDArray[Any] = np.zeros(0)

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Choose the episodes of the next reset: environment e takes seed + e."""
        self._first_seed = None if seed is None else checked_seed(seed)
        return [self._first_seed] * self.num_envs

    def reset(self) -> NDArray[np.float32]:
        """Start all environments."""
        no_options("rows of a batch", [one for one in self._options if one])
        observations = self.env.reset(seed=self._first_seed)
        self._first_seed = None
        return observations.reshape(self.num_envs, -1)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of all rows.

        Raises
        ------
        ConfigError
            They have another shape; what else may be wrong with them is told by `step_wait`.
        """
        rows, shape = np.asarray(actions), (self.num_envs, *self._shape[2:])
        if rows.shape != shape:
            raise ConfigError(f"actions = {actions!r}: shape {shape} was expected; given: shape {rows.shape}")
        self._actions = rows.reshape(self._shape)

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], BoolArray, list[dict[str, Any]]]:
        """Fly one decision in all environments."""
        env = self.env
        before = env.alive
        step = env.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = step.failed | (step.terminated | step.truncated)[:, None]
        for e, k in np.argwhere(dones).tolist():
            cut = step.truncated[e] and before[e, k] and not step.failed[e, k]
            infos[e * self._n + k]["terminal_observation"] = step.last[e, k]
            infos[e * self._n + k]["TimeLimit.truncated"] = bool(cut)
        for e, figures in step.finished.items():
            first = infos[e * self._n]
            first["episode"] = {"r": figures["return"], "l": figures["length"]}
            first.update(finished_info(figures, env.settings.info_form == "flat"))
        rewards = np.where(before, step.rewards[:, None], 0.0).astype(np.float32)
        shown = np.where(step.alive[..., None], step.observations, np.float32(0.0))
        return shown.reshape(self.num_envs, -1), rewards.reshape(-1), dones.reshape(-1), infos

    def close(self) -> None:
        """End the environments' threads."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ANN401
        """Attribute of the environments behind the rows."""
        return [getattr(self.env, attr_name, None) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ANN401
        """Rows have no attributes of their own."""
        raise AttributeError(f"rows of a batch have no attribute {attr_name!r} to set")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:  # noqa: ANN401
        """Rows have no methods of their own."""
        raise AttributeError(f"rows of a batch have no method {method_name!r}")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:  # noqa: ANN401
        """Rows are not wrapped one by one."""
        return [False for _ in self._get_indices(indices)]
