"""Compiled search for long ways that few, or light, cameras see; see ``way_search`` for what they mean.

Rows are the stretches that candidates see, sorted by arc: those of arc a are ``row_ptr[a]:row_ptr[a + 1]``. A *label*
is a way from a start up to the beginning of an arc: how far it is, and what the cameras on it weigh.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, IntArray

__all__ = ["lightest_ways", "way_cameras"]

#: overlaps shorter than this (m) are contact
_CONTACT_M = 1e-9


@cached_njit
def lightest_ways(
    ptr: IntArray,
    successor: IntArray,
    length: Array,
    row_ptr: IntArray,
    row_start: Array,
    row_end: Array,
    row_camera: IntArray,
    weight: Array,
    start_arc: IntArray,
    start_s: Array,
    limit: float,
    slack: float,
    below: float,
    first_only: bool,
    most_labels: int,
) -> tuple[IntArray, IntArray, Array, Array, Array]:
    """Find from each start a way of length ``limit + slack`` whose cameras weigh least, if that is less than ``below``.

    A camera counts once on each way. With ``first_only`` any such way will do. ``most_labels`` ends the search of one
    start (0: never); what it found until then is kept.

    Returns
    -------
    tuple
        ``way_ptr`` (K + 1,); arc, from and to (m) of each part: way k has ``way_ptr[k]:way_ptr[k + 1]``; weights (K,).
    """
    n_arcs = len(length)
    size = 1024
    at, parent = np.empty(size, np.int64), np.empty(size, np.int64)
    entry, gone, heavy = np.empty(size), np.empty(size), np.empty(size)
    before = np.empty(size, np.int64)  # label of the same arc that came before
    dead = np.zeros(size, np.uint8)
    newest, stamp = np.full(n_arcs, -1, np.int64), np.full(n_arcs, -1, np.int64)
    mark = np.full(len(weight), -1, np.int64)
    marks = 0
    out_ptr, out_weight = np.zeros(len(start_arc) + 1, np.int64), np.empty(len(start_arc))
    parts = 0
    out_arc, out_from, out_to = np.empty(size, np.int64), np.empty(size), np.empty(size)
    ways = 0
    whole = limit + slack
    for k in range(len(start_arc)):
        count, best, best_weight = 1, -1, below
        at[0], entry[0], gone[0], heavy[0], parent[0], dead[0], before[0] = (
            start_arc[k],
            start_s[k],
            0.0,
            0.0,
            -1,
            0,
            -1,
        )
        i = -1
        while i + 1 < count:
            i += 1
            if dead[i] or heavy[i] >= best_weight - 1e-9:
                continue
            if most_labels and count > most_labels:
                break
            # cameras that the way up to here has met
            marks += 1
            j = parent[i]
            to = 0.0
            while j >= 0:
                to = length[at[j]]
                for r in range(row_ptr[at[j]], row_ptr[at[j] + 1]):
                    if row_start[r] < to - _CONTACT_M and row_end[r] > entry[j] + _CONTACT_M:
                        mark[row_camera[r]] = marks
                j = parent[j]
            a = at[i]
            left = whole - gone[i]
            ends = entry[i] + left <= length[a]
            to = entry[i] + left if ends else length[a]
            w = heavy[i]
            for r in range(row_ptr[a], row_ptr[a + 1]):
                c = row_camera[r]
                if mark[c] != marks and row_start[r] < to - _CONTACT_M and row_end[r] > entry[i] + _CONTACT_M:
                    mark[c] = marks
                    w += weight[c]
                    if w >= best_weight - 1e-9:
                        break
            if w >= best_weight - 1e-9:
                continue
            if ends:
                best, best_weight = i, w
                if first_only:
                    break
                continue
            reach = gone[i] + to - entry[i]
            for t in range(ptr[a], ptr[a + 1]):
                b = successor[t]
                if stamp[b] != k:
                    stamp[b], newest[b] = k, -1
                j, worse = newest[b], False
                while j >= 0:
                    if gone[j] >= reach - _CONTACT_M and heavy[j] <= w + 1e-12:
                        worse = True
                        break
                    if gone[j] <= reach and heavy[j] >= w:
                        dead[j] = 1
                    j = before[j]
                if worse:
                    continue
                if count == size:
                    size *= 2
                    at, parent, before = _more(at, size), _more(parent, size), _more(before, size)
                    entry, gone, heavy, dead = (
                        _more(entry, size),
                        _more(gone, size),
                        _more(heavy, size),
                        _more(dead, size),
                    )
                at[count], entry[count], gone[count], heavy[count], parent[count], dead[count] = (
                    b,
                    0.0,
                    reach,
                    w,
                    i,
                    0,
                )
                before[count], newest[b] = newest[b], count
                count += 1
        if best < 0:
            continue
        depth, j = 0, best
        while j >= 0:
            depth += 1
            j = parent[j]
        while parts + depth > len(out_arc):
            out_arc = _more(out_arc, 2 * len(out_arc))
            out_from, out_to = _more(out_from, 2 * len(out_from)), _more(out_to, 2 * len(out_to))
        j = best
        for d in range(depth - 1, -1, -1):
            out_arc[parts + d], out_from[parts + d] = at[j], entry[j]
            out_to[parts + d] = entry[j] + limit - gone[j] if d == depth - 1 else length[at[j]]
            j = parent[j]
        parts += depth
        out_weight[ways] = best_weight
        ways += 1
        out_ptr[ways] = parts
    return out_ptr[: ways + 1], out_arc[:parts], out_from[:parts], out_to[:parts], out_weight[:ways]


@cached_njit
def way_cameras(
    row_ptr: IntArray,
    row_start: Array,
    row_end: Array,
    row_camera: IntArray,
    cameras: int,
    way_ptr: IntArray,
    arc: IntArray,
    start: Array,
    end: Array,
    slack: float,
) -> tuple[IntArray, IntArray]:
    """Return the cameras that see a part of each way: ``found[ptr[k]:ptr[k + 1]]``, unsorted, each once.

    ``slack`` is looked at beyond each part that ends a way.
    """
    mark = np.full(cameras, -1, np.int64)
    out_ptr, out = np.zeros(len(way_ptr), np.int64), np.empty(1024, np.int64)
    n = 0
    for k in range(len(way_ptr) - 1):
        for p in range(way_ptr[k], way_ptr[k + 1]):
            to = end[p] + (slack if p == way_ptr[k + 1] - 1 else 0.0)
            for r in range(row_ptr[arc[p]], row_ptr[arc[p] + 1]):
                c = row_camera[r]
                if mark[c] != k and row_start[r] < to - _CONTACT_M and row_end[r] > start[p] + _CONTACT_M:
                    mark[c] = k
                    if n == len(out):
                        out = _more(out, 2 * n)
                    out[n] = c
                    n += 1
        out_ptr[k + 1] = n
    return out_ptr, out[:n]


@cached_njit
def _more(values, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202 - generic over the dtype
    out = np.empty(size, values.dtype)
    out[: len(values)] = values
    return out
