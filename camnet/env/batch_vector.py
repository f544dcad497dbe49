"""The batch back end as what training libraries expect: Gymnasium's ``VectorEnv`` and Stable-Baselines3's ``VecEnv``.

>>> from camnet.env.batch_handoff import BatchHandoff
>>> from camnet.env.batch_vector import BatchVectorEnv, sb3_vec_env
>>> joint = BatchVectorEnv(BatchHandoff("quickstart", 64))     # one learner sees all agents of an environment
>>> rows = sb3_vec_env(BatchHandoff("quickstart", 64))         # every agent is a row: parameter sharing

Episodes start again by themselves in the step that ends them; the last observation of the old one is in the infos, as
are its figures.

Agents that fail. Vector environments have as many rows as ever, so an agent that has failed keeps its place:
`BatchVectorEnv` tells who works in ``infos["alive"]`` (E, N). In the rows of `sb3_vec_env` the episode of an agent ends
(``done``, with its last observation as ``terminal_observation``) in the step in which it fails; until its environment's
episode is over its row shows zeros, earns nothing and takes any action.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from camnet.env.batch_handoff import BatchHandoff
from camnet.errors import ConfigError
from camnet.types import Array, BoolArray

__all__ = ["BatchVectorEnv", "sb3_vec_env"]

_Observations = NDArray[np.float32]


class BatchVectorEnv(VectorEnv[_Observations, NDArray[np.float32], Array]):
    """E environments, each with the observations (N, D) and actions (N, 5) of all its agents, and the shared reward.

    Infos hold, for environments whose episode has ended, ``final_obs`` and ``final_info`` (with ``episode``: return
    ``r``, length ``l``; and ``metrics``: the figures of `BatchStep.finished`), masked as Gymnasium does.

    Parameters
    ----------
    env : the environments; it must start episodes by itself

    Raises
    ------
    ConfigError
        ``env`` does not start episodes by itself.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - Gymnasium's convention

    def __init__(self, env: BatchHandoff) -> None:
        _check(env)
        self.env, self.num_envs = env, env.environments
        low, high = (np.tile(bound, (env.n_agents, 1)) for bound in (env.layout.low, env.layout.high))
        self.single_observation_space = spaces.Box(low, high, dtype=np.float32)
        self.single_action_space = batch_space(env.action_space, env.n_agents)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[_Observations, dict[str, Any]]:
        """Start all environments; a number seeds them consecutively, a list one by one (None: the sequence goes on)."""
        if seed is None or isinstance(seed, int):
            return self.env.reset(seed=seed), {}
        first = [s for s in seed if s is not None]
        if len(first) not in (0, self.num_envs):
            raise ConfigError(f"seed = {seed!r}: give a seed for every environment or for none")
        return self.env.reset(first or None), {}

    def step(  # type: ignore[override] # flags are booleans, whatever type the base gives
        self, actions: NDArray[np.float32]
    ) -> tuple[_Observations, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Fly one decision in all environments."""
        step = self.env.step(actions)
        infos: dict[str, Any] = {}
        if self.env.agents_can_fail:
            infos = {"alive": step.alive, "_alive": np.ones(self.num_envs, dtype=bool)}
        for e, figures in step.finished.items():
            last = {"episode": {"r": figures["return"], "l": figures["length"]}, "metrics": figures}
            infos = self._add_info(infos, {"final_obs": step.last[e], "final_info": last}, e)
        return step.observations, step.rewards, step.terminated, step.truncated, infos

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401 - as in the base
        """End the environments' threads."""
        self.env.close()


def _check(env: BatchHandoff) -> None:
    if not env.auto_reset:
        raise ConfigError("auto_reset = False: vector environments start their episodes by themselves")


def sb3_vec_env(env: BatchHandoff) -> Any:  # noqa: ANN401 - the class exists where the library is installed
    """Every agent of every environment as one row of a Stable-Baselines3 ``VecEnv``, for one policy shared by all.

    Row ``e N + j`` is agent j of environment e: observation (D,) of `camnet.env.layout`, action (5,), the
    environment's shared reward. In the info of a row whose episode has ended: ``terminal_observation``,
    ``TimeLimit.truncated``, and in the first agent's also ``episode`` (``r``, ``l``) and ``metrics``.

    Raises
    ------
    ConfigError
        Stable-Baselines3 is not installed (extra ``train``), or ``env`` does not start episodes by itself.
    """
    _check(env)
    try:
        from stable_baselines3.common.vec_env import VecEnv
    except ImportError as error:
        raise ConfigError("Stable-Baselines3 is not installed: pip install 'camnet[train]'") from error

    class AgentRows(VecEnv):
        """See `sb3_vec_env`."""

        def __init__(self) -> None:
            self.env, self._n = env, env.n_agents
            observation = spaces.Box(env.layout.low, env.layout.high, dtype=np.float32)
            super().__init__(env.environments * self._n, observation, env.action_space)
            self._first_seed: int | None = None
            shape, kind = (env.environments, self._n, *(env.action_space.shape or ())), env.action_space.dtype
            self._actions: NDArray[Any] = np.zeros(shape, dtype=kind)

        def seed(self, seed: int | None = None) -> list[int | None]:
            """Choose the episodes of the next reset: environment e takes seed + e."""
            self._first_seed = seed
            return [seed] * self.num_envs

        def reset(self) -> _Observations:
            """Start all environments."""
            observations = env.reset(seed=self._first_seed)
            self._first_seed = None
            return observations.reshape(self.num_envs, -1)

        def step_async(self, actions: NDArray[Any]) -> None:
            """Take the actions of all rows."""
            self._actions = np.asarray(actions, dtype=self._actions.dtype).reshape(self._actions.shape)

        def step_wait(self) -> tuple[_Observations, NDArray[np.float32], BoolArray, list[dict[str, Any]]]:
            """Fly one decision in all environments."""
            before = env.alive
            step = env.step(self._actions)
            infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
            dones = step.failed | (step.terminated | step.truncated)[:, None]
            for e, k in np.argwhere(dones).tolist():
                cut = step.truncated[e] and before[e, k] and not step.failed[e, k]
                infos[e * self._n + k]["terminal_observation"] = step.last[e, k]
                infos[e * self._n + k]["TimeLimit.truncated"] = bool(cut)
            for e, figures in step.finished.items():
                infos[e * self._n]["episode"] = {"r": figures["return"], "l": figures["length"]}
                infos[e * self._n]["metrics"] = figures
            rewards = np.where(before, step.rewards[:, None], 0.0).astype(np.float32)
            shown = np.where(step.alive[..., None], step.observations, np.float32(0.0))
            return shown.reshape(self.num_envs, -1), rewards.reshape(-1), dones.reshape(-1), infos

        def close(self) -> None:
            """End the environments' threads."""
            env.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ANN401
            """Attribute of the environments behind the rows."""
            return [getattr(env, attr_name, None) for _ in self._get_indices(indices)]

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ANN401
            """Rows have no attributes of their own."""
            raise AttributeError(f"rows of a batch have no attribute {attr_name!r} to set")

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:  # noqa: ANN401
            """Rows have no methods of their own."""
            raise AttributeError(f"rows of a batch have no method {method_name!r}")

        def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:  # noqa: ANN401
            """Rows are not wrapped one by one."""
            return [False for _ in self._get_indices(indices)]

    return AgentRows()
