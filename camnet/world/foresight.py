"""The targets' true future: copies of their motion states and generators, stepped ahead of the world.

A target's motion depends on its own state, the time and its own generator alone, and nothing pushes it. So copies taken
at the start and stepped by the same law at the same times go through the states that the world will show, bit for bit.
For upper bounds only: no estimator may know this.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from camnet.motion.protocol import TargetMotion, TargetState
from camnet.types import Array

__all__ = ["Foresight"]


class Foresight:
    """Future of M targets; steps are made when first asked for, each once.

    Parameters
    ----------
    motions, states, generators : of the M targets at time 0; states and generators are copied. Targets may have one
        generator in common: they then draw from it in their order, as in the world
    dt_s : the world's step
    """

    def __init__(
        self,
        motions: Sequence[TargetMotion],
        states: Sequence[TargetState],
        generators: Sequence[np.random.Generator],
        dt_s: float,
    ) -> None:
        self._motions, self._dt = tuple(motions), dt_s
        self._states = list(states)
        # one call, so that a generator in common stays in common
        self._generators = copy.deepcopy(list(generators))
        self._p = [np.array([s.p_world for s in states])]
        self._q = [np.array([s.q_world for s in states])]

    def poses(self, target: int, t_s: Array) -> tuple[Array, Array]:
        """Return the true poses (K, 3), (K, 4) of a target at times (K,), s: those of the nearest steps."""
        steps = np.maximum(np.rint(np.asarray(t_s, dtype=float) / self._dt).astype(int), 0).tolist()
        for _ in range(len(self._p), 1 + max(steps, default=0)):
            self._step()
        return np.array([self._p[k][target] for k in steps]), np.array([self._q[k][target] for k in steps])

    def _step(self) -> None:
        t_s = (len(self._p) - 1) * self._dt
        self._states = [
            motion.step(state, t_s, self._dt, rng)
            for motion, state, rng in zip(self._motions, self._states, self._generators, strict=True)
        ]
        self._p.append(np.array([s.p_world for s in self._states]))
        self._q.append(np.array([s.q_world for s in self._states]))
