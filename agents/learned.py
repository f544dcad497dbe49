"""The system of the papers as a policy: track what is inside, wait at the predicted entry, else loiter.

What predicts is chosen with the environment (``filter_name="learned"``, ``"ekf"``, ...): the rule is the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.agents.policy import Action, AgentContext
from camnet.control.setpoints import Setpoint, at_ease, intercept, loiter, track
from camnet.types import Array, TargetEstimate

__all__ = ["Learned"]

_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


class Learned:
    """Handoff rule of harris2020, section 4.1, on observations.

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
        targets = [self._part(values, m) for m in range(context.layout.n_targets)]
        return context.action(self._setpoint(targets, context.world(values["own.position"])))

    @staticmethod
    def _part(values: dict[str, Array], m: int) -> dict[str, Array]:
        prefix = f"target_{m}."
        return {name[len(prefix) :]: value for name, value in values.items() if name.startswith(prefix)}

    def _setpoint(self, targets: list[dict[str, Array]], own_p: Array) -> Setpoint:
        context = self._context
        inside = [
            (m, t)
            for m, t in enumerate(targets)
            if t["seen_by_me"][0] or (t["inside"][0] and t["radius"][0] <= 1)
        ]
        if inside:
            m, best = min(inside, key=lambda item: (1 - item[1]["seen_by_me"][0], item[1]["radius"][0]))
            return track(self._estimate(m, best), context.region, context.camera, context.controller, own_p)
        coming = [(m, t) for m, t in enumerate(targets) if t["coming"][0] and t["entry_radius"][0] <= 1]
        if coming:
            m, best = min(coming, key=lambda item: (-item[1]["coming"][0], item[1]["entry_time"][0]))
            return self._meet(m, best, own_p)
        goal = loiter(context.region, context.camera, context.controller)
        return at_ease(goal, own_p, context.controller)

    def _estimate(self, m: int, target: dict[str, Array]) -> TargetEstimate:
        context = self._context
        return TargetEstimate(
            t_s=0.0,
            p_world=context.world(target["position"]),
            q_world=_UPRIGHT,
            v_world=target["velocity"] * context.speeds[m],
            w_body=np.zeros(3),
            seen=bool(target["seen"][0]),
            last_seen_s=0.0,
            region=0,
            radius_m=float(target["radius"][0]) * float(context.half_size[:2].min()),
        )

    def _meet(self, m: int, target: dict[str, Array], own_p: Array) -> Setpoint:
        context = self._context
        goal = intercept(
            context.world(target["entry_position"]),
            target["entry_velocity"] * context.speeds[m],
            float(target["entry_radius"][0]) * float(context.half_size[:2].min()),
            context.region,
            context.camera,
            context.controller,
        )
        return at_ease(goal, own_p, context.controller, float(target["entry_time"][0]) * context.lookahead_s)
