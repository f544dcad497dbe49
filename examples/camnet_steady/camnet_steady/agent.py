"""An agent that stays in the middle of its region and looks straight down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.agents.policy import Action, AgentContext

__all__ = ["Hover"]


class Hover:
    """Ask for the middle always; observations come from the extended Kalman filter.

    Parameters
    ----------
    context : of the agent
    """

    estimator = "ekf"

    def __init__(self, context: AgentContext) -> None:
        self._action = np.zeros(5, dtype=np.float32)

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Return the same action for every observation."""
        return self._action.copy()
