"""From a stream of sightings to crossings (exit and entry of a gap) and the lessons in them.

Every target's sightings are taken one by one, in the order of time. Nothing here looks ahead: a lesson that needs the
velocity after the entry is told when that velocity is known, at the next sighting.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from camnet.estimation.crossing.sightings import EntryState, ExitState, Lesson, Sighting
from camnet.types import Array

__all__ = ["Crossing", "CrossingTracker"]


@dataclass(frozen=True, eq=False, slots=True)
class Crossing:
    """A gap that ended: ``before`` is the sighting before the exit if the two were in a row."""

    exit: ExitState
    entry: EntryState
    before: Sighting | None


class CrossingTracker:
    """Follows one target.

    Parameters
    ----------
    target : its index
    velocity_window_s : sightings farther apart than this give no velocity
    """

    def __init__(self, target: int, velocity_window_s: float) -> None:
        self._target = target
        self._window_s = velocity_window_s
        self._last: Sighting | None = None
        self._before: Sighting | None = None
        self._missed = False
        self._open: Crossing | None = None
        self._after: Sighting | None = None

    @property
    def last(self) -> Sighting | None:
        """The last sighting of this visit."""
        return self._last

    def leave(self) -> None:
        """End the visit: the recording stops here, and what follows is no gap."""
        self._last = self._before = self._open = self._after = None
        self._missed = False

    def miss(self) -> None:
        """Note that the target is in nobody's view."""
        self._missed = self._last is not None

    def sight(self, t_s: float, p_world: Array, camera: int) -> Crossing | None:
        """Take in a sighting; returns the crossing that it ends, if any."""
        last, missed = self._last, self._missed
        sighting = Sighting(t_s, p_world, self._velocity(last, t_s, p_world), camera, self._target)
        crossing = None
        if last is not None and missed:
            crossing = Crossing(last, sighting, self._before)
        self._after = sighting
        self._before = None if missed else last
        self._last, self._missed = sighting, False
        return crossing

    def lessons(self, crossing: Crossing | None) -> Iterator[Lesson]:
        """Lessons known since the last `sight`, whose answer is ``crossing``; call once after it."""
        after = self._after
        if after is None:
            return
        if self._open is not None:
            yield from self._late_lessons(self._open, after, in_a_row=crossing is None)
        self._open = crossing
        if crossing is not None:
            yield Lesson(crossing.exit, crossing.entry, after.t_s)
            if crossing.before is not None:
                yield Lesson(crossing.before, crossing.entry, after.t_s, extended=True)

    def _late_lessons(self, crossing: Crossing, after: Sighting, in_a_row: bool) -> Iterator[Lesson]:
        """Lessons of the crossing before, told when its entry velocity is known."""
        exit_, entry, before = crossing.exit, crossing.entry, crossing.before
        known_s, back = after.t_s, -after.v_world
        yield _reversed(exit_, entry, back, known_s, extended=False)
        if before is not None:
            yield _reversed(before, entry, back, known_s, extended=True)
        if in_a_row:
            yield Lesson(exit_, after, known_s, extended=True)
            yield _reversed(exit_, after, back, known_s, extended=True)

    def _velocity(self, last: Sighting | None, t_s: float, p_world: Array) -> Array:
        if last is None or not 0.0 < t_s - last.t_s <= self._window_s:
            return np.zeros(2)
        return np.asarray((p_world - last.p_world) / (t_s - last.t_s))


def _reversed(exit: Sighting, entry: Sighting, back: Array, known_s: float, extended: bool) -> Lesson:
    start = Sighting(exit.t_s, entry.p_world, back, entry.camera, entry.target)
    end = Sighting(entry.t_s, exit.p_world, -exit.v_world, exit.camera, exit.target)
    return Lesson(start, end, known_s, reversed=True, extended=extended)
