"""Search the plans of an attack for the one that takes most of a promise: at random first, then by evolution.

Plans are flown in rounds whose size does not depend on the number of processes, so that one seed fixes the search; a
limit on time ends it wherever it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from camnet.experiments.closed_loop.judge import Outcome
from camnet.experiments.closed_loop.plan import Plan, PlanSpace
from camnet.types import Array

__all__ = ["ONE_BY_ONE", "TOGETHER", "Found", "search_plans"]

#: plans of one round, parents of the evolution: where they fly one by one, and where they fly side by side
ONE_BY_ONE, TOGETHER = 12, 96
#: share of the trials that is spent at random
_RANDOM = 0.5

#: flies plans and gives each its outcome, in order; None for those that are not wanted any more
Flights = Callable[[Sequence[Plan]], list[Outcome | None]]


class _SpentError(Exception):
    """Trials or time are spent, or the promise is broken."""


@dataclass
class Found:
    """What a search found so far.

    Attributes
    ----------
    flown : plans that were flown
    violations : of these, how many broke the promise
    plan, outcome : the worst of them
    worst : by figure, the worst of any plan
    use : by assumption, the most that any plan used up
    """

    flown: int = 0
    violations: int = 0
    stretches: int = 0
    gaps: int = 0
    plan: Plan | None = None
    outcome: Outcome | None = None
    worst: dict[str, dict[str, Any]] = field(default_factory=dict)
    use: dict[str, float] = field(default_factory=dict)
    out_of_time: bool = False

    def note(self, plan: Plan, outcome: Outcome) -> None:
        """Take in one flight."""
        self.flown += 1
        self.violations += bool(outcome.broken)
        self.stretches += outcome.stretches
        self.gaps += outcome.gaps
        if self.outcome is None or outcome.share > self.outcome.share:
            self.plan, self.outcome = plan, outcome
        for name, figure in outcome.worst.items():
            key = "value" if figure["share"] is None else "share"
            if name not in self.worst or figure[key] > self.worst[name][key]:
                self.worst[name] = figure
        for name, used in outcome.use.items():
            self.use[name] = max(self.use.get(name, 0.0), used)


def search_plans(
    space: PlanSpace,
    fly: Flights,
    trials: int,
    rng: np.random.Generator,
    *,
    at_a_time: int = ONE_BY_ONE,
    time_limit_s: float | None = None,
    stop_when_broken: bool = True,
    progress: Callable[[Found], None] | None = None,
) -> Found:
    """Fly up to ``trials`` plans, ``at_a_time`` in a round; half of them at random, the rest bred from the worst."""
    found, ends = Found(), np.inf if time_limit_s is None else time.monotonic() + time_limit_s
    tried: list[tuple[float, Array]] = []

    def attack(genes: Array) -> Array:
        """Fly rows of genes (k, n); return the share of the promise that each took."""
        genes = genes[: trials - found.flown]
        plans = [space.plan(row) for row in genes]
        shares = np.zeros(len(plans))
        for k, outcome in enumerate(fly(plans)):
            if outcome is None:
                continue
            found.note(plans[k], outcome)
            shares[k] = outcome.share
            tried.append((outcome.share, genes[k]))
        if progress is not None:
            progress(found)
        broken = stop_when_broken and found.violations > 0
        found.out_of_time = not broken and found.flown < trials and time.monotonic() >= ends
        if broken or found.out_of_time or found.flown >= trials:
            raise _SpentError
        return shares

    try:
        at_random = min(trials, max(at_a_time, round(_RANDOM * trials)))
        while found.flown < at_random:
            attack(space.random(min(at_a_time, at_random - found.flown), rng))
        _evolve(attack, space, tried, at_a_time, rng)
    except _SpentError:
        pass
    return found


def _evolve(
    attack: Callable[[Array], Array],
    space: PlanSpace,
    tried: list[tuple[float, Array]],
    count: int,
    rng: np.random.Generator,
) -> None:
    """Breed plans until `attack` has had enough."""
    best = sorted(tried, key=lambda pair: -pair[0])[:count]
    parents = np.array([genes for _, genes in best])
    if len(parents) < count:
        parents = np.concatenate([parents, space.random(count - len(parents), rng)])

    def cost(columns: Array) -> Array:
        shares = attack(np.atleast_2d(columns.T))
        return -np.pad(shares, (0, columns.shape[1] - len(shares)))

    evolve: Any = differential_evolution  # its stubs do not know the vectorised form
    evolve(
        cost,
        [(0.0, 1.0)] * space.size,
        init=parents,
        maxiter=1_000_000,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )
