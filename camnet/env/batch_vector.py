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

from camnet.copies import ExactCopies
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.checks import checked_seed, no_options
from camnet.env.infos import finished_info
from camnet.errors import ConfigError
from camnet.types import Array, BoolArray

__all__ = ["BatchVectorEnv", "sb3_vec_env"]

_Observations = NDArray[np.float32]


class BatchVectorEnv(ExactCopies, VectorEnv[_Observations, NDArray[np.float32], Array]):
    """E environments, each with the observations (N, D) and actions (N, 5) of all its agents, and the shared reward.

    Infos hold, for environments whose episode has ended, ``final_obs`` and ``final_info`` (with ``handoff_episode``:
    the figures of `BatchStep.finished`; see `camnet.env.infos` for their two forms), masked as Gymnasium does.

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
        """Start all environments; a number seeds them consecutively, a list one by one (None: the sequence goes on).

        Raises
        ------
        ConfigError
            A seed is no whole number from 0 on, there are options, or the environments are closed.
        """
        no_options("the vector form", options)
        if not isinstance(seed, list | tuple | np.ndarray):
            return self.env.reset(seed=None if seed is None else checked_seed(seed)), {}
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
            last = finished_info(figures, self.env.settings.info_form == "flat")
            infos = self._add_info(infos, {"final_obs": step.last[e], "final_info": last}, e)
        return step.observations, step.rewards, step.terminated, step.truncated, infos

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401 - as in the base
        """End the environments' threads."""
        self.env.close()


def _check(env: BatchHandoff) -> None:
    if not env.auto_reset:
        raise ConfigError("auto_reset = False: vector environments start their episodes by themselves")


def sb3_vec_env(env: BatchHandoff) -> Any:  # noqa: ANN401 - the class exists where the library is installed
    """Every agent of every environment as one row of a Stable-Baselines3 ``VecEnv``: `camnet.env.batch_rows.AgentRows`.

    Raises
    ------
    ConfigError
        Stable-Baselines3 is not installed (extra ``train``), or ``env`` does not start episodes by itself.
    """
    _check(env)
    try:
        from camnet.env.batch_rows import AgentRows
    except ImportError as error:
        raise ConfigError("Stable-Baselines3 is not installed: pip install 'camnet[train]'") from error
    return AgentRows(env)
