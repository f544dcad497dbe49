r"""The fewest cameras that certify a road network, with a lower bound (the smallest repairs: ``repairs``).

Placement is a hitting-set problem: every unseen way longer than L = v_lo Dt_off must be broken by a camera that sees a
stretch of it for at least v_max Dt_on. There are too many ways to list, so they are added as they are found:

1. the least-cost set of candidates that hits all ways known so far (integer programme, HiGHS through scipy);
2. if the certifier finds an unseen way longer than L with this set, add it and repeat; else the set is certified.

Every integer programme has only some constraints of the whole problem: its bound is a lower bound of the optimum, and
the set found is optimal when the programme was solved exactly. Above ``exact_limit`` candidates a greedy set with
local search is returned, with the linear programme's value as its lower bound.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

from camnet.certification.coverage import Coverage
from camnet.certification.repairs import Repair, smallest_repairs
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import merge_coverage
from camnet.certification.road_gaps_kernel import merge_intervals
from camnet.certification.transitions import RoadTargetClass
from camnet.errors import CertificateError
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Placement", "Repair", "place_cameras", "smallest_repairs", "unseen_way", "usable_coverage"]

#: stretches closer than this (m) are one
_TOUCH_M = 1e-6
#: part of an arc: arc, from, to (m)
Way = tuple[tuple[int, float, float], ...]


@dataclass(frozen=True, eq=False)
class Placement:
    """Result of a placement.

    Attributes
    ----------
    chosen : numbers of the chosen candidates
    cost : their total cost
    lower_bound : no certified set costs less
    certified : whether the certifier finds no violation with the chosen set
    optimal : whether ``cost`` meets the bound
    rounds, ways : integer programmes solved and ways that had to be listed
    seconds : time taken, s
    """

    chosen: IntArray
    cost: float
    lower_bound: float
    certified: bool
    optimal: bool
    rounds: int
    ways: int
    seconds: float

    @property
    def gap(self) -> float:
        """Relative distance to the lower bound."""
        return (self.cost - self.lower_bound) / max(self.cost, 1e-12)

    def as_dict(self) -> dict[str, object]:
        """Return the record as plain data, for JSON."""
        return {
            "count": len(self.chosen),
            "cost": self.cost,
            "lower_bound": self.lower_bound,
            "gap": self.gap,
            "cameras": self.chosen.tolist(),
            "certified": self.certified,
            "seconds": self.seconds,
        }


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
    kept = _rows(joined, joined.end_m - joined.start_m >= least_m)
    return _rows(kept, np.lexsort((kept.start_m, kept.arc)))


def _rows(c: Coverage, keep: BoolArray | IntArray) -> Coverage:
    return Coverage(
        c.arc[keep], c.camera[keep], c.start_m[keep], c.end_m[keep], c.depth_m[keep], c.deepest_m[keep]
    )


def unseen_way(
    roads: RoadArcs, coverage: Coverage, limit_m: float, start_arc: int, start_m: float
) -> Way | None:
    """Find an unseen way of length ``limit_m`` from a point by depth-first search; None if every way is seen before.

    A way that ends sooner, where the network ends, is no violation: the target is gone. A state is an arc's start
    reached after a length; one that was reached before after at least as long a way cannot lead further.
    """
    ptr, start, end = _by_arc(roads, coverage)
    best = np.full(roads.n_arcs, -1.0)
    stack: list[tuple[int, float, float, Way]] = [(start_arc, start_m, 0.0, ())]
    while stack:
        arc, s, travelled, way = stack.pop()
        rows = slice(ptr[arc], ptr[arc + 1])
        later = start[rows][end[rows] > s + 1e-9]
        stop = max(float(later.min()), s) if len(later) else float(roads.length_m[arc])
        reach = travelled + stop - s
        part = (*way, (arc, s, min(stop, s + limit_m - travelled))) if stop > s else way
        if reach > limit_m + 1e-6:
            return part
        if len(later):
            continue
        for nxt in roads.successor[roads.successor_ptr[arc] : roads.successor_ptr[arc + 1]].tolist():
            if reach > best[nxt] + 1e-9:
                best[nxt] = reach
                stack.append((nxt, 0.0, reach, part))
    return None


def _by_arc(roads: RoadArcs, coverage: Coverage) -> tuple[IntArray, Array, Array]:
    ptr = np.searchsorted(coverage.arc, np.arange(roads.n_arcs + 1)).astype(np.int64)
    return ptr, coverage.start_m, coverage.end_m


def _violations(roads: RoadArcs, coverage: Coverage, limit_m: float) -> list[Way]:
    """One unseen way longer than the limit for each place where one can begin: ends of views and starts of arcs."""
    starts = [(arc, 0.0) for arc in range(roads.n_arcs)]
    if len(coverage.arc):
        seen = merge_coverage(roads, coverage)
        starts += list(zip(seen.arc.tolist(), seen.end_m.tolist(), strict=True))
    ways = (unseen_way(roads, coverage, limit_m, arc, s) for arc, s in starts)
    return [way for way in ways if way]


def place_cameras(
    roads: RoadArcs,
    candidates: Coverage,
    n_candidates: int,
    target: RoadTargetClass,
    off_max_s: float,
    on_min_s: float = 0.0,
    costs: Array | None = None,
    exact_limit: int = 1000,
    time_limit_s: float = 60.0,
) -> Placement:
    """Choose the cheapest certified set of candidate cameras.

    Parameters
    ----------
    roads : the network to certify
    candidates : what each candidate sees (``cover_roads`` of all of them), cameras 0 .. n_candidates - 1
    target : class of the targets
    off_max_s, on_min_s : dwell times
    costs : (n_candidates,) cost of each; None: one each, so that the number is minimised
    exact_limit : integer programming up to this many candidates, greedy with local search beyond
    time_limit_s : for all programmes together

    Raises
    ------
    CertificateError
        if not even all candidates together certify the network.
    """
    begun = time.perf_counter()
    weight = np.ones(n_candidates) if costs is None else np.asarray(costs, dtype=float)
    usable = usable_coverage(roads, candidates, target.v_max_mps * on_min_s)
    limit = target.v_lo_mps * off_max_s
    stuck = _violations(roads, usable, limit)
    if stuck:
        arc, s, _ = stuck[0][0]
        raise CertificateError(
            f"all {n_candidates} candidates together leave an unseen way longer than {limit:.4g} m "
            f"from {s:.4g} m along road {arc}: add candidates there or allow a longer time out of view"
        )
    problem = _Hitting(roads, usable, n_candidates, weight)
    exact = n_candidates <= exact_limit
    chosen, lower, rounds = np.array([], dtype=np.int64), 0.0, 0
    while True:
        found = _violations(roads, _of(usable, chosen), limit)
        if not found or time.perf_counter() - begun > time_limit_s:
            break
        problem.add(found)
        rounds += 1
        left = max(1.0, time_limit_s - (time.perf_counter() - begun))
        chosen, bound = problem.solve(left) if exact else problem.approximate()
        lower = max(lower, bound)
    chosen = _prune(roads, usable, chosen, weight, limit) if not found else np.arange(n_candidates)
    cost = float(weight[chosen].sum())
    if np.allclose(weight, np.round(weight)):
        lower = math.ceil(lower - 1e-6)
    return Placement(
        chosen,
        cost,
        lower,
        True,
        cost <= lower + 1e-6,
        rounds,
        len(problem.ways),
        time.perf_counter() - begun,
    )


def _of(coverage: Coverage, chosen: IntArray) -> Coverage:
    return _rows(coverage, np.isin(coverage.camera, chosen))


def _prune(roads: RoadArcs, usable: Coverage, chosen: IntArray, weight: Array, limit_m: float) -> IntArray:
    """Drop cameras that are not needed, the dearest first."""
    for camera in chosen[np.argsort(-weight[chosen], kind="stable")].tolist():
        fewer = chosen[chosen != camera]
        if not _violations(roads, _of(usable, fewer), limit_m):
            chosen = fewer
    return np.sort(chosen)


class _Hitting:
    """Hitting-set problem that grows: each way is a row, each candidate that sees part of it a column."""

    def __init__(self, roads: RoadArcs, usable: Coverage, n: int, weight: Array) -> None:
        self._usable, self._n, self._weight = usable, n, weight
        self._ptr, _, _ = _by_arc(roads, usable)
        self.ways: set[tuple[int, ...]] = set()

    def add(self, ways: list[Way]) -> None:
        """Add the candidates that break each way."""
        for way in ways:
            hit: set[int] = set()
            for arc, a, b in way:
                rows = slice(self._ptr[arc], self._ptr[arc + 1])
                meets = (self._usable.start_m[rows] < b - 1e-9) & (self._usable.end_m[rows] > a + 1e-9)
                hit.update(self._usable.camera[rows][meets].tolist())
            self.ways.add(tuple(sorted(hit)))

    def _matrix(self) -> csr_matrix:
        rows = list(self.ways)
        ptr = np.cumsum([0, *(len(row) for row in rows)])
        columns = np.fromiter((c for row in rows for c in row), dtype=np.int64, count=int(ptr[-1]))
        return csr_matrix((np.ones(len(columns)), columns, ptr), shape=(len(rows), self._n))

    def solve(self, time_limit_s: float) -> tuple[IntArray, float]:
        """Return an optimal hitting set and the programme's lower bound."""
        result = milp(
            self._weight,
            integrality=np.ones(self._n, dtype=np.int64),
            bounds=Bounds(0, 1),
            constraints=LinearConstraint(self._matrix(), lb=1.0),
            options={"time_limit": time_limit_s},
        )
        if result.x is None:
            return self.approximate()
        return np.flatnonzero(result.x > 0.5), float(result.mip_dual_bound)

    def approximate(self) -> tuple[IntArray, float]:
        """Return a greedy hitting set and the linear programme's bound."""
        matrix = self._matrix().tocsc()
        relaxed = milp(self._weight, bounds=Bounds(0, 1), constraints=LinearConstraint(matrix, lb=1.0))
        open_rows = np.ones(matrix.shape[0])
        chosen: list[int] = []
        while open_rows.any():
            gain = (matrix.T @ open_rows) / self._weight
            best = int(np.argmax(gain))
            chosen.append(best)
            open_rows[matrix.indices[matrix.indptr[best] : matrix.indptr[best + 1]]] = 0.0
        return np.array(sorted(chosen), dtype=np.int64), float(relaxed.fun or 0.0)
