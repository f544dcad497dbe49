"""Greedy: fly to the point of the region nearest to the nearest estimate and look at it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.agents.policy import Action, AgentContext
from camnet.control.setpoints import Setpoint
from camnet.geometry.rotations import gaze_angles

__all__ = ["Nearest"]


class Nearest:
    """Chase the nearest estimate, without any prediction of entries.

    Parameters
    ----------
    context : of the agent
    """

    def __init__(self, context: AgentContext) -> None:
        self._context = context

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Return the action for an observation."""
        context = self._context
        values = context.layout.decode(observation)
        places = [
            context.world(values[f"target_{m}.position"])
            for m in range(context.layout.n_targets)
            if values[f"target_{m}.known"][0]
        ]
        if not places:
            return context.action(Setpoint(context.center, np.zeros(2)))
        own_p = context.world(values["own.position"])
        goal = min(places, key=lambda p: float(np.linalg.norm(p - own_p)))
        above = np.array([goal[0], goal[1], context.center[2] + 0.5 * context.half_size[2]])
        p_world = context.region.project(above, context.controller.region_margin_m)
        pan, tilt = gaze_angles(goal - p_world)
        return context.action(Setpoint(p_world, np.array([float(pan), float(tilt)])))
