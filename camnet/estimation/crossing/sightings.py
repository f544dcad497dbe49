"""What the predictors across gaps are told, what they answer, and what they have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from camnet.types import Array

__all__ = [
    "CrossingPrediction",
    "EntryState",
    "ExitState",
    "GapPredictor",
    "Lesson",
    "Sighting",
    "faded_velocity",
    "only_camera",
]


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """One target as one camera sees it at one instant.

    Attributes
    ----------
    t_s : time, s
    p_world : (2,) position on the ground, m
    v_world : (2,) mean velocity since the sighting before, m/s; zero where there was none shortly before
    camera : index of the camera that sees it from nearest
    target : index of the target
    """

    t_s: float
    p_world: Array
    v_world: Array
    camera: int
    target: int


#: the last sighting before a gap, the first one after it
ExitState = Sighting
EntryState = Sighting


@dataclass(frozen=True, eq=False, slots=True)
class Lesson:
    """What can be learned from a crossing: from ``exit`` one comes to ``entry``.

    Attributes
    ----------
    exit, entry : the two ends; ``entry.t_s - exit.t_s`` is the time taken
    known_s : when this was known, s (a lesson's velocities may be known later than its positions)
    reversed : the crossing is told backwards
    extended : one of the ends is a sighting away from the gap
    """

    exit: ExitState
    entry: EntryState
    known_s: float
    reversed: bool = False
    extended: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class CrossingPrediction:
    """Where a target is expected.

    Attributes
    ----------
    p_world : (2,) place, m
    radius_m : radius that held the stated share of the latest errors, scaled to the spread of this prediction; inf
        before there is any record
    next_camera : (C,) probability that each camera is the one that sees it next
    support : effective number of lessons behind it, 0 for a guess
    """

    p_world: Array
    radius_m: float
    next_camera: Array
    support: float


class GapPredictor(Protocol):
    """A predictor across gaps. A prediction may use only what was known before the exit, or as its settings state."""

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Predict the place at ``t_s`` of a target last seen at ``exit``."""

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Take in motion that was seen: two sightings in a row of one target."""

    def learn(self, lesson: Lesson) -> None:
        """Take in a crossing."""


def only_camera(count: int, camera: int) -> Array:
    """Probabilities (count,) that are sure of one camera."""
    probability = np.zeros(count)
    probability[camera] = 1.0
    return probability


def faded_velocity(exit: ExitState, t_s: float, memory_s: float) -> Array:
    """Position (2,) at ``t_s`` of a target whose exit velocity fades exponentially with ``memory_s``."""
    reach = memory_s * -np.expm1(-(t_s - exit.t_s) / memory_s)
    return np.asarray(exit.p_world + reach * exit.v_world)
