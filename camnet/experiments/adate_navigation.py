"""Local navigation among random obstacles (li2019, section V-B, figures 5 and 6).

Ten waypoints 10 s apart, four ellipsoids midway between waypoints; the horizon ends at the second next waypoint and
the plan is renewed every second from the last one. A body that follows its plan is judged on the C1 curve it flew: an
obstacle is cleared when the whole curve stays outside it (certified between the samples), a waypoint is met when the
curve passes within two standard deviations of it (Mahalanobis distance 2) at its time.

Iterations: linear solves of one call of the planner, rejected steps and other starts included, counted at every
re-plan of every world, those over a new horizon too; the largest at plans that feel one (two) obstacles is the
reported figure. No call makes more than `SOLVES`: what is not at its end then goes on at the next second, while a
plan whose whole curve was checked is in force. How often that is, and how many seconds a descent takes to its end (no
position moves by more than ``tolerance_m``), is reported beside it. A start lies ahead of the first waypoint by one
leg.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from camnet.control.planner import Curve, Obstacle, Plan, Planner, PlannerSettings, Waypoint, ellipsoid
from camnet.storage.whole_file import write_json
from camnet.types import Array

__all__ = ["COVARIANCE", "NavigationWorld", "Voyage", "make_world", "navigate", "print_table", "run"]

LEG_S = 10.0
WAYPOINTS = 10
OBSTACLES = 4
COVARIANCE = np.diag([1.0, 1.0, 0.25])
DEFINITION = (
    "iterations: largest number of linear solves in one re-plan, rejected steps and other starts included, over all "
    "re-plans of all worlds that feel one (two) obstacles; a descent not at its end then is carried to the next "
    "re-plan while a checked plan is in force (descents: how often, how long); obstacles_cleared: the whole flown "
    "curve outside all obstacles; waypoints_met: every waypoint within Mahalanobis distance 2 at its time; "
    "ms_per_plan: median processor time of a re-plan"
)
#: shares of worlds that an independent run of the published program reached
MEASURED_ELSEWHERE = {"obstacles_cleared": 0.325, "waypoints_met": 0.80, "both": 0.375}
#: linear solves of one re-plan at most: the smaller one of the published bounds
SOLVES = 3
#: published bounds of the iterations
BOUNDS = {"one_near": 3, "two_near": 4}


@dataclass(frozen=True, eq=False)
class NavigationWorld:
    """``start`` (3,), ``waypoints`` (10,3) m, reached every `LEG_S`; obstacles, each on the leg into a waypoint."""

    start: Array
    waypoints: Array
    obstacles: tuple[Obstacle, ...]
    legs: Array


@dataclass(eq=False)
class Voyage:
    """What was flown: samples ``x``, ``v`` (n,3) a second apart, and the plans on the way."""

    curve: Curve
    clearances: Array
    deviations: Array
    plans: list[Plan] = field(default_factory=list)
    plan_ms: list[float] = field(default_factory=list)

    @property
    def cleared(self) -> bool:
        """Whether the whole curve stays outside every obstacle."""
        return bool((self.clearances > 0.0).all())

    @property
    def met(self) -> bool:
        """Whether every waypoint was met within two standard deviations."""
        return bool((self.deviations <= 2.0).all())


def _rotation(rng: np.random.Generator) -> Array:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return np.asarray(q)


def make_world(rng: np.random.Generator) -> NavigationWorld:
    """Draw a world; waypoint 0 is the start, obstacles sit exactly midway between waypoints of four different legs."""
    i = np.arange(WAYPOINTS + 1)
    x = 6.0 * i - (i - 5.0) ** 2 / 5.0 + rng.uniform(0.0, 50.0, len(i))
    y = 50.0 + 30.0 * np.sin(i / 2.0) + rng.uniform(-20.0, 20.0, len(i))
    z = (i - 5.0) ** 2 / 5.0 + 30.0 + rng.uniform(0.0, 20.0, len(i))
    points = np.column_stack([x, y, z])
    legs = np.sort(rng.choice(np.arange(2, WAYPOINTS + 1), OBSTACLES, replace=False))
    obstacles = tuple(
        ellipsoid(0.5 * (points[k - 1] + points[k]), rng.uniform(2.0, 3.5, 3), _rotation(rng)) for k in legs
    )
    return NavigationWorld(points[0], points[1:], obstacles, legs)


def navigate(world: NavigationWorld, planner: Planner) -> Voyage:
    """Fly a world: re-plan every step, follow the plan for one step."""
    dt = planner.settings.dt_s
    steps = round(LEG_S / dt)
    p, v = world.start, (world.waypoints[0] - world.start) / LEG_S
    xs, vs = [p], [v]
    plan: Plan | None = None
    plans, times = [], []
    for k in range(WAYPOINTS * steps):
        ahead = range(k // steps, min(k // steps + 2, WAYPOINTS))
        goals = [Waypoint((j + 1) * LEG_S - k * dt, world.waypoints[j], COVARIANCE) for j in ahead]
        begin = time.process_time()
        plan = planner.plan(p, v, goals, world.obstacles, last=plan)
        times.append(1e3 * (time.process_time() - begin))
        plans.append(plan)
        p, v = plan.curve.x[1], plan.curve.v[1]
        xs.append(p)
        vs.append(v)
    curve = Curve(np.array(xs), np.array(vs), dt)
    clearances, _ = curve.clearance(np.array([o.row for o in world.obstacles]))
    away = curve.x[steps::steps] - world.waypoints
    deviations = np.sqrt(np.sum(away * np.linalg.solve(COVARIANCE, away.T).T, axis=1))
    return Voyage(curve, clearances, deviations, plans, times)


def _iterations(voyages: Sequence[Voyage], near: int) -> dict[str, float]:
    plans = [p for w in voyages for p in w.plans if p.near == near]
    if not plans:
        return {"max": float("nan"), "mean": float("nan"), "within": float("nan"), "plans": 0}
    counts = np.array([p.solves for p in plans])
    bound = BOUNDS["one_near" if near == 1 else "two_near"]
    return {
        "max": int(counts.max()),
        "mean": float(counts.mean()),
        "within": float(np.mean(counts <= bound)),
        "at_its_end": float(np.mean([p.pending is None for p in plans])),
        "plans": len(plans),
    }


def _renewals(voyages: Sequence[Voyage]) -> dict[str, float]:
    """How many re-plans a descent takes to its end, and how often no better plan than the last one was there."""
    lengths, plans = [], [p for w in voyages for p in w.plans]
    for voyage in voyages:
        length = 0
        for plan in voyage.plans:
            length += 1
            if plan.pending is None:
                lengths.append(length)
                length = 0
    return {
        "replans_mean": float(np.mean(lengths)),
        "replans_max": int(np.max(lengths)),
        "at_once": float(np.mean(np.array(lengths) == 1)),
        "last_plan_kept": int(sum(p.kept for p in plans)),
        "unsafe_plans": int(sum(not p.safe for p in plans)),
        "plans": len(plans),
    }


def run(
    seeds: int = 200,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Navigate ``seeds`` worlds; with ``out_dir`` also write the figures there.

    Parameters
    ----------
    progress : called with the share of worlds done
    """
    planner = Planner(PlannerSettings(solves_per_plan=SOLVES))
    voyages = []
    first: tuple[NavigationWorld, Voyage] | None = None
    for k in range(seeds):
        world = make_world(np.random.default_rng(seed + k))
        voyage = navigate(world, planner)
        first = first or (world, voyage)
        voyages.append(voyage)
        if progress is not None:
            progress((k + 1) / seeds)
    cleared = np.array([v.cleared for v in voyages])
    met = np.array([v.met for v in voyages])
    one, two = _iterations(voyages, 1), _iterations(voyages, 2)
    result = {
        "worlds": seeds,
        "obstacles_cleared": float(cleared.mean()),
        "waypoints_met": float(met.mean()),
        "both": float((cleared & met).mean()),
        "iterations": {"one_near": one["max"], "two_near": two["max"]},
        "iterations_detail": {"one_near": one, "two_near": two},
        "descents": _renewals(voyages),
        "definition": DEFINITION,
        "ms_per_plan": float(np.median([t for v in voyages for t in v.plan_ms])),
        "smallest_clearance_m": float(min(v.clearances.min() for v in voyages)),
        "failed_seeds": [seed + k for k in range(seeds) if not (cleared[k] and met[k])],
        "measured_elsewhere": MEASURED_ELSEWHERE,
    }
    if out_dir is not None and first is not None:
        from camnet.report.navigation import plot_convergence, plot_voyage

        folder = Path(out_dir)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "adate-navigation.json", result)
        world, voyage = first
        plans = [voyage.plans[k].curve.points(10) for k in range(0, len(voyage.plans), 10)]
        rows = np.array([o.row for o in world.obstacles])
        plot_voyage(
            voyage.curve.points(20), plans, world.waypoints, COVARIANCE, rows, folder / "navigation-plan.png"
        )
        plot_convergence([[p.steps for p in v.plans] for v in voyages], folder / "navigation-convergence.png")
    return result


def print_table(result: dict[str, Any]) -> None:
    """Print the figures beside those measured on the published program."""
    print(f"{'share of worlds':24s} {'here':>8s} {'elsewhere':>10s}")  # noqa: T201 - the command's table
    for name, other in result["measured_elsewhere"].items():
        print(f"{name:24s} {result[name]:8.3f} {other:10.3f}")  # noqa: T201
    for name, detail in result["iterations_detail"].items():
        words = f"largest {detail['max']}, mean {detail['mean']:.2f}, within {BOUNDS[name]}: {detail['within']:.3f}"
        print(f"linear solves a re-plan, {name}: {words} ({detail['plans']} plans)")  # noqa: T201
    d = result["descents"]
    words = (
        f"{100 * d['at_once']:.1f} % in the re-plan that begins them, the longest in {d['replans_max']:.0f}"
    )
    print(f"descents end: {words}; last plan kept {d['last_plan_kept']} times of {d['plans']}")  # noqa: T201
    print(f"{result['ms_per_plan']:.2f} ms of processor time a plan (median), {result['worlds']} worlds")  # noqa: T201
