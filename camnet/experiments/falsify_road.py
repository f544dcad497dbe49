"""Hostile targets of the road-bound class: they turn where the unseen way is longest and drive as slowly as they may.

The walk along the roads is a route of its own: it shares neither search nor sums with the certifier. Every trial leaves
one view and drives until another sees it. Claims of ``unseen`` that it can break: the transition is listed; its length
is between the shortest and the longest way; it is over after l_max / v_lo at the latest. ``learned`` claims nothing
across unseen junctions; elsewhere a prediction whose speed is wrong by at most e_v stays within the error's bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import RoadGaps
from camnet.certification.transitions import GrowthModel, RoadTargetClass
from camnet.experiments.falsify_flow import Attack, search, shares
from camnet.processes.crew import Crew
from camnet.processes.place import in_order
from camnet.types import Array

__all__ = ["RoadCase", "attack_roads"]

_RANDOM, _BANG = 0.4, 0.4
#: turns that a trial decides on, and pieces of its speed
_TURNS, _SPEEDS = 16, 8
_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class RoadCase:
    """A road network with its gaps, the class of the targets, and the error growth of predictions."""

    roads: RoadArcs
    gaps: RoadGaps
    target: RoadTargetClass
    growth: GrowthModel | None


@dataclass(frozen=True, slots=True)
class _Claims:
    """By exit: the longest way; by (exit, entry): shortest and longest way, m, and those with an unseen junction."""

    longest: dict[int, float]
    pairs: dict[tuple[int, int], tuple[float, float]]
    branching: set[tuple[int, int]]
    first: dict[int, list[int]]


def attack_roads(
    case: RoadCase,
    trials: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] | None = None,
    crew: Crew | None = None,
) -> tuple[Attack, Attack]:
    """Attack every exit that is certain to be seen again; return what ``unseen`` and ``learned`` suffered.

    Each exit has a generator of its own, so figures do not depend on who attacks it (``crew``; None: this process).
    """
    claims = _claims(case)
    open_ended = set(case.gaps.exits[case.gaps.cyclic | case.gaps.cut].tolist())
    exits = sorted(set(claims.longest) - open_ended)
    unseen, learned = Attack(), Attack()
    tasks = list(zip(exits, shares(trials, len(exits)), rng.spawn(len(exits)), strict=True)) if exits else []
    for part_unseen, part_learned in in_order(crew, partial(_attack_exit, case, claims), tasks, progress):
        unseen.add(part_unseen)
        learned.add(part_learned)
    return unseen, learned


def _claims(case: RoadCase) -> _Claims:
    gaps = case.gaps
    longest: dict[int, float] = {}
    pairs = {}
    for leave, into, short, far in zip(
        gaps.exit_stretch.tolist(),
        gaps.entry_stretch.tolist(),
        gaps.shortest_m.tolist(),
        gaps.longest_m.tolist(),
        strict=True,
    ):
        longest[leave] = max(longest.get(leave, 0.0), far)
        pairs[leave, into] = (short, far)
    first: dict[int, list[int]] = {}
    for k, arc in enumerate(gaps.stretches.arc.tolist()):
        first.setdefault(arc, []).append(k)
    ends = zip(gaps.exit_stretch.tolist(), gaps.entry_stretch.tolist(), gaps.branches.tolist(), strict=True)
    return _Claims(longest, pairs, {(a, b) for a, b, several in ends if several}, first)


def _attack_exit(
    case: RoadCase, claims: _Claims, task: tuple[int, int, np.random.Generator]
) -> tuple[Attack, Attack]:
    leave, trials, rng = task
    unseen, learned = Attack(), Attack()
    n_random, n_bang = round(_RANDOM * trials), round(_BANG * trials)
    for k in range(n_random + n_bang):
        plan = rng.random(_TURNS + _SPEEDS)
        if k >= n_random:
            plan[_TURNS:] = (
                0.0 if rng.random() < 0.8 else rng.integers(0, 2, _SPEEDS)
            )  # slow all the way, or jumping
        _drive(case, claims, leave, plan, unseen, learned)
    left = trials - n_random - n_bang
    if left <= 0:
        return unseen, learned
    spent = 0

    def cost(plans: Array) -> Array:
        nonlocal spent
        out = np.zeros(plans.shape[1])
        for i in range(min(plans.shape[1], left - spent)):
            out[i] = -_drive(case, claims, leave, plans[:, i], unseen, learned)
        spent = min(left, spent + plans.shape[1])
        return out

    search(cost, _TURNS + _SPEEDS, 1.0, left, rng)
    return unseen, learned


def _drive(
    case: RoadCase, claims: _Claims, leave: int, plan: Array, unseen: Attack, learned: Attack
) -> float:
    """Drive one target, count what it broke, and return its share of the longest time."""
    entry, way = _walk(case, claims, leave, plan[:_TURNS])
    unseen.trials += 1
    if entry is None:  # it left the network: nothing is claimed
        return 0.0
    target, latest = case.target, claims.longest[leave] / case.target.v_lo_mps
    speeds = target.v_lo_mps + plan[_TURNS:] * (target.v_max_mps - target.v_lo_mps)
    time_s = float((way / _SPEEDS / speeds).sum())
    listed = claims.pairs.get((leave, entry))
    broken = listed is None or not listed[0] - _TOLERANCE <= way <= listed[1] + _TOLERANCE
    broken |= time_s > latest + _TOLERANCE
    unseen.violations += int(broken)
    share = time_s / latest if latest > 0.0 else 0.0
    unseen.closest = max(unseen.closest, share)
    if case.growth is not None and (leave, entry) not in claims.branching:
        learned.trials += 1
        # the prediction's speed may be wrong by e_v one way or the other, for each piece of the way
        sign = np.where(plan[_TURNS:] < 0.5, -1.0, 1.0)
        durations = way / _SPEEDS / speeds
        error = case.growth.e0_m + case.growth.model_error_mps * np.abs(np.cumsum(sign * durations)).max()
        bound = case.growth.error_at(time_s)
        learned.violations += int(error > bound + _TOLERANCE)
        learned.closest = max(learned.closest, float(error / bound))
    return share


def _walk(case: RoadCase, claims: _Claims, leave: int, turns: Array) -> tuple[int | None, float]:
    """Follow the roads from the end of a stretch until another one begins; return it and the unseen length, m."""
    roads, seen = case.roads, case.gaps.stretches
    arc, s, way = int(seen.arc[leave]), float(seen.end_m[leave]), 0.0
    for k in range(10_000):
        ahead = [
            j
            for j in claims.first.get(arc, [])
            if (seen.start_m[j] >= s - _TOLERANCE and j != leave) or k > 0
        ]
        ahead = [j for j in ahead if seen.start_m[j] >= s - _TOLERANCE]
        if ahead:
            j = min(ahead, key=lambda i: float(seen.start_m[i]))
            return j, way + max(float(seen.start_m[j]) - s, 0.0)
        way += float(roads.length_m[arc]) - s
        ways = roads.successor[roads.successor_ptr[arc] : roads.successor_ptr[arc + 1]]
        if len(ways) == 0:
            return None, way
        arc, s = int(ways[min(int(turns[k % _TURNS] * len(ways)), len(ways) - 1)]), 0.0
    return None, way
