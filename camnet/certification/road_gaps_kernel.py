"""Compiled searches over unseen roads; see ``road_gaps`` for what they mean.

Arcs are numbered as in ``RoadArcs``. ``first`` holds the first seen interval of each arc (-1: none), ``head`` the
unseen length before it (the whole length if there is none).
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, IntArray

__all__ = ["gap_search", "merge_intervals", "seen_lengths"]


@cached_njit
def merge_intervals(
    arc: IntArray, camera: IntArray, start: Array, end: Array, depth: Array, deepest: Array, touch: float
) -> tuple[IntArray, IntArray, IntArray, Array, Array, Array, Array, int]:
    """Join overlapping intervals of one arc (sorted by arc and start).

    Returns arc, entry camera, exit camera, start, end, depth, deepest of each union, and their number.
    """
    n = len(arc)
    out_arc, entry, leave = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    s0, s1, d, at = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    m = 0
    for i in range(n):
        if m > 0 and out_arc[m - 1] == arc[i] and start[i] <= s1[m - 1] + touch:
            if end[i] > s1[m - 1]:
                s1[m - 1], leave[m - 1] = end[i], camera[i]
            if depth[i] > d[m - 1]:
                d[m - 1], at[m - 1] = depth[i], deepest[i]
            continue
        out_arc[m], entry[m], leave[m] = arc[i], camera[i], camera[i]
        s0[m], s1[m], d[m], at[m] = start[i], end[i], depth[i], deepest[i]
        m += 1
    return out_arc, entry, leave, s0, s1, d, at, m


@cached_njit
def seen_lengths(ptr: IntArray, successor: IntArray, length: Array, prefix: Array, full: IntArray) -> Array:
    """Shortest seen length ahead at each arc's start: ``prefix`` where the view ends within the arc.

    ``full`` marks arcs in view from start to end: they add the least of their successors. Repeated sweeps settle
    to the shortest paths; arcs from which the view never ends keep infinity.
    """
    out = np.where(full == 1, np.inf, prefix)
    changed = True
    while changed:
        changed = False
        for a in range(len(length) - 1, -1, -1):
            if full[a] == 0:
                continue
            best = np.inf
            for t in range(ptr[a], ptr[a + 1]):
                best = min(best, out[successor[t]])
            value = length[a] + best
            if value < out[a] - 1e-12:
                out[a] = value
                changed = True
    return out


@cached_njit
def gap_search(
    ptr: IntArray,
    successor: IntArray,
    head: Array,
    first: IntArray,
    exit_arc: IntArray,
    exit_left: Array,
    search_m: float,
) -> tuple[IntArray, IntArray, Array, Array, IntArray]:
    """Follow unseen roads from exits that reach the end of their arc unseen.

    ``exit_left`` is the unseen length between the exit and its arc's end. Returns rows (exit, interval, shortest,
    longest) and for each exit a code: bit 1: some branch leaves the network, bit 2: unseen cycle, bit 4: the search
    stopped at ``search_m``, bit 8: a junction with several ways is unseen. The longest path to an interval beyond an
    unseen cycle is infinite.
    """
    n_arcs, n_exits = len(head), len(exit_arc)
    capacity = max(64, 4 * n_exits)
    row_exit, row_to = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    row_short, row_long = np.empty(capacity), np.empty(capacity)
    rows = 0
    code = np.zeros(n_exits, np.int64)
    mark = np.full(n_arcs, -1, np.int64)
    short, far = np.empty(n_arcs), np.empty(n_arcs)
    degree, waiting = np.zeros(n_arcs, np.int64), np.zeros(n_arcs, np.int64)
    members, queue = np.empty(n_arcs, np.int64), np.empty(n_arcs + 1, np.int64)
    for e in range(n_exits):
        count, qh, qt = 0, 0, 0
        if ptr[exit_arc[e]] == ptr[exit_arc[e] + 1]:
            code[e] |= 1
        if ptr[exit_arc[e] + 1] - ptr[exit_arc[e]] > 1:
            code[e] |= 8
        for t in range(ptr[exit_arc[e]], ptr[exit_arc[e] + 1]):
            a = successor[t]
            if mark[a] != e:
                mark[a] = e
                short[a], far[a], degree[a], waiting[a] = exit_left[e], -np.inf, 0, 1
                members[count] = a
                count += 1
                queue[qt] = a
                qt = (qt + 1) % (n_arcs + 1)
        # shortest distances by label correction over unseen arcs
        while qh != qt:
            a = queue[qh]
            qh = (qh + 1) % (n_arcs + 1)
            waiting[a] = 0
            if first[a] >= 0:
                continue
            reach = short[a] + head[a]
            if reach > search_m:
                code[e] |= 4
                continue
            if ptr[a] == ptr[a + 1]:
                code[e] |= 1
            if ptr[a + 1] - ptr[a] > 1:
                code[e] |= 8
            for t in range(ptr[a], ptr[a + 1]):
                b = successor[t]
                if mark[b] != e:
                    mark[b] = e
                    short[b], far[b], degree[b], waiting[b] = np.inf, -np.inf, 0, 0
                    members[count] = b
                    count += 1
                if reach < short[b] - 1e-12:
                    short[b] = reach
                    if waiting[b] == 0:
                        waiting[b] = 1
                        queue[qt] = b
                        qt = (qt + 1) % (n_arcs + 1)
        # longest distances in topological order; what is left over lies on or behind a cycle
        for i in range(count):
            a = members[i]
            if first[a] < 0 and short[a] + head[a] <= search_m:
                for t in range(ptr[a], ptr[a + 1]):
                    degree[successor[t]] += 1
        for t in range(ptr[exit_arc[e]], ptr[exit_arc[e] + 1]):
            far[successor[t]] = exit_left[e]
        qh, qt, done = 0, 0, 0
        for i in range(count):
            if degree[members[i]] == 0:
                queue[qt] = members[i]
                qt += 1
        while qh < qt:
            a = queue[qh]
            qh += 1
            done += 1
            degree[a] = -1
            if first[a] >= 0 or short[a] + head[a] > search_m:
                continue
            for t in range(ptr[a], ptr[a + 1]):
                b = successor[t]
                far[b] = max(far[b], far[a] + head[a])
                degree[b] -= 1
                if degree[b] == 0:
                    queue[qt] = b
                    qt += 1
        if done < count:
            code[e] |= 2
        for i in range(count):
            a = members[i]
            if first[a] < 0:
                continue
            if rows == capacity:
                capacity *= 2
                row_exit, row_to = _grow(row_exit, capacity), _grow(row_to, capacity)
                row_short, row_long = _grow(row_short, capacity), _grow(row_long, capacity)
            row_exit[rows], row_to[rows] = e, first[a]
            row_short[rows] = short[a] + head[a]
            row_long[rows] = far[a] + head[a] if degree[a] == -1 else np.inf
            rows += 1
    return row_exit[:rows], row_to[:rows], row_short[:rows], row_long[:rows], code


@cached_njit
def _grow(values, capacity):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202 - generic over the dtype
    out = np.empty(capacity, values.dtype)
    out[: len(values)] = values
    return out
