"""Unseen ways that are too long, for a choice among candidate cameras (``design``)."""

from __future__ import annotations

import itertools

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import merge_coverage
from camnet.certification.road_gaps_kernel import merge_intervals
from camnet.certification.way_search_kernel import lightest_ways, way_cameras
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Way", "WaySearch", "coverage_rows", "usable_coverage"]

#: stretches closer than this (m) are one
_TOUCH_M = 1e-6
#: a way is too long if it exceeds the limit by this much, m
_SLACK_M = 1e-6
#: ways that the search for a light one looks at from one start
_MOST_LABELS = 20_000
#: parts of arcs: arc, from, to (m)
Way = tuple[tuple[int, float, float], ...]


def usable_coverage(roads: RoadArcs, coverage: Coverage, least_m: float) -> Coverage:
    """Join each camera's view over the pieces of an arc, and keep stretches of at least ``least_m``."""
    c = coverage
    o = np.lexsort((c.start_m, c.arc, c.camera))
    key, camera, _, start, end, depth, at, n = merge_intervals(
        (c.camera * roads.n_arcs + c.arc)[o],
        c.camera[o],
        c.start_m[o],
        c.end_m[o],
        c.depth_m[o],
        c.deepest_m[o],
        _TOUCH_M,
    )
    joined = Coverage(key[:n] % roads.n_arcs, camera[:n], start[:n], end[:n], depth[:n], at[:n])
    kept = coverage_rows(joined, joined.end_m - joined.start_m >= least_m)
    return coverage_rows(kept, np.lexsort((kept.start_m, kept.arc)))


def coverage_rows(c: Coverage, keep: BoolArray | IntArray) -> Coverage:
    """Return some rows of a coverage."""
    return Coverage(
        c.arc[keep], c.camera[keep], c.start_m[keep], c.end_m[keep], c.depth_m[keep], c.deepest_m[keep]
    )


class WaySearch:
    """Searches a network for unseen ways longer than a limit.

    Parameters
    ----------
    roads : the network
    usable : what each candidate sees, sorted by arc and start (``usable_coverage``)
    cameras : number of candidates, standing ones included
    limit_m : longest unseen way allowed, m
    standing : cameras that are there whatever is chosen
    """

    def __init__(
        self,
        roads: RoadArcs,
        usable: Coverage,
        cameras: int,
        limit_m: float,
        standing: IntArray | None = None,
    ) -> None:
        self.roads, self.usable, self.limit_m = roads, usable, limit_m
        self.standing: IntArray = np.zeros(0, dtype=np.int64) if standing is None else standing
        self._cameras = cameras
        self.ptr = _by_arc(roads, usable)
        ends = np.concatenate([usable.end_m, np.zeros(roads.n_arcs)])
        starts = np.stack([np.concatenate([usable.arc, np.arange(roads.n_arcs)]), ends], axis=1)
        self._starts = np.unique(starts, axis=0)

    def cameras_on(self, way: Way) -> set[int]:
        """Return the candidates that see a part of a way."""
        return self._rows(_as_arrays([way]))[0]

    def violations(self, chosen: IntArray, survive: int = 0) -> list[Way]:
        """One unseen way longer than the limit for each place where one can begin: ends of views, starts of arcs.

        With ``survive`` the ways that are too long after so many cameras fail, chosen or standing, whichever they are.
        """
        there = np.union1d(chosen, self.standing)
        ways = self._violations(there)
        if ways or survive == 0:
            return ways
        failures = itertools.combinations(there.tolist(), min(survive, len(there)))
        found = [way for failed in failures for way in self._violations(np.setdiff1d(there, failed))]
        return list(dict.fromkeys(found))

    def _violations(self, there: IntArray) -> list[Way]:
        coverage = coverage_rows(self.usable, np.isin(self.usable.camera, there))
        ptr = _by_arc(self.roads, coverage)
        arc = np.arange(self.roads.n_arcs)
        s = np.zeros(len(arc))
        if len(coverage.arc):
            seen = merge_coverage(self.roads, coverage)
            arc, s = np.concatenate([arc, seen.arc]), np.concatenate([s, seen.end_m])
        ones = np.ones(self._cameras)
        found = self._lightest(ptr, coverage, ones, arc, s, 0.5, first_only=True, most_labels=0)
        way_ptr, on, begin, end, _ = found
        parts = list(zip(on.tolist(), begin.tolist(), end.tolist(), strict=True))
        ways = [tuple(p for p in parts[a:b] if p[2] > p[1]) for a, b in itertools.pairwise(way_ptr.tolist())]
        return [way for way in ways if way]

    def light_rows(self, weight: Array, below: float, most_starts: int) -> list[tuple[float, set[int]]]:
        """Return sets of candidates that weigh less than ``below`` and see a way that is too long, with their weights.

        One at most for each of ``most_starts`` places where such a way can begin; not all there are.
        """
        stride = -(-len(self._starts) // most_starts)
        arc, s = self._starts[::stride].T
        found = self._lightest(
            self.ptr, self.usable, weight, arc.astype(np.int64), s, below, first_only=False,
            most_labels=_MOST_LABELS,
        )  # fmt: skip
        return list(zip(found[4].tolist(), self._rows(found[:4]), strict=True))

    def _lightest(
        self,
        ptr: IntArray,
        coverage: Coverage,
        weight: Array,
        arc: IntArray,
        s: Array,
        below: float,
        *,
        first_only: bool,
        most_labels: int,
    ) -> tuple[IntArray, IntArray, Array, Array, Array]:
        r, c = self.roads, coverage
        found: tuple[IntArray, IntArray, Array, Array, Array] = lightest_ways(
            r.successor_ptr, r.successor, r.length_m, ptr, c.start_m, c.end_m, c.camera, weight,
            arc, np.ascontiguousarray(s), self.limit_m, _SLACK_M, below, first_only, most_labels,
        )  # fmt: skip
        return found

    def _rows(self, ways: tuple[IntArray, IntArray, Array, Array]) -> list[set[int]]:
        c = self.usable
        ptr, camera = way_cameras(self.ptr, c.start_m, c.end_m, c.camera, self._cameras, *ways, _SLACK_M)
        return [set(camera[a:b].tolist()) for a, b in itertools.pairwise(ptr.tolist())]


def _as_arrays(ways: list[Way]) -> tuple[IntArray, IntArray, Array, Array]:
    parts = [part for way in ways for part in way]
    arc = np.array([p[0] for p in parts], dtype=np.int64)
    begin, end = (np.array([p[k] for p in parts], dtype=float) for k in (1, 2))
    return np.cumsum([0, *map(len, ways)]).astype(np.int64), arc, begin, end


def _by_arc(roads: RoadArcs, coverage: Coverage) -> IntArray:
    return np.searchsorted(coverage.arc, np.arange(roads.n_arcs + 1)).astype(np.int64)
