r"""Several graphs of ways with their limits as one: every stretch measured in shares of what may be unseen.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| s, t(s) | ``at_m``, ``time_s`` | m, s | way, and latest time from the start of an arc |
| L, T | ``limit_m``, ``limit_s`` | m, s | longest stretch allowed out of view |
| u | | | s / L, or t(s) / T: a stretch is too long where u grows by more than 1 |

A limit in metres and one in seconds ask two questions of the same ways; each is a copy of the graph in its own measure.
Arcs that no target can reach are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.ways import Ways
from camnet.types import Array, BoolArray, IntArray

__all__ = ["LimitedWays", "reachable_arcs", "ways_as_one"]

#: pieces by which an arc's course is told, for distances between cameras
_PIECES = 32


@dataclass(frozen=True, eq=False)
class LimitedWays:
    """Ways, the stretches of them that each camera sees, and what is allowed out of view (None: not limited)."""

    ways: Ways
    coverage: Coverage
    limit_m: float | None
    limit_s: float | None


def reachable_arcs(ways: Ways) -> BoolArray:
    """Return the arcs (A,) that a target can reach from where it may begin."""
    reach = ways.entries.copy()
    waiting = np.flatnonzero(reach).tolist()
    ptr, following = ways.roads.successor_ptr, ways.roads.successor
    while waiting:
        arc = waiting.pop()
        for b in following[ptr[arc] : ptr[arc + 1]].tolist():
            if not reach[b]:
                reach[b] = True
                waiting.append(b)
    return np.asarray(reach)


def ways_as_one(parts: Sequence[LimitedWays]) -> tuple[RoadArcs, Coverage]:
    """Return all graphs in shares of their limits, as one network with what is seen of it."""
    graphs = [
        _scaled(p, in_time) for p in parts for in_time in (False, True) if _limit(p, in_time) is not None
    ]
    arcs = np.cumsum([0, *(roads.n_arcs for roads, _ in graphs)])
    turns = np.cumsum([0, *(len(roads.successor) for roads, _ in graphs)])

    def joined(name: str) -> Array:
        return np.concatenate([getattr(roads, name) for roads, _ in graphs])

    def renumbered(name: str) -> IntArray:
        columns = [getattr(roads, name) + k for (roads, _), k in zip(graphs, arcs.tolist(), strict=False)]
        return np.concatenate(columns).astype(np.int64)

    pieces = len(joined("piece_arc"))
    start, course = joined("start_xy"), joined("direction_xy")
    roads = RoadArcs(
        start,
        course,
        joined("piece_length_m"),
        renumbered("piece_arc"),
        joined("piece_offset_m"),
        joined("length_m"),
        np.concatenate(
            [[0], *(r.successor_ptr[1:] + k for (r, _), k in zip(graphs, turns.tolist(), strict=False))]
        ).astype(np.int64),
        renumbered("successor"),
        np.arange(pieces + 1),
        start,
        course,
    )
    covers = [c for _, c in graphs]
    rows = [np.concatenate([getattr(c, n) for c in covers]) for n in ("camera", "start_m", "end_m")]
    arc = np.concatenate([c.arc + k for c, k in zip(covers, arcs.tolist(), strict=False)])
    order = np.lexsort((rows[1], arc))
    camera, start, end = (row[order] for row in rows)
    return roads, Coverage(arc[order], camera, start, end, np.zeros(len(order)), 0.5 * (start + end))


def _limit(part: LimitedWays, in_time: bool) -> float | None:
    return part.limit_s if in_time else part.limit_m


def _scaled(part: LimitedWays, in_time: bool) -> tuple[RoadArcs, Coverage]:
    """Return one graph in shares of one limit, without the arcs that nobody reaches."""
    ways, seen = part.ways, part.coverage
    limit = _limit(part, in_time)
    assert limit is not None

    def share(arc: IntArray, at_m: Array) -> Array:
        return (ways.time(arc, at_m) if in_time else at_m) / limit

    reach = reachable_arcs(ways)
    number = np.cumsum(reach) - 1
    kept = np.flatnonzero(reach)
    at = np.linspace(0.0, 1.0, _PIECES + 1) * ways.roads.length_m[kept][:, None]
    arc = np.repeat(kept, _PIECES + 1)
    xy = ways.pose(arc, at.ravel())[0].reshape(len(kept), _PIECES + 1, 2)
    u = share(arc, at.ravel()).reshape(at.shape)
    step = np.diff(u, axis=1)
    slope = np.diff(xy, axis=1) / np.maximum(step, 1e-12)[..., None]
    ptr, following = ways.roads.successor_ptr, ways.roads.successor
    after = [number[following[ptr[a] : ptr[a + 1]]] for a in kept.tolist()]
    start, course = xy[:, :-1].reshape(-1, 2), slope.reshape(-1, 2)
    roads = RoadArcs(
        start,
        course,
        step.ravel(),
        np.repeat(np.arange(len(kept)), _PIECES),
        u[:, :-1].ravel(),
        u[:, -1].copy(),
        np.cumsum([0, *map(len, after)]).astype(np.int64),
        np.concatenate([*after, np.zeros(0, dtype=np.int64)]).astype(np.int64),
        np.arange(len(start) + 1),
        start,
        course,
    )
    rows = reach[seen.arc]
    on = seen.arc[rows]
    low, high = share(on, seen.start_m[rows]), share(on, seen.end_m[rows])
    return roads, Coverage(number[on], seen.camera[rows], low, high, np.zeros(len(on)), 0.5 * (low + high))
