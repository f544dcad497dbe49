"""Unseen ways that are too long, for a choice among candidate cameras (``design``)."""

from __future__ import annotations

import itertools

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import merge_coverage
from camnet.certification.road_gaps_kernel import merge_intervals
from camnet.types import BoolArray, IntArray

__all__ = ["Way", "WaySearch", "coverage_rows", "usable_coverage"]

#: stretches closer than this (m) are one
_TOUCH_M = 1e-6
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
    limit_m : longest unseen way allowed, m
    standing : cameras that are there whatever is chosen
    """

    def __init__(
        self, roads: RoadArcs, usable: Coverage, limit_m: float, standing: IntArray | None = None
    ) -> None:
        self._roads, self._usable, self.limit_m = roads, usable, limit_m
        self.standing: IntArray = np.zeros(0, dtype=np.int64) if standing is None else standing
        self._ptr = _by_arc(roads, usable)

    def cameras_on(self, way: Way) -> set[int]:
        """Return the candidates that see a part of a way."""
        hit: set[int] = set()
        for arc, a, b in way:
            rows = slice(self._ptr[arc], self._ptr[arc + 1])
            meets = (self._usable.start_m[rows] < b - 1e-9) & (self._usable.end_m[rows] > a + 1e-9)
            hit.update(self._usable.camera[rows][meets].tolist())
        return hit

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
        coverage = coverage_rows(self._usable, np.isin(self._usable.camera, there))
        ptr = _by_arc(self._roads, coverage)
        starts = [(arc, 0.0) for arc in range(self._roads.n_arcs)]
        if len(coverage.arc):
            seen = merge_coverage(self._roads, coverage)
            starts += list(zip(seen.arc.tolist(), seen.end_m.tolist(), strict=True))
        ways = (self._from(ptr, coverage, arc, s) for arc, s in starts)
        return [way for way in ways if way]

    def _from(self, ptr: IntArray, coverage: Coverage, start_arc: int, start_m: float) -> Way | None:
        """Find an unseen way of the limit's length by depth-first search; None if every way is seen before.

        A way that ends sooner, where the network ends, is no violation: the target is gone. A state is an arc's start
        reached after a length; one that was reached before after at least as long a way cannot lead further.
        """
        roads, limit = self._roads, self.limit_m
        best: dict[int, float] = {}
        stack: list[tuple[int, float, float, Way]] = [(start_arc, start_m, 0.0, ())]
        while stack:
            arc, s, travelled, way = stack.pop()
            rows = slice(ptr[arc], ptr[arc + 1])
            later = coverage.start_m[rows][coverage.end_m[rows] > s + 1e-9]
            stop = max(float(later.min()), s) if len(later) else float(roads.length_m[arc])
            reach = travelled + stop - s
            part = (*way, (arc, s, min(stop, s + limit - travelled))) if stop > s else way
            if reach > limit + 1e-6:
                return part
            if len(later):
                continue
            for nxt in roads.successor[roads.successor_ptr[arc] : roads.successor_ptr[arc + 1]].tolist():
                if reach > best.get(nxt, -1.0) + 1e-9:
                    best[nxt] = reach
                    stack.append((nxt, 0.0, reach, part))
        return None


def _by_arc(roads: RoadArcs, coverage: Coverage) -> IntArray:
    return np.searchsorted(coverage.arc, np.arange(roads.n_arcs + 1)).astype(np.int64)
