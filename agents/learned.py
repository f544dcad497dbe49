"""The system of the papers as a policy: track what is inside, wait at the predicted entry, else loiter.

What predicts is chosen with the environment (``filter_name="learned"``, ``"ekf"``, ...): the rule is the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from camnet.agents.learned_kernel import FIELDS, act, pack_facts
from camnet.agents.policy import Action, AgentContext
from camnet.control.setpoints import Setpoint, at_ease, intercept, loiter, track
from camnet.types import Array, TargetEstimate

__all__ = ["Learned"]

_UPRIGHT, _STILL = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)


class Learned:
    """Handoff rule of harris2020, section 4.1, on observations.

    Parameters
    ----------
    context : of the agent
    """

    def __init__(self, context: AgentContext) -> None:
        self._context = context
        slices = context.layout.slices
        self._first = [
            {name: slices[f"target_{m}.{name}"].start for name in FIELDS}
            for m in range(context.layout.n_targets)
        ]
        self._columns = np.array([list(first.values()) for first in self._first], dtype=np.int64)
        self._facts, self._speeds = pack_facts(context), np.asarray(context.speeds, dtype=float)
        free = context.viewpoints
        self._rest = loiter(context.region, context.camera, context.controller) if free is None else free.rest

    def __call__(self, observation: NDArray[np.float32] | Mapping[str, NDArray[np.float32]]) -> Action:
        """Return the action for an observation."""
        if isinstance(observation, Mapping):
            observation = np.concatenate([observation[name] for name in self._context.layout.slices])
        if self._facts is None or observation.dtype != np.float32:
            return self.readable(observation)
        return np.asarray(act(observation, self._columns, self._speeds, self._facts))

    def readable(self, observation: NDArray[np.float32]) -> Action:
        """Do what a call does, one named quantity at a time, in a region of any kind."""
        context = self._context
        values = np.asarray(observation, dtype=float)
        return context.action(self._setpoint(values, values.tolist(), context.world(values[:3])))

    def _setpoint(self, array: Array, values: list[float], own_p: Array) -> Setpoint:
        """Setpoint of an observation, given as an array and as a list: single numbers are read faster from that."""
        context = self._context
        present = [
            (1.0 - values[t["seen_by_me"]], values[t["radius"]], m)
            for m, t in enumerate(self._first)
            if values[t["seen_by_me"]] or (values[t["inside"]] and values[t["radius"]] <= 1)
        ]
        if present:
            estimate = self._estimate(array, values, min(present)[2])
            wanted = track(estimate, context.region, context.camera, context.controller, own_p)
            free = context.viewpoints
            return wanted if free is None else free.seeing(wanted, estimate.p_world, own_p)
        coming = [
            (-values[t["coming"]], values[t["entry_time"]], m)
            for m, t in enumerate(self._first)
            if values[t["coming"]] and values[t["entry_radius"]] <= 1
        ]
        if coming:
            return self._meet(array, values, min(coming)[2], own_p)
        return self._ease(self._rest, own_p)

    def _ease(self, goal: Setpoint, own_p: Array, within_s: float = math.inf) -> Setpoint:
        """Return a setpoint on the way to ``goal``."""
        if self._context.viewpoints is not None:
            return self._context.viewpoints.on_the_way(goal, own_p, within_s)
        return at_ease(goal, own_p, self._context.controller, within_s)

    def _estimate(self, array: Array, values: list[float], m: int) -> TargetEstimate:
        context, first = self._context, self._first[m]
        p, v = first["position"], first["velocity"]
        return TargetEstimate(
            t_s=0.0,
            p_world=context.world(array[p : p + 3]),
            q_world=_UPRIGHT,
            v_world=array[v : v + 3] * context.speeds[m],
            w_body=_STILL,
            seen=bool(values[first["seen"]]),
            last_seen_s=0.0,
            region=0,
            radius_m=values[first["radius"]] * context.width_m,
        )

    def _meet(self, array: Array, values: list[float], m: int, own_p: Array) -> Setpoint:
        context, first = self._context, self._first[m]
        p, v = first["entry_position"], first["entry_velocity"]
        entry_p = context.world(array[p : p + 3])
        goal = intercept(
            entry_p,
            array[v : v + 3] * context.speeds[m],
            values[first["entry_radius"]] * context.width_m,
            context.region,
            context.camera,
            context.controller,
        )
        if context.viewpoints is not None:
            goal = context.viewpoints.seeing(goal, entry_p)
        return self._ease(goal, own_p, values[first["entry_time"]] * context.lookahead_s)
