"""The batch back end as what training libraries expect: Gymnasium's ``VectorEnv`` and Stable-Baselines3's ``VecEnv``.

>>> from camnet.env.batch_handoff import BatchHandoff
>>> from camnet.env.batch_vector import BatchVectorEnv, sb3_vec_env
>>> joint = BatchVectorEnv(BatchHandoff("quickstart", 64))     # one learner sees all agents of an environment
>>> rows = sb3_vec_env(BatchHandoff("quickstart", 64))         # every agent is a row: parameter sharing

Episodes start again by themselves. In `BatchVectorEnv` as Gymnasium's modes say: by default in the step after the one
that ends them (``NEXT_STEP``: its action is not looked at, its reward is 0, it shows the new episode's beginning),
or in the step that ends them (``SAME_STEP``: the last observation of the old episode is in the infos). The rows of
`sb3_vec_env` do the latter, as that library asks.

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

    Infos hold ``handoff_episode`` for environments whose episode has ended: the figures of `BatchStep.finished` (see
    `camnet.env.infos` for their two forms), masked as Gymnasium does. In mode ``SAME_STEP`` they are in
    ``final_info``, beside ``final_obs``.

    Parameters
    ----------
    env : the environments; it must start episodes by itself
    autoreset_mode : Gymnasium's ``NEXT_STEP``, which its wrappers of observations ask for, or ``SAME_STEP``

    Raises
    ------
    ConfigError
        ``env`` does not start episodes by itself, or the mode is another one.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 - Gymnasium's convention

    def __init__(
        self, env: BatchHandoff, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP
    ) -> None:
        _check(env)
        self.env, self.num_envs = env, env.environments
        self.metadata = {**type(self).metadata, "autoreset_mode": _mode(autoreset_mode)}
        self._ended = np.zeros(self.num_envs, dtype=bool)
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
        self._ended[:] = False
        if not isinstance(seed, list | tuple | np.ndarray):
            return self.env.reset(seed=None if seed is None else checked_seed(seed)), {}
        first = [s for s in seed if s is not None]
        if len(first) not in (0, self.num_envs):
            raise ConfigError(f"seed = {seed!r}: give a seed for every environment or for none")
        return self.env.reset(first or None), {}

    def step(  # type: ignore[override] # flags are booleans, whatever type the base gives
        self, actions: NDArray[np.float32]
    ) -> tuple[_Observations, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Fly one decision in all environments, but for those that begin an episode in this step."""
        at_once = self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        begin = {int(e): self.env.seeds[e] for e in np.flatnonzero(self._ended)}
        step = self.env.step(actions)
        begun = self._ended
        shown, over = step.observations, (step.terminated | step.truncated) & ~begun
        if not at_once:
            if begin:  # they were stepped with the others: what came of it is dropped
                shown = self.env.begin_again(begin)
            shown = np.where(over[:, None, None], step.last, shown)
            self._ended = over
        infos: dict[str, Any] = {}
        if self.env.agents_can_fail:
            alive = step.alive | begun[:, None]
            infos = {"alive": alive, "_alive": np.ones(self.num_envs, dtype=bool)}
        for e in np.flatnonzero(over).tolist():
            told = finished_info(step.finished[e], self.env.settings.info_form == "flat")
            infos = self._add_info(
                infos, {"final_obs": step.last[e], "final_info": told} if at_once else told, e
            )
        rewards = np.where(begun, 0.0, step.rewards)
        return shown, rewards, step.terminated & ~begun, step.truncated & ~begun, infos

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401 - as in the base
        """End the environments' threads."""
        self.env.close()


def _mode(given: AutoresetMode | str) -> AutoresetMode:
    by_name = {AutoresetMode.NEXT_STEP.value: AutoresetMode.NEXT_STEP}
    by_name[AutoresetMode.SAME_STEP.value] = AutoresetMode.SAME_STEP
    value = given.value if isinstance(given, AutoresetMode) else given
    if value not in by_name:
        raise ConfigError(f"autoreset_mode = {given!r}: one of {', '.join(map(repr, by_name))} was expected")
    return by_name[value]


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
