"""Environments as rows of features for a learner: every agent of every environment is one row of a ``VecEnv``."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from camnet.agents.features import FEATURES, FeatureMap
from camnet.agents.policy import AgentContext
from camnet.copies import ExactCopies
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


class FeatureRows(ExactCopies, VecEnvWrapper):
    """Agents of many environments of one world, shown by the features of `camnet.agents.features`.

    Parameters
    ----------
    rows : of `camnet.env.batch_vector.sb3_vec_env`: agents, agent by agent within an environment
    known : fixed facts of the agents of one environment, in that order
    base, share : what acts on observations (B, D); actions are then ``base + share * action``, clipped
    """

    def __init__(
        self, rows: VecEnv, known: Sequence[AgentContext], base: Rule | None = None, share: float = 1.0
    ) -> None:
        box = spaces.Box(-np.inf, np.inf, (len(FEATURES),), dtype=np.float32)
        super().__init__(rows, observation_space=box)
        self._base, self._share = base, share
        self._map = FeatureMap(known[0].layout)
        sizes = np.array([context.half_size for context in known])
        self._half_sizes = np.tile(sizes, (rows.num_envs // len(known), 1))
        self.normaliser = Normaliser.none()
        #: observations (B, D) behind the last features
        self.shown: NDArray[np.float32] = np.zeros((rows.num_envs, 0), dtype=np.float32)

    def __getstate__(self) -> dict[str, Any]:
        return {
            **self.__dict__,
            "class_attributes": None,
        }  # of the class, as the base keeps them: not to be copied

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.class_attributes = dict(inspect.getmembers(type(self)))

    def _features(self, shown: NDArray[np.float32]) -> NDArray[np.float32]:
        self.shown = shown
        return self.normaliser(self._map(shown, self._half_sizes))

    def reset(self) -> VecEnvObs:
        """Start new episodes everywhere."""
        return self._features(np.asarray(self.venv.reset()))

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of all rows."""
        wanted = np.asarray(actions, dtype=np.float32)
        if self._base is not None:
            wanted = np.clip(self._base(self.shown) + self._share * wanted, -1.0, 1.0)
        self.venv.step_async(wanted)

    def step_wait(self) -> VecEnvStepReturn:
        """Fly a decision; the last observation of an episode that has ended is turned into features, too."""
        shown, rewards, dones, infos = self.venv.step_wait()
        for row in np.flatnonzero(dones):
            last = np.asarray(infos[row]["terminal_observation"])[None]
            infos[row]["terminal_observation"] = self.normaliser(
                self._map(last, self._half_sizes[row : row + 1])
            )[0]
        return self._features(np.asarray(shown)), rewards, dones, infos


class JoinedRows(ExactCopies, VecEnv):
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
