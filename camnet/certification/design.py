r"""The fewest cameras that certify a road network, with a lower bound (the smallest repairs: ``repairs``).

Placement is a hitting-set problem: every unseen way longer than the limit L must be broken by a camera that sees a
stretch of it. There are too many ways to list, so they are added as they are found (``way_search``), in four stages:

1. greedy: the least-cost choice for the ways known so far, more ways where the certifier finds unseen ones longer than
   L, until it finds none: a certified set;
2. search: a local search (``hitting_search``) looks for a cheaper set for the ways known so far; where the certifier
   finds unseen ones, they are added, else the set is the best one;
3. bound: the linear programme over all ways, found as it breaks them, with what closed walks need (``closed_walks``);
4. proof: the integer programme (HiGHS through scipy) over ways and closed walks known so far. It has only some
   constraints of the whole problem, so its bound is a lower bound of the optimum; where its solution is certified, it
   is the optimum or at least a candidate for the best one.

Effort is counted (``effort``), so that the answer depends neither on the machine nor on what else it does. Above
``exact_limit`` candidates the fourth stage is left out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from camnet.certification.closed_walks import LONGEST, WalkSearch
from camnet.certification.coverage import Coverage
from camnet.certification.hitting_set import HittingSet, Inequality
from camnet.certification.repairs import Repair, smallest_repairs
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.way_search import Way, WaySearch, usable_coverage
from camnet.errors import CertificateError
from camnet.types import Array, IntArray

__all__ = ["Placement", "Repair", "place_cameras", "smallest_repairs", "usable_coverage"]

#: with effort 1: entries that the local search looks at, at most in one go, and nodes of integer programmes
_VISITS, _VISITS_AT_ONCE, _NODES = 600_000_000, 10_000_000, 60
#: what one call of the local search counts at least
_VISITS_AT_LEAST = 1_000_000
#: rounds of the linear programme, rows added in one, and places where ways that are too long may begin
_ROUNDS, _ROWS_AT_ONCE, _STARTS = 40, 1000, 6000
#: inequalities of closed walks added in one round
_WALKS_AT_ONCE = 300
#: longer closed walks are looked for when the bound grows by less than this share
_LEAST_GAIN = 5e-4
#: up to so many candidates the search begins with a row for each place where a way that is too long may begin
_FEW_CANDIDATES = 5000
#: nodes of the integer programme where the greedy choice gets stuck, and how many more in all where numbers are bounded
_STUCK_NODES, _BOUNDED = 200, 10
#: closed walks are looked for once fewer than this share of the rows is new
_FEW_ROWS = 0.02


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
    seconds : processor time taken, s
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


def place_cameras(
    roads: RoadArcs,
    candidates: Coverage,
    n_candidates: int,
    limit_m: float,
    least_view_m: float = 0.0,
    costs: Array | None = None,
    *,
    standing: IntArray | None = None,
    survive: int = 0,
    at_most: Sequence[tuple[IntArray, int]] = (),
    exact_limit: int = 3000,
    effort: float = 1.0,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Placement:
    """Choose the cheapest certified set of candidate cameras.

    Parameters
    ----------
    roads : the network to certify
    candidates : what each candidate sees (``cover_roads`` of all of them), cameras 0 .. n_candidates - 1
    limit_m : longest unseen way allowed, m
    least_view_m : stretches in view that are shorter do not count, m
    costs : (n_candidates,) cost of each, positive; None: one each, so that the number is minimised
    standing : candidates that are there already: they always see, are never chosen and cost nothing
    survive : the set certifies the network after any so many of its cameras fail, standing ones too: every way that is
        too long needs so many cameras more
    at_most : sets of candidates of which so many may be chosen at most: positions of one camera
    exact_limit : lower bound by integer programming up to this many candidates, by linear programming beyond
    effort : of search, bound and proof, counted in steps
    time_limit_s : processor time after which they end early; a first certified set is found whatever it takes. With a
        limit the answer depends on the machine
    seed : of the local search
    progress : called with the share of the effort that is spent

    Raises
    ------
    CertificateError
        if not even all candidates together certify the network.
    """
    weight = np.ones(n_candidates) if costs is None else np.asarray(costs, dtype=float)
    search = _Search(
        roads, usable_coverage(roads, candidates, least_view_m), weight, limit_m, standing, survive, at_most, progress,
        time_limit_s,
    )  # fmt: skip
    search.check(n_candidates)
    search.first()
    rng = np.random.default_rng(seed)
    search.improve(0.1 * effort, rng)
    search.bound(effort)
    search.improve(0.1 * effort, rng)
    if n_candidates <= exact_limit:
        search.prove(effort)
    search.improve(0.8 * effort, rng)
    cost = float(weight[search.best].sum())
    return Placement(
        chosen=search.best,
        cost=cost,
        lower_bound=search.lower,
        certified=True,
        optimal=cost <= search.lower + 1e-6,
        rounds=search.rounds,
        ways=len(search.problem.rows),
        seconds=search.spent(),
    )


class _Search:
    """State of one placement: known ways, best certified set, lower bound."""

    def __init__(
        self,
        roads: RoadArcs,
        usable: Coverage,
        weight: Array,
        limit_m: float,
        standing: IntArray | None,
        survive: int,
        at_most: Sequence[tuple[IntArray, int]],
        progress: Callable[[float], None] | None,
        time_limit_s: float,
    ) -> None:
        self._begun, self._ends = time.process_time(), time_limit_s
        self._weight, self._progress = weight, progress
        self._search = WaySearch(roads, usable, len(weight), limit_m, standing)
        self._survive = survive
        self._whole_costs = bool(np.allclose(weight, np.round(weight)))
        #: a cheaper set costs at least this much less
        self._step = 1.0 if self._whole_costs else 1e-6 * float(weight.max(initial=1.0))
        self.problem, self._bounded = HittingSet(weight, at_most), bool(at_most)
        self.best: IntArray = np.array([], dtype=np.int64)
        self.lower, self.rounds = 0.0, 0

    def spent(self) -> float:
        """Return the processor time since the beginning, s."""
        return time.process_time() - self._begun

    def _done(self) -> bool:
        """Whether the best set is known to be the cheapest, or the time is over."""
        return self._cost(self.best) <= self.lower + 1e-6 or self.spent() >= self._ends

    def _cost(self, chosen: IntArray) -> float:
        return float(self._weight[chosen].sum())

    def _learn(self, ways: list[Way]) -> None:
        for way in ways:
            self._add(self._search.cameras_on(way), way)
        self.rounds += 1

    def _add(self, on: set[int], way: Way) -> int:
        """Add the candidates that see a way that is too long as a row; returns whether it is new."""
        free = on.difference(self._search.standing.tolist())
        need = self._survive + 1 - len(on) + len(free)
        if len(free) < need:
            raise CertificateError(_too_few(way, self._search.limit_m, len(on), self._survive))
        return self.problem.add([free], need) if need > 0 else 0

    def check(self, n: int) -> None:
        """Refuse a problem that all candidates together do not solve."""
        stuck = self._search.violations(np.arange(n))
        if stuck:
            arc, s, _ = stuck[0][0]
            raise CertificateError(
                f"all {n} candidates together leave an unseen way longer than {self._search.limit_m:.4g} m "
                f"from {s:.4g} m along road {arc}: add candidates there, give them larger views (the whole width of a "
                "road must fit one view), or allow a longer way out of view"
            )

    def first(self) -> None:
        """Find a certified set."""
        if len(self._weight) <= _FEW_CANDIDATES:
            self._broken(np.zeros(len(self._weight)))
        self.best = self._repaired(self.best)

    def _repaired(self, chosen: IntArray) -> IntArray:
        """Add candidates to a set until it is certified, then drop those that are not needed, the dearest first."""
        while ways := self._search.violations(chosen, self._survive):
            self._learn(ways)
            chosen = self._completed(chosen)
        for camera in chosen[np.argsort(-self._weight[chosen], kind="stable")].tolist():
            fewer = chosen[chosen != camera]
            if not self._search.violations(fewer, self._survive):
                chosen = fewer
        return chosen

    def _completed(self, chosen: IntArray) -> IntArray:
        """Complete a set greedily; where bounds get in the way, choose anew by the integer programme."""
        try:
            return self.problem.greedy(chosen.tolist())
        except ValueError:
            found, _, _ = self.problem.exact(_STUCK_NODES, math.inf)
        if found is None:
            raise CertificateError(
                "no choice was found that keeps the limit, as each camera that stands can be at one place, in one "
                "direction, alone: allow more out of view, or more mounts and cameras in the catalogue"
            )
        return found

    def improve(self, effort: float, rng: np.random.Generator) -> None:
        """Look for cheaper certified sets; not where numbers are bounded (``at_most``): integer programmes do there."""
        if self._bounded:
            return
        left = effort * _VISITS
        chosen = np.zeros(len(self._weight), dtype=np.bool_)
        chosen[self.best] = True
        while left > 0 and self.problem.rows and not self._done():
            budget = self._cost(self.best) - self._step
            if budget < self._weight.min():
                return
            found, visits = self.problem.within(budget, chosen, int(min(left, _VISITS_AT_ONCE)), rng)
            left -= max(visits, _VISITS_AT_LEAST)
            if found:
                ways = self._search.violations(np.flatnonzero(chosen), self._survive)
                if ways:
                    self._learn(ways)
                else:
                    self.best = np.flatnonzero(chosen)
            self._tell(1.0 - left / (effort * _VISITS))

    def bound(self, effort: float) -> None:
        """Raise the lower bound by the linear programme over ways and closed walks."""
        if not self.problem.rows or self._done():
            return
        walks, level = WalkSearch(self._search, self._survive), 0
        x, value = self.problem.relaxed()
        for _ in range(round(_ROUNDS * effort)):
            self._raise(value)
            if self._done():
                return
            rows, before = self._broken(x), value
            found: list[Inequality] = []
            if rows < _FEW_ROWS * len(self.problem.rows):
                while level < len(LONGEST) and not (found := walks.broken(x, LONGEST[level], _WALKS_AT_ONCE)):
                    level += 1
            if not rows and not found:
                return
            self.problem.forget_loose(x)
            self.problem.inequalities += found
            x, value = self.problem.relaxed()
            if found and value < before * (1.0 + _LEAST_GAIN):
                level += 1
        self._raise(value)

    def _broken(self, x: Array) -> int:
        """Add ways whose cameras have less than a share of 1 in all; returns how many rows are new."""
        seeing = x + 1e-6
        seeing[self._search.standing] = 1.0
        if self._survive:
            return 0
        light = sorted(self._search.light_rows(seeing, 0.999, _STARTS), key=lambda of: of[0])
        return sum(self._add(on, ()) for _, on in light[:_ROWS_AT_ONCE])

    def prove(self, effort: float) -> None:
        """Raise the lower bound by integer programmes until it meets the cost."""
        nodes = round(_NODES * effort * (_BOUNDED if self._bounded else 1))
        left = nodes
        while self.problem.rows and left > 0 and not self._done():
            chosen, bound, nodes = self.problem.exact(left, self._ends - self.spent())
            left -= nodes
            self._raise(min(bound, self._cost(self.best)))
            if chosen is None:
                return
            ways = self._search.violations(chosen, self._survive)
            if ways:
                self._learn(ways)
                chosen = self._repaired(chosen)
            if self._cost(chosen) < self._cost(self.best) - 1e-9:
                self.best = chosen
            self._tell(1.0 - left / nodes)

    def _raise(self, bound: float) -> None:
        self.lower = max(self.lower, math.ceil(bound - 1e-6) if self._whole_costs else bound)

    def _tell(self, share: float) -> None:
        if self._progress is not None:
            self._progress(min(1.0, share))


def _too_few(way: Way, limit_m: float, candidates: int, survive: int) -> str:
    """Say where too few candidates see a way for a network that survives failures."""
    arc, s, _ = way[0]
    return (
        f"only {candidates} candidates see the unseen way longer than {limit_m:.4g} m from {s:.4g} m along road {arc}, "
        f"and {survive + 1} are needed to survive {survive} failures: add candidates there"
    )
