"""Agents that fail during an episode."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.env.settings import FailureSettings
from camnet.errors import ConfigError
from camnet.types import BoolArray

__all__ = ["Failures"]


class Failures:
    """Decides which agents work.

    Parameters
    ----------
    settings : rate and schedule
    names : of the N agents
    dt_s : length of a decision, s

    Raises
    ------
    ConfigError
        The schedule names somebody who is no agent.
    """

    def __init__(self, settings: FailureSettings, names: Sequence[str], dt_s: float) -> None:
        unknown = sorted(set(settings.schedule_s) - set(names))
        if unknown:
            raise ConfigError(
                f"failures.schedule_s: {unknown[0]!r} is no agent; the agents are {', '.join(names)}"
            )
        self._at_s = np.array([settings.schedule_s.get(name, math.inf) for name in names])
        self._probability = -math.expm1(-settings.rate_per_s * dt_s)
        #: whether anybody can fail at all
        self.possible = self._probability > 0.0 or bool(np.isfinite(self._at_s).any())
        self._alive: BoolArray = np.ones(len(names), dtype=bool)
        self._rng = np.random.default_rng(0)

    def reset(self, rng: np.random.Generator) -> None:
        """Repair everybody; ``rng`` draws the failures of the next episode."""
        self._alive[:] = True
        self._rng = rng

    def draw(self, t_s: float) -> BoolArray:
        """Return which agents (N,) still work at ``t_s``, after one more decision; as many draws whoever still does."""
        struck = self._rng.random(len(self._alive)) < self._probability
        self._alive &= ~struck & (t_s + 1e-9 < self._at_s)
        return self._alive.copy()
