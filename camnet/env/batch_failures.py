"""Agents that fail, in many environments at once: `camnet.env.failures`, draw for draw."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.env.batch_chance import Chance
from camnet.env.failures import Failures
from camnet.env.settings import FailureSettings
from camnet.types import Array, BoolArray

__all__ = ["BatchFailures"]


class BatchFailures:
    """Decides which agents work in E environments.

    Parameters
    ----------
    settings : rate and schedule
    names : of the N agents
    dt_s : length of a decision, s
    environments : E

    Raises
    ------
    ConfigError
        The schedule names somebody who is no agent.
    """

    def __init__(
        self, settings: FailureSettings, names: Sequence[str], dt_s: float, environments: int
    ) -> None:
        self.possible = Failures(settings, names, dt_s).possible
        self._at_s = np.array([settings.schedule_s.get(name, math.inf) for name in names])
        self._probability = -math.expm1(-settings.rate_per_s * dt_s)
        self._all = np.arange(environments)
        #: which agents (E, N) work
        self.alive: BoolArray = np.ones((environments, len(names)), dtype=bool)
        self._chance = Chance(environments if self.possible else 0, len(names))

    def reset(self, e: int, rng: np.random.Generator) -> None:
        """Repair environment ``e``; ``rng`` draws the failures of its next episode."""
        self.alive[e] = True
        if self.possible:
            self._chance.reset(e, rng)

    def draw(self, t_s: Array) -> BoolArray:
        """Let agents fail in the decision that ended at ``t_s`` (E,); return who just did (E, N)."""
        struck = self._chance.draw(self._all) < self._probability
        works = self.alive & ~struck & (t_s[:, None] + 1e-9 < self._at_s)
        failed = self.alive & ~works
        self.alive = works
        return np.asarray(failed)
