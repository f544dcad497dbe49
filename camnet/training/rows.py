"""Environments as rows of features for a learner: every agent of every environment is one row of a ``VecEnv``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from camnet.agents.features import FEATURES, FeatureMap
from camnet.agents.policy import AgentContext
from camnet.env.batch_handoff import BatchHandoff
from camnet.types import Array

__all__ = ["FeatureRows", "JoinedRows", "Normaliser", "Rule"]

#: from observations (B, D) of all rows to actions (B, A)
Rule = Callable[[NDArray[np.float32]], NDArray[np.float32]]

_LIMIT = 10.0


class Normaliser:
    """Features on a common scale: ``clip((x - mean) / scale, -10, 10)``, as `camnet.agents.policy_file` shows them."""

    def __init__(self, mean: Array, scale: Array) -> None:
        self.mean, self.scale = mean, scale

    @staticmethod
    def none() -> Normaliser:
        """Leave features as they are."""
        return Normaliser(np.zeros(len(FEATURES)), np.ones(len(FEATURES)))

    @staticmethod
    def of(features: NDArray[np.floating[Any]]) -> Normaliser:
        """Fit mean and standard deviation of (B, F) features; what never changes keeps its scale."""
        deviation = features.std(axis=0, dtype=float)
        return Normaliser(features.mean(axis=0, dtype=float), np.where(deviation > 1e-3, deviation, 1.0))

    def __call__(self, features: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """Return the features as shown to a network."""
        return np.clip((features - self.mean) / self.scale, -_LIMIT, _LIMIT).astype(np.float32)


class _Rows(VecEnv):
    """What the interface asks for and rows do not have."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Attribute of the rows (only ``render_mode`` is asked for)."""
        return [None] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:  # noqa: ANN401 - as in the base
        """Rows have no attributes of their own."""
        raise AttributeError(f"rows have no attribute {attr_name!r} to set")

    def env_method(
        self,
        method_name: str,
        *args: Any,  # noqa: ANN401 - as in the base
        indices: VecEnvIndices = None,
        **kwargs: Any,  # noqa: ANN401 - as in the base
    ) -> list[Any]:
        """Rows have no methods of their own."""
        raise AttributeError(f"rows have no method {method_name!r}")

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Rows are not wrapped one by one."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: VecEnvIndices) -> list[int]:
        return list(self._get_indices(indices))


class FeatureRows(_Rows):
    """Agents of many environments of one world, shown by the features of `camnet.agents.features`.

    Parameters
    ----------
    env : starts the next episode by itself; rows are agents, agent by agent within an environment
    known : fixed facts of the agents of one environment, in that order
    base, share : what acts on observations (B, D); actions are then ``base + share * action``, clipped
    """

    def __init__(
        self, env: BatchHandoff, known: Sequence[AgentContext], base: Rule | None = None, share: float = 1.0
    ) -> None:
        self.env, self._agents = env, len(known)
        self._base, self._share = base, share
        box = spaces.Box(-np.inf, np.inf, (len(FEATURES),), dtype=np.float32)
        action = spaces.Box(-1.0, 1.0, (5,), dtype=np.float32)
        super().__init__(env.environments * len(known), box, action)
        self._map = FeatureMap(known[0].layout)
        self._half_sizes = np.tile(np.array([context.half_size for context in known]), (env.environments, 1))
        self.normaliser = Normaliser.none()
        #: observations (B, D) behind the last features
        self.shown: NDArray[np.float32] = np.zeros((self.num_envs, 0), dtype=np.float32)
        self._seed_of_first: int | None = None
        self._actions = np.zeros((env.environments, self._agents, 5), dtype=np.float32)

    def _features(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        self.shown = observations.reshape(self.num_envs, -1)
        return self.normaliser(self._map(self.shown, self._half_sizes))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Choose the next reset's episodes: environment e takes seed + e, and goes on from there."""
        self._seed_of_first = seed
        return [seed] * self.num_envs

    def reset(self) -> VecEnvObs:
        """Start new episodes everywhere."""
        observations = self.env.reset(seed=self._seed_of_first)
        self._seed_of_first = None
        return self._features(observations)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of all rows."""
        wanted = np.asarray(actions, dtype=np.float32)
        if self._base is not None:
            wanted = np.clip(self._base(self.shown) + self._share * wanted, -1.0, 1.0)
        self._actions = wanted.reshape(self._actions.shape)

    def step_wait(self) -> VecEnvStepReturn:
        """Fly a decision; every agent of an environment gets the shared reward."""
        step = self.env.step(self._actions)
        dones = np.repeat(step.terminated | step.truncated, self._agents)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for e, figures in step.finished.items():
            rows = slice(e * self._agents, (e + 1) * self._agents)
            last = self.normaliser(self._map(step.last[e], self._half_sizes[rows]))
            for k, info in enumerate(infos[rows]):
                info["terminal_observation"] = last[k]
                info["TimeLimit.truncated"] = bool(step.truncated[e])
            infos[rows.start]["episode"] = {
                "r": figures["return"],
                "l": figures["length"],
                "time_in_view": figures["time_in_view"],
            }
        rewards = np.repeat(step.rewards, self._agents).astype(np.float32)
        return self._features(step.observations), rewards, dones, infos

    def close(self) -> None:
        """End the environments' threads."""
        self.env.close()


class JoinedRows(_Rows):
    """The rows of several vector environments, one after the other.

    Parameters
    ----------
    parts : environments with the same spaces
    """

    def __init__(self, parts: Sequence[VecEnv]) -> None:
        self.parts = list(parts)
        ends = np.cumsum([part.num_envs for part in self.parts])
        self._where = [slice(int(e) - p.num_envs, int(e)) for p, e in zip(self.parts, ends, strict=True)]
        super().__init__(int(ends[-1]), self.parts[0].observation_space, self.parts[0].action_space)

    def reset(self) -> VecEnvObs:
        """Start new episodes everywhere."""
        return np.concatenate([np.asarray(part.reset()) for part in self.parts])

    def step_async(self, actions: NDArray[Any]) -> None:
        """Give every part its actions."""
        for part, where in zip(self.parts, self._where, strict=True):
            part.step_async(actions[where])

    def step_wait(self) -> VecEnvStepReturn:
        """Finish the step of every part."""
        steps = [part.step_wait() for part in self.parts]
        observations = np.concatenate([np.asarray(step[0]) for step in steps])
        infos = [info for step in steps for info in step[3]]
        return (
            observations,
            np.concatenate([s[1] for s in steps]),
            np.concatenate([s[2] for s in steps]),
            infos,
        )

    def close(self) -> None:
        """Close every part."""
        for part in self.parts:
            part.close()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next episodes of every part."""
        return [
            s
            for k, part in enumerate(self.parts)
            for s in part.seed(None if seed is None else seed + 7919 * k)
        ]
