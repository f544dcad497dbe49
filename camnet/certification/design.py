r"""The fewest cameras that certify a road network, with a lower bound (the smallest repairs: ``repairs``).

Placement is a hitting-set problem: every unseen way longer than the limit L must be broken by a camera that sees a
stretch of it. There are too many ways to list, so they are added as they are found (``way_search``), in three stages:

1. greedy: the least-cost choice for the ways known so far, more ways where the certifier finds unseen ones longer than
   L, until it finds none: a certified set;
2. neighbourhoods: all cameras of one neighbourhood are chosen anew by an integer programme, the others stay; kept where
   it costs less and is certified;
3. bound: the integer programme over all ways known so far (HiGHS through scipy). It has only some constraints of the
   whole problem, so its bound is a lower bound of the optimum; where its solution is certified, it is the optimum.

Above ``exact_limit`` candidates the bound is that of the linear programme.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.hitting_set import HittingSet
from camnet.certification.repairs import Repair, smallest_repairs
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.way_search import Way, WaySearch, usable_coverage
from camnet.errors import CertificateError
from camnet.types import Array, IntArray

__all__ = ["Placement", "Repair", "place_cameras", "smallest_repairs", "usable_coverage"]

#: share of the time limit for the second stage, and of the candidates that one neighbourhood holds
_IMPROVE_SHARE, _NEIGHBOURS = 0.45, 0.25
#: fewest candidates of a neighbourhood, most candidates, and the longest time for it, s
_LEAST_NEIGHBOURS, _MOST_NEIGHBOURS, _NEIGHBOURHOOD_S = 20, 200, 5.0
#: longest time for a choice where the greedy one gets stuck, s
_STUCK_S = 30.0
#: neighbourhoods in a row without a gain after which the second stage ends
_PATIENCE = 40


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
    time_limit_s: float = 60.0,
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
    time_limit_s : processor time for improvement and bound; a first certified set is found whatever it takes
    seed : of the neighbourhoods' order
    progress : called with the share of the time that is spent

    Raises
    ------
    CertificateError
        if not even all candidates together certify the network.
    """
    weight = np.ones(n_candidates) if costs is None else np.asarray(costs, dtype=float)
    search = _Search(
        roads,
        usable_coverage(roads, candidates, least_view_m),
        weight,
        limit_m,
        standing,
        survive,
        at_most,
        progress,
    )
    search.check(n_candidates)
    search.first()
    search.improve(_IMPROVE_SHARE * time_limit_s, np.random.default_rng(seed))
    search.bound(time_limit_s, exact=n_candidates <= exact_limit)
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
    ) -> None:
        self._begun = time.process_time()
        self._usable, self._weight, self._progress = usable, weight, progress
        self._search = WaySearch(roads, usable, limit_m, standing)
        self._survive = survive
        self._whole_costs = bool(np.allclose(weight, np.round(weight)))
        self.problem = HittingSet(weight, at_most)
        self.best: IntArray = np.array([], dtype=np.int64)
        self.lower, self.rounds = 0.0, 0
        self._places = np.full((len(weight), 2), np.inf)
        for row in range(len(usable.arc) - 1, -1, -1):
            middle = 0.5 * (float(usable.start_m[row]) + float(usable.end_m[row]))
            self._places[usable.camera[row]] = roads.position(int(usable.arc[row]), middle)

    def spent(self) -> float:
        """Return the processor time since the beginning, s: a busy machine gets the same answer later."""
        return time.process_time() - self._begun

    def _cost(self, chosen: IntArray) -> float:
        return float(self._weight[chosen].sum())

    def _learn(self, ways: list[Way]) -> None:
        for way in ways:
            on = self._search.cameras_on(way)
            free = on.difference(self._search.standing.tolist())
            need = self._survive + 1 - len(on) + len(free)
            if len(free) < need:
                raise CertificateError(_too_few(way, self._search.limit_m, len(on), self._survive))
            self.problem.add([free], need)
        self.rounds += 1

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
            found = self.problem.exact(_STUCK_S, 0.05)
        if found is None:
            raise CertificateError(
                "no choice was found that keeps the limit, as each camera that stands can be at one place, in one "
                "direction, alone: allow more out of view, or more mounts and cameras in the catalogue"
            )
        return found[0]

    def improve(self, until_s: float, rng: np.random.Generator) -> None:
        """Choose the cameras of neighbourhoods anew as long as that helps."""
        n = len(self._weight)
        size = min(n, max(_LEAST_NEIGHBOURS, min(_MOST_NEIGHBOURS, round(_NEIGHBOURS * n))))
        idle = 0
        while idle < (_PATIENCE if size < n else 1) and len(self.best) and self.spent() < until_s:
            idle += 1
            about = self._places[rng.choice(self.best)]
            near = np.argsort(np.linalg.norm(self._places - about, axis=1), kind="stable")[:size]
            if self._renew(np.sort(near)):
                idle = 0
            self._tell(until_s)

    def _renew(self, free: IntArray) -> bool:
        """Choose among ``free`` anew, the other chosen ones kept; whether a cheaper certified set was found."""
        kept = np.setdiff1d(self.best, free)
        worth = self._cost(np.intersect1d(self.best, free))
        while True:
            found = self.problem.exact(_NEIGHBOURHOOD_S, 0.0, free, kept)
            if found is None or self._cost(found[0]) > worth - 1e-9:
                return False
            chosen = np.sort(np.concatenate([kept, found[0]]))
            ways = self._search.violations(chosen, self._survive)
            if not ways:
                self.best = chosen
                return True
            self._learn(ways)

    def bound(self, until_s: float, exact: bool) -> None:
        """Raise the lower bound until it meets the cost, or the time is over."""
        if not self.problem.rows:
            return
        self._raise(self.problem.relaxed()[1])
        while exact and self._cost(self.best) > self.lower + 1e-6 and self.spent() < until_s:
            found = self.problem.exact(max(1.0, until_s - self.spent()), 0.0)
            if found is None:
                return
            chosen, bound = found
            self._raise(bound)
            ways = self._search.violations(chosen, self._survive)
            if not ways and self._cost(chosen) < self._cost(self.best) - 1e-9:
                self.best = chosen
            elif ways:
                repaired = self._repaired(chosen)
                if self._cost(repaired) < self._cost(self.best) - 1e-9:
                    self.best = repaired
            self._tell(until_s)

    def _raise(self, bound: float) -> None:
        self.lower = max(self.lower, math.ceil(bound - 1e-6) if self._whole_costs else bound)

    def _tell(self, until_s: float) -> None:
        if self._progress is not None:
            self._progress(min(1.0, self.spent() / until_s))


def _too_few(way: Way, limit_m: float, candidates: int, survive: int) -> str:
    """Say where too few candidates see a way for a network that survives failures."""
    arc, s, _ = way[0]
    return (
        f"only {candidates} candidates see the unseen way longer than {limit_m:.4g} m from {s:.4g} m along road {arc}, "
        f"and {survive + 1} are needed to survive {survive} failures: add candidates there"
    )
