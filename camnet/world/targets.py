"""The targets of a world, stepped by their laws of motion; some laws can be followed many steps at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from camnet.errors import SimulationError
from camnet.motion.protocol import TargetMotion, TargetState
from camnet.types import Array

__all__ = ["PathLaw", "Targets"]

#: steps taken at a time where a law allows it
_AHEAD = 64
#: numbers of a state that are no memory of its law: p, q, v, w
_SHOWN = 13


@runtime_checkable
class PathLaw(Protocol):
    """A law of motion that needs no random numbers and no time, and can be followed in one compiled call."""

    def states_ahead(self, state: TargetState, dt_s: float, count: int) -> Array:
        """Return ``count`` states ahead as `step` makes them: rows of p, q, v, w and the law's memory."""
        ...


class Targets:
    """M targets from one control period to the next.

    Nothing pushes a target, so its states can be made before they are shown.

    Parameters
    ----------
    names, motions : of the M targets
    dt_s : control period, s
    """

    def __init__(self, names: Sequence[str], motions: Sequence[TargetMotion], dt_s: float) -> None:
        self._names, self._motions, self._dt = tuple(names), tuple(motions), dt_s
        self._laws = [motion if isinstance(motion, PathLaw) else None for motion in motions]

    def reset(self, generators: Sequence[np.random.Generator]) -> list[TargetState]:
        """Put all targets at their start, and return their states."""
        self._rngs = list(generators)
        self._states = [motion.reset(rng) for motion, rng in zip(self._motions, self._rngs, strict=True)]
        self._paths: list[Array | None] = [None] * len(self._states)
        self._used = [0] * len(self._states)
        self._now = np.array([_row(state) for state in self._states]).reshape(len(self._states), _SHOWN)
        return self._states

    @property
    def now(self) -> Array:
        """States (M,13) now: p, q (scalar first), v in the world frame, w in the body frame."""
        return self._now

    def advance(self, t_s: float, step: int) -> Array:
        """Move all targets from ``t_s``, physics step ``step``, by one control period.

        Returns `now`, an array of its own.

        Raises
        ------
        SimulationError
            A target's pose is not finite.
        """
        path, used = self._paths[0] if len(self._paths) == 1 else None, self._used
        if path is not None and used[0] < len(path):
            self._now = path[used[0] : used[0] + 1, :_SHOWN]
            used[0] += 1
            return self._now
        now = np.empty((len(self._motions), _SHOWN))
        for k in range(len(self._motions)):
            now[k] = self._next(k, t_s, step)[:_SHOWN]
        self._now = now
        return now

    def _next(self, k: int, t_s: float, step: int) -> Array:
        """Next state of target ``k``, as a row."""
        path, law = self._paths[k], self._laws[k]
        if path is not None and self._used[k] < len(path):
            self._used[k] += 1
            return np.asarray(path[self._used[k] - 1])
        if law is not None:
            if path is not None:
                self._states[k] = _state(path[-1])
            path = law.states_ahead(self._states[k], self._dt, _AHEAD)
            if np.isfinite(path).all():
                self._paths[k], self._used[k] = path, 1
                return np.asarray(path[0])
            self._paths[k], self._laws[k] = None, None  # step by step up to where it fails
        state = self._motions[k].step(self._states[k], t_s, self._dt, self._rngs[k])
        self._states[k] = state
        if not math.isfinite(sum(state.p_world.tolist()) + sum(state.q_world.tolist())):
            raise SimulationError(
                f"step {step}: pose of target {self._names[k]!r} is not finite: {state.p_world}"
            )
        return _row(state)


def _row(state: TargetState) -> Array:
    return np.concatenate([state.p_world, state.q_world, state.v_world, state.w_body])


def _state(row: Array) -> TargetState:
    return TargetState(row[:3], row[3:7], row[7:10], row[10:13], row[13:])
