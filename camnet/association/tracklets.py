"""Tracklets: unbroken stays in view. Their ends are what association across gaps has to join.

A tracklet starts where a target comes into view and stops at its last fix in view. ``follows`` is the truth that
association has to find; it is used to score, to close the gaps that are known to be closed, and to teach.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.association.crossing_density import Ends, Lessons
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Tracklets", "tracklets_of"]

_VELOCITY_WINDOW_S = 60.0


@dataclass(frozen=True, eq=False, slots=True)
class Tracklets:
    """Stays in view, n of them.

    Attributes
    ----------
    exits, entries : their ends
    after, before : (n,) the next and the last stay of the same visit, -1 for none
    open_until_s : (n,) when the target came back, or when its recording stopped
    recorded_until_s : (n,) when the recording of its target stopped
    target, visit : (n,) whose stay it is
    of_fix : (fixes,) tracklet of each fix, -1 where unseen
    """

    exits: Ends
    entries: Ends
    after: IntArray
    before: IntArray
    open_until_s: Array
    recorded_until_s: Array
    target: IntArray
    visit: IntArray
    of_fix: IntArray

    @property
    def resighted(self) -> IntArray:
        """Tracklets (k,) that end a gap, in the order of time."""
        back = np.flatnonzero(self.before >= 0)
        return np.asarray(back[np.argsort(self.entries.t_s[back], kind="stable")])

    def lessons(self, reversed_penalty: float) -> Lessons:
        """Every gap with its true end; recordings that stopped while unseen are gaps without one."""
        came = self.after >= 0
        k = np.flatnonzero(came | (self.open_until_s > self.exits.t_s))
        to = np.where(came[k], self.after[k], 0)
        entries = _take(self.entries, to)
        known = np.where(came[k], entries.t_s, self.open_until_s[k])
        entries = Ends(known, entries.p_world, entries.v_world, entries.moving, entries.owner)
        return Lessons.of(_take(self.exits, k), entries, came[k], np.ones(len(k)), reversed_penalty)


def _take(ends: Ends, k: IntArray) -> Ends:
    return Ends(ends.t_s[k], ends.p_world[k], ends.v_world[k], ends.moving[k], ends.owner[k])


def tracklets_of(t_s: Array, p_world: Array, target: IntArray, visit: IntArray, seen: BoolArray) -> Tracklets:
    """Cut fixes into tracklets.

    Parameters
    ----------
    t_s, p_world : (n,), (n, 2) fixes, s and m
    target, visit : (n,) whose; a visit is a recording without a break
    seen : (n,) whether a camera sees it
    """
    order = np.lexsort((t_s, visit))
    v, s = visit[order], seen[order]
    starts = s.copy()
    starts[1:] &= ~s[:-1] | (v[1:] != v[:-1])
    number = np.where(s, np.cumsum(starts) - 1, -1)
    of_fix = np.empty(len(t_s), dtype=np.int64)
    of_fix[order] = number
    first = order[starts]
    rows = order[s]
    last = rows[np.r_[np.flatnonzero(np.diff(number[s]) != 0), len(rows) - 1]] if len(rows) else rows
    follow = np.zeros(len(first), dtype=bool)
    follow[1:] = visit[first[1:]] == visit[first[:-1]]
    index = np.arange(len(first))
    before = np.where(follow, index - 1, -1)
    after = np.where(np.r_[follow[1:], False] if len(first) else follow, index + 1, -1)
    stop = np.full(int(visit.max()) + 1, -np.inf)
    np.maximum.at(stop, visit, t_s)
    recorded = stop[visit[first]]
    open_until = np.where(after >= 0, t_s[first][np.maximum(after, 0)], recorded)
    place_of = np.empty(len(order), dtype=np.int64)
    place_of[order] = np.arange(len(order))
    exits = _ends(t_s, p_world, target, last, order[np.maximum(place_of[last] - 1, 0)], of_fix)
    later = order[np.minimum(place_of[first] + 1, len(order) - 1)]
    entries = _ends(t_s, p_world, target, first, later, of_fix)
    return Tracklets(exits, entries, after, before, open_until, recorded, target[first], visit[first], of_fix)


def _ends(
    t_s: Array, p_world: Array, target: IntArray, at: IntArray, beside: IntArray, of_fix: IntArray
) -> Ends:
    """Return ends at fixes ``at`` (n,), with the velocity to or from the fix ``beside`` of the same tracklet."""
    dt = t_s[at] - t_s[beside]
    moving = (of_fix[at] == of_fix[beside]) & (np.abs(dt) > 0.0) & (np.abs(dt) <= _VELOCITY_WINDOW_S)
    step = p_world[at] - p_world[beside]
    v = np.where(moving[:, None], step / np.where(moving, dt, 1.0)[:, None], 0.0)
    return Ends(t_s[at], p_world[at], v, moving, target[at])
