r"""The longest unseen stretch of any way through a network of roads, from entering it to leaving it.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| h(a) | ``head`` | m or s | unseen part of arc a before its first view; its whole length where nobody sees it |
| t(a) | ``tail`` | m or s | unseen part of arc a after its last view |
| F(a) | ``_ahead`` | m or s | longest unseen way from the start of a: h(a), and on over its successors if a is unseen |

A way is a walk along arcs. Its unseen stretches lie between two views of one arc, or lead from a view over unseen arcs
to the next one, t(a) + max F(b), or from an entry, F(a), or to an exit. A circle of unseen arcs makes F infinite. F is
a longest path over unseen arcs in reverse topological order: the cost is linear in arcs and turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.certification.promise import UnseenWay
from camnet.types import Array, BoolArray, IntArray

__all__ = ["SeenArcs", "UnseenWays", "longest_unseen"]


@dataclass(frozen=True, eq=False)
class SeenArcs:
    """Arcs with what is seen of each, in metres or in seconds.

    Attributes
    ----------
    length : (A,) of each arc
    successor_ptr, successor : (A + 1,), (T,) arcs that may follow arc a: ``successor[ptr[a]:ptr[a + 1]]``
    arc, start, end : (U,) seen stretches, disjoint, sorted by arc and start
    first, last : (U,) camera that sees the beginning and the end of each
    entries : (A,) arcs on which a target may begin
    anywhere : whether it may begin anywhere on them, or at their starts only
    """

    length: Array
    successor_ptr: IntArray
    successor: IntArray
    arc: IntArray
    start: Array
    end: Array
    first: IntArray
    last: IntArray
    entries: BoolArray
    anywhere: bool = True


@dataclass(frozen=True, eq=False)
class UnseenWays:
    """The longest unseen stretches by kind, in the unit of the arcs; the length is 0 where there is none.

    Attributes
    ----------
    longest : (length, kind, camera before or -1, camera after or -1) of the longest stretch of any kind
    into_first : the same of the longest way into a first view
    never_seen : total length of the arcs of which nothing is seen and that a target can reach
    some_seen : whether any reachable arc is seen
    circle : an arc of an unseen circle that can be reached; -1: none
    reachable : (A,) arcs that a target can reach from an entry
    """

    longest: tuple[float, str, int, int]
    into_first: tuple[float, str, int, int]
    never_seen: float
    some_seen: bool
    circle: int
    reachable: BoolArray

    def way(self, per_m: float = 1.0, *, names: list[str], target: str = "", reason: str = "") -> UnseenWay:
        """Return the longest stretch as a record; ``per_m`` s/m turns its metres into seconds."""
        length, kind, before, after = self.longest
        return UnseenWay(
            kind,
            length,
            length * per_m,
            names[before] if before >= 0 else None,
            names[after] if after >= 0 else None,
            target,
            reason,
        )


def longest_unseen(x: SeenArcs) -> UnseenWays:
    """Return the longest unseen stretches of any walk from an entry."""
    n = len(x.length)
    reach = _reachable(x)
    ptr = np.searchsorted(x.arc, np.arange(n + 1))
    unseen = ptr[1:] == ptr[:-1]
    head = np.where(unseen, x.length, 0.0)
    head[~unseen] = x.start[ptr[:-1][~unseen]]
    ahead, goal = _ahead(x, head, unseen, ptr)
    none = (0.0, "", -1, -1)
    best, into = none, none
    for k in range(len(x.arc)):
        a = int(x.arc[k])
        if not reach[a]:
            continue
        if k + 1 < int(ptr[a + 1]):
            gap = float(x.start[k + 1] - x.end[k])
            found = (gap, "between views", int(x.last[k]), int(x.first[k + 1]))
        else:
            found = _onward(x, a, k, ahead, goal)
        best = max(best, found)
        if x.anywhere and x.entries[a] and found[3] >= 0:
            into = max(into, (found[0], "into the first view", -1, found[3]))
    for a in np.flatnonzero(x.entries & reach).tolist():
        kind = "into the first view" if goal[a] >= 0 else "never seen"
        entry = (float(ahead[a]), kind, -1, int(goal[a]))
        into = max(into, entry)
    best = max(best, into) if into[0] > best[0] else best
    circles = np.flatnonzero(reach & unseen & np.isinf(ahead))
    return UnseenWays(
        best,
        into,
        float(x.length[reach & unseen].sum()),
        bool((reach & ~unseen).any()),
        int(circles[0]) if len(circles) else -1,
        reach,
    )


def _onward(x: SeenArcs, a: int, k: int, ahead: Array, goal: IntArray) -> tuple[float, str, int, int]:
    """Return the longest unseen way behind the last view of an arc."""
    tail = float(x.length[a] - x.end[k])
    ways = x.successor[x.successor_ptr[a] : x.successor_ptr[a + 1]]
    if len(ways) == 0:
        return tail, "after the last view", int(x.last[k]), -1
    b = int(ways[int(np.argmax(ahead[ways]))])
    kind = "between views" if goal[b] >= 0 else "after the last view"
    return tail + float(ahead[b]), kind, int(x.last[k]), int(goal[b])


def _reachable(x: SeenArcs) -> BoolArray:
    reach = x.entries.copy()
    waiting = np.flatnonzero(reach).tolist()
    while waiting:
        a = waiting.pop()
        for b in x.successor[x.successor_ptr[a] : x.successor_ptr[a + 1]].tolist():
            if not reach[b]:
                reach[b] = True
                waiting.append(b)
    return reach


def _ahead(x: SeenArcs, head: Array, unseen: BoolArray, ptr: IntArray) -> tuple[Array, IntArray]:
    """Return F (A,) and the camera (A,) that ends the longest way (-1: it leaves the network or never ends)."""
    n = len(x.length)
    ahead = np.where(unseen, math.inf, head)
    goal = np.full(n, -1, dtype=np.int64)
    goal[~unseen] = x.first[ptr[:-1][~unseen]]
    before: list[list[int]] = [[] for _ in range(n)]
    waiting = np.diff(x.successor_ptr).astype(np.int64)
    for a in np.flatnonzero(unseen).tolist():
        for b in x.successor[x.successor_ptr[a] : x.successor_ptr[a + 1]].tolist():
            before[b].append(a)
    done = np.flatnonzero(~unseen | (waiting == 0)).tolist()
    while done:
        b = done.pop()
        if unseen[b]:
            ways = x.successor[x.successor_ptr[b] : x.successor_ptr[b + 1]]
            far = int(ways[int(np.argmax(ahead[ways]))]) if len(ways) else -1
            ahead[b] = head[b] + (float(ahead[far]) if far >= 0 else 0.0)
            goal[b] = goal[far] if far >= 0 else -1
        for a in before[b]:
            waiting[a] -= 1
            if waiting[a] == 0:
                done.append(a)
    return ahead, goal
