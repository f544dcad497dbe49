"""Stay in the middle of the region and look straight down: what a fixed camera would do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.agents.policy import Action, AgentContext
from camnet.control.setpoints import loiter

__all__ = ["Static"]


class Static:
    """Loiter always.

    Parameters
    ----------
    context : of the agent
    """

    def __init__(self, context: AgentContext) -> None:
        self._action = context.action(loiter(context.region, context.camera, context.controller))

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Return the same action for every observation."""
        return self._action.copy()
