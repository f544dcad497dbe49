r"""Gaps between views on a road network: every exit, every entry, shortest and longest unseen way between them.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| l_min, l_max | ``shortest_m``, ``longest_m`` | m | unseen length between an exit and an entry, over all branches |
| chord | ``chord_m`` | m | least seen length ahead of an entry, over all branches |

A target of the road-bound class that leaves a view at an exit is seen again after at most l_max / v_lo, at one of the
listed entries, or leaves the network. l_max is infinite where the unseen roads hold a directed cycle: the target
may go round for ever. The cost is linear in roads and exits where unseen stretches are bounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps_kernel import gap_search, merge_intervals, seen_lengths
from camnet.types import Array, BoolArray, IntArray

__all__ = ["RoadGaps", "SeenStretches", "merge_coverage", "road_gaps"]

#: stretches closer than this (m) are one
_TOUCH_M = 1e-6


@dataclass(frozen=True, eq=False)
class SeenStretches:
    """Unions of overlapping views along arcs, sorted by arc and start.

    Attributes
    ----------
    arc : (U,) arc of each
    entry_camera, exit_camera : (U,) camera that sees its start and its end
    start_m, end_m : (U,) arc lengths, m
    depth_m, deepest_m : (U,) largest ball in a view on the stretch and where, m
    chord_m : (U,) seen length from its start, m, on over junctions by the shortest branch (inf: never ends)
    """

    arc: IntArray
    entry_camera: IntArray
    exit_camera: IntArray
    start_m: Array
    end_m: Array
    depth_m: Array
    deepest_m: Array
    chord_m: Array


@dataclass(frozen=True, eq=False)
class RoadGaps:
    """Transitions of a network.

    Attributes
    ----------
    stretches : what is seen
    exit_stretch, entry_stretch : (T,) stretch that ends and stretch that begins at each transition
    shortest_m, longest_m : (T,) unseen length, m
    exits : (E,) stretches that end unseen
    leaves, cyclic, cut : (E,) whether some branch leaves the network, meets an unseen cycle, exceeds the search
    branches : (T,) whether a junction with several ways lies in the unseen part of a transition
    """

    stretches: SeenStretches
    exit_stretch: IntArray
    entry_stretch: IntArray
    shortest_m: Array
    longest_m: Array
    exits: IntArray
    leaves: BoolArray
    cyclic: BoolArray
    cut: BoolArray
    branches: BoolArray


def merge_coverage(roads: RoadArcs, coverage: Coverage) -> SeenStretches:
    """Join overlapping views of each arc and measure how long the view lasts from each entry."""
    c = coverage
    arc, entry, leave, start, end, depth, at, n = merge_intervals(
        c.arc, c.camera, c.start_m, c.end_m, c.depth_m, c.deepest_m, _TOUCH_M
    )
    arc, start, end = arc[:n], start[:n], end[:n]
    to_end = end >= roads.length_m[arc] - _TOUCH_M
    at_start = start <= _TOUCH_M
    prefix = np.zeros(roads.n_arcs)
    full = np.zeros(roads.n_arcs, dtype=np.int64)
    prefix[arc[at_start]] = (end - start)[at_start]
    full[arc[at_start & to_end]] = 1
    ahead = seen_lengths(roads.successor_ptr, roads.successor, roads.length_m, prefix, full)
    onward = _least_ahead(roads, ahead)
    chord = end - start + np.where(to_end, onward[arc], 0.0)
    return SeenStretches(arc, entry[:n], leave[:n], start, end, depth[:n], at[:n], chord)


def _least_ahead(roads: RoadArcs, ahead: Array) -> Array:
    """Return for each arc the least of its successors' values; infinity where it has none."""
    out = np.full(roads.n_arcs, np.inf)
    owner = np.repeat(np.arange(roads.n_arcs), np.diff(roads.successor_ptr))
    np.minimum.at(out, owner, ahead[roads.successor])
    return out


def road_gaps(roads: RoadArcs, coverage: Coverage, search_m: float = math.inf) -> RoadGaps:
    """Find every transition of a network.

    Parameters
    ----------
    roads, coverage : the network and what is seen of it
    search_m : unseen ways longer than this are not followed; exits with such ways are marked ``cut``
    """
    seen = merge_coverage(roads, coverage)
    n = len(seen.arc)
    first = np.full(roads.n_arcs, -1, dtype=np.int64)
    head = roads.length_m.copy()
    firsts = np.flatnonzero(np.diff(seen.arc, prepend=-1))  # sorted by arc: the first stretch of each
    first[seen.arc[firsts]] = firsts
    head[seen.arc[firsts]] = np.maximum(seen.start_m[firsts], 0.0)
    has_next = np.zeros(n, dtype=bool)
    has_next[:-1] = seen.arc[1:] == seen.arc[:-1]
    inner = np.flatnonzero(has_next)
    inner_gap = seen.start_m[inner + 1] - seen.end_m[inner]
    outer = np.flatnonzero(~has_next)
    left = np.maximum(roads.length_m[seen.arc[outer]] - seen.end_m[outer], 0.0)
    row_exit, row_to, short, far, code = gap_search(
        roads.successor_ptr, roads.successor, head, first, seen.arc[outer], left, search_m
    )
    far = np.where((code & 4 > 0)[row_exit], np.inf, far)  # a way that was not followed may be longer
    unseen = far > _TOUCH_M  # views that meet at a junction make no gap
    row_exit, row_to, short, far = row_exit[unseen], row_to[unseen], short[unseen], far[unseen]
    exits = np.concatenate([inner, outer])
    flags = np.concatenate([np.zeros(len(inner), dtype=np.int64), code])
    return RoadGaps(
        stretches=seen,
        exit_stretch=np.concatenate([inner, outer[row_exit]]),
        entry_stretch=np.concatenate([inner + 1, row_to]),
        shortest_m=np.concatenate([inner_gap, short]),
        longest_m=np.concatenate([inner_gap, far]),
        exits=exits,
        leaves=(flags & 1) > 0,
        cyclic=(flags & 2) > 0,
        cut=(flags & 4) > 0,
        branches=np.concatenate([np.zeros(len(inner), dtype=bool), (code & 8 > 0)[row_exit]]),
    )
