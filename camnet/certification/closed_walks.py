r"""Closed walks and how many cameras they need: inequalities that the rows of a hitting set do not know.

Whoever goes round for ever meets one unseen gap, L at most, after each stretch in view. The fewest stretches t that
keep all gaps of a closed walk so short follow from one jump after another: from each stretch to the one that ends last
of those that begin within L of its end. With k_c stretches of camera c on the walk, every certified set keeps

    sum_c k_c x_c >= t.

Windows of length L alone say less: round a block of 1000 m they ask for 3.2 cameras where L = 300 m, and four are
needed.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from camnet.certification.hitting_set import Inequality
from camnet.certification.way_search import WaySearch
from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray, IntArray

__all__ = ["LONGEST", "WalkSearch", "broken_walks", "fewest_stretches"]

#: closed walks are looked for up to these multiples of the longest unseen way, in turn
LONGEST = (1.5, 2.2, 3.2, 4.2)
#: arcs tried from each first arc, closed walks kept of each
_STEPS, _PER_ROOT = 20_000, 10
#: share of an inequality's sum that must be missing
_LEAST_SHORT = 1e-3
#: a gap may exceed the limit by this much, m; stretches closer than this are one
_SLACK_M = 1e-6


@cached_njit
def broken_walks(
    ptr: IntArray,
    successor: IntArray,
    length: Array,
    row_ptr: IntArray,
    row_start: Array,
    row_end: Array,
    row_camera: IntArray,
    weight: Array,
    limit: float,
    longest: float,
    steps: int,
    per_root: int,
) -> tuple[IntArray, IntArray]:
    """Find closed walks, no arc twice, whose stretches in view weigh less than the fewest that they need.

    ``longest`` bounds their length (m), ``steps`` the arcs tried from each first arc, ``per_root`` the walks kept of
    it. Walk k is ``arcs[walk_ptr[k]:walk_ptr[k + 1]]``.
    """
    n = len(length)
    walk_ptr, arcs = np.zeros(n * per_root + 1, np.int64), np.empty(1024, np.int64)
    found = 0
    home, queue, waiting = np.empty(n), np.empty(n + 1, np.int64), np.zeros(n, np.bool_)
    back_ptr, back = _reversed(ptr, successor, n)
    path, turn = np.empty(n + 1, np.int64), np.empty(n + 1, np.int64)
    gone, heavy = np.zeros(n + 2), np.zeros(n + 2)
    met, on = np.zeros(len(weight), np.int64), np.zeros(n, np.bool_)
    for root in range(n):
        _ways_home(root, length, back_ptr, back, longest, home, queue, waiting)
        if home[root] == np.inf:
            continue
        depth, left, until = 0, steps, found + per_root
        path[0], turn[0], on[root], gone[1] = root, ptr[root], True, length[root]
        heavy[1] = _meet(root, row_ptr, row_camera, weight, met, 1)
        while depth >= 0:
            a = path[depth]
            if left <= 0 or found >= until or turn[depth] == ptr[a + 1]:
                _meet(a, row_ptr, row_camera, weight, met, -1)
                on[a] = False
                depth -= 1
                continue
            b = successor[turn[depth]]
            turn[depth] += 1
            if b == root:
                # hardly ever are more needed than one for each three quarters of the limit, and one
                if np.floor(heavy[depth + 1] + 2e-3) > gone[depth + 1] / (0.75 * limit):
                    continue
                walk = path[: depth + 1]
                _, least, short = fewest_stretches(
                    walk, length, row_ptr, row_start, row_end, row_camera, weight, limit
                )
                if least > 0 and short > 1e-3:
                    k = walk_ptr[found]
                    if k + depth + 1 > len(arcs):
                        bigger = np.empty(2 * (k + depth + 1), np.int64)
                        bigger[:k] = arcs[:k]
                        arcs = bigger
                    arcs[k : k + depth + 1] = walk
                    found += 1
                    walk_ptr[found] = k + depth + 1
                continue
            if b < root or on[b] or gone[depth + 1] + length[b] + home[b] > longest:
                continue
            left -= 1
            depth += 1
            path[depth], turn[depth], on[b] = b, ptr[b], True
            gone[depth + 1] = gone[depth] + length[b]
            heavy[depth + 1] = heavy[depth] + _meet(b, row_ptr, row_camera, weight, met, 1)
    return walk_ptr[: found + 1], arcs[: walk_ptr[found]]


@cached_njit
def _ways_home(
    root: int,
    length: Array,
    back_ptr: IntArray,
    back: IntArray,
    longest: float,
    home: Array,
    queue: IntArray,
    waiting: BoolArray,
) -> None:
    """Write into ``home`` the shortest way from the end of each arc to the start of ``root``, over no arc before it."""
    n = len(length)
    home[:] = np.inf
    head, tail = 0, 0
    for t in range(back_ptr[root], back_ptr[root + 1]):
        if back[t] >= root:
            home[back[t]], queue[tail], waiting[back[t]] = 0.0, back[t], True
            tail = (tail + 1) % (n + 1)
    while head != tail:
        a = queue[head]
        head = (head + 1) % (n + 1)
        waiting[a] = False
        if home[a] + length[a] > longest:
            continue
        for t in range(back_ptr[a], back_ptr[a + 1]):
            b = back[t]
            if b >= root and home[a] + length[a] < home[b] - 1e-12:
                home[b] = home[a] + length[a]
                if not waiting[b]:
                    waiting[b], queue[tail] = True, b
                    tail = (tail + 1) % (n + 1)


@cached_njit
def _meet(
    arc: int, row_ptr: IntArray, row_camera: IntArray, weight: Array, met: IntArray, sign: int
) -> float:
    """Count the cameras of an arc in or out; returns what the new ones weigh."""
    new = 0.0
    for r in range(row_ptr[arc], row_ptr[arc + 1]):
        c = row_camera[r]
        if sign > 0 and met[c] == 0:
            new += weight[c]
        met[c] += sign
    return new


@cached_njit
def _reversed(ptr: IntArray, successor: IntArray, n: int) -> tuple[IntArray, IntArray]:
    back_ptr = np.zeros(n + 1, np.int64)
    for t in range(len(successor)):
        back_ptr[successor[t] + 1] += 1
    back_ptr = np.cumsum(back_ptr)
    fill = back_ptr[:-1].copy()
    back = np.empty(len(successor), np.int64)
    for a in range(n):
        for t in range(ptr[a], ptr[a + 1]):
            b = successor[t]
            back[fill[b]] = a
            fill[b] += 1
    return back_ptr, back


@cached_njit
def fewest_stretches(
    arcs: IntArray,
    length: Array,
    row_ptr: IntArray,
    row_start: Array,
    row_end: Array,
    row_camera: IntArray,
    x: Array,
    limit: float,
) -> tuple[IntArray, int, float]:
    """Return the cameras of a closed walk's stretches (one entry for each), and the fewest that are needed.

    The last result is the share of that number which ``x`` lacks, 0 at least. The fewest are 0 where no choice will
    do.
    """
    camera, start, end, whole = _stretches(arcs, length, row_ptr, row_start, row_end, row_camera)
    n = len(camera)
    met = 0.0
    for i in range(n):
        met += x[camera[i]]
    # over two laps: of the stretches up to each, the one that ends last
    begins = np.concatenate((start, start + whole))
    ends = np.concatenate((end, end + whole))
    last = np.arange(2 * n)
    for j in range(1, 2 * n):
        if ends[last[j - 1]] >= ends[j]:
            last[j] = last[j - 1]
    best = n + 1
    within = limit + _SLACK_M + (max(0.0, end.max() - whole) if n else 0.0)
    for first in range(n):
        if start[first] > within:  # the first stretch of every choice begins before
            break
        count, i, lap = 1, first, 0.0
        while ends[i] + lap + limit + _SLACK_M < start[first] + whole and count < best:
            j = np.searchsorted(begins, ends[i] + limit + _SLACK_M, side="right") - 1
            if ends[last[j]] <= ends[i] + 1e-9:
                count = n + 1
                break
            i = last[j]
            if i >= n:
                i, lap = i - n, lap + whole
            count += 1
        best = min(best, count)
    if n == 0 or best > n:
        return camera, 0, 0.0
    return camera, best, max(0.0, (best - met) / best)


@cached_njit
def _stretches(
    arcs: IntArray, length: Array, row_ptr: IntArray, row_start: Array, row_end: Array, row_camera: IntArray
) -> tuple[IntArray, Array, Array, float]:
    """Return camera, start and end (m from the walk's start) of each stretch in view, sorted by start, and the length.

    What goes on over an arc's end is one stretch; over the walk's end too, whose end is then beyond the length.
    """
    size = 0
    for a in arcs:
        size += row_ptr[a + 1] - row_ptr[a]
    camera, start, end = np.empty(size, np.int64), np.empty(size), np.empty(size)
    n, before, here, whole = 0, 0, 0, 0.0
    for a in arcs:
        before, here = here, n  # stretches of the arc before: before..here
        for r in range(row_ptr[a], row_ptr[a + 1]):
            joined = False
            if row_start[r] <= _SLACK_M:
                for i in range(before, here):
                    if camera[i] == row_camera[r] and end[i] >= whole - _SLACK_M:
                        end[i], joined = whole + row_end[r], True
                        if row_end[r] >= length[a] - _SLACK_M:  # it may go on over the next arc too
                            camera[n], start[n], end[n] = camera[i], start[i], end[i]
                            end[i] = start[i] - 1.0
                            n += 1
                        break
            if not joined:
                camera[n], start[n], end[n] = row_camera[r], whole + row_start[r], whole + row_end[r]
                n += 1
        whole += length[a]
    for i in range(n):  # over the walk's end
        if end[i] >= max(start[i], whole - _SLACK_M):
            for j in range(n):
                if j != i and camera[j] == camera[i] and start[j] <= _SLACK_M and end[j] >= start[j]:
                    end[i] = max(end[i], whole + end[j])
                    end[j] = start[j] - 1.0
                    break
    kept = np.flatnonzero(end[:n] >= start[:n])
    kept = kept[np.argsort(start[:n][kept])]
    return camera[kept], start[kept], end[kept], whole


class WalkSearch:
    """Looks for inequalities of closed walks that a solution of the linear programme breaks.

    Parameters
    ----------
    search : the ways, with what each candidate sees
    survive : cameras that may fail
    """

    def __init__(self, search: WaySearch, survive: int) -> None:
        self._search, self._survive = search, survive

    def broken(self, x: Array, longest: float, most: int) -> list[Inequality]:
        """Return at most so many inequalities that ``x`` breaks, of walks up to ``longest`` times the limit."""
        of, seen = self._search.roads, self._search.usable
        share = x.copy()
        share[self._search.standing] = 1.0
        views = (self._search.ptr, seen.start_m, seen.end_m, seen.camera, share, self._search.limit_m)
        walk_ptr, arcs = broken_walks(
            of.successor_ptr,
            of.successor,
            of.length_m,
            *views,
            longest * self._search.limit_m,
            _STEPS,
            _PER_ROOT,
        )
        found = []
        for a, b in pairwise(walk_ptr.tolist()):
            camera, least, short = fewest_stretches(arcs[a:b], of.length_m, *views)
            if short > _LEAST_SHORT:
                found.append((short, self._inequality(camera, least)))
        found.sort(key=lambda of: -of[0])
        return [inequality for _, inequality in found[:most]]

    def _inequality(self, camera: IntArray, least: int) -> Inequality:
        """Leave out standing cameras; any so many that fail take a stretch each at least."""
        cameras, stretches = np.unique(camera, return_counts=True)
        stands = np.isin(cameras, self._search.standing)
        right = least + self._survive - stretches[stands].sum()
        return cameras[~stands], stretches[~stands].astype(float), float(right)
