"""Actions drawn at random: the lower bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.agents.policy import Action, AgentContext

__all__ = ["RandomWalk"]


class RandomWalk:
    """Draw every action uniformly.

    Parameters
    ----------
    context : of the agent
    rng : source of the draws
    """

    def __init__(self, context: AgentContext, rng: np.random.Generator) -> None:
        self._rng = rng

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Return a random action for any observation."""
        return self._rng.uniform(-1.0, 1.0, 5).astype(np.float32)
