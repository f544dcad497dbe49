"""Handoffs to and from an agent without external pose, late in its outages of 60 s.

| row | the agent's own pose |
| --- | --- |
| ``external`` | known throughout |
| ``calibrated`` | dead reckoning in outages of 60 s, scale and gyro bias learned before |
| ``raw`` | dead reckoning as measured, flown with the bounds stated for ``calibrated``, which do not hold for it |

Two opposite agents are denied at the same times. Handoffs count if they are to or from one of them at least 20 s into
an outage; ``external`` counts those at the same times. Beside the network, the pose filter alone flies at 1 m/s:
straight on, and with turns, as a search pattern does.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.experiments.certify_world import certify_world
from camnet.experiments.learned_model import learn_model
from camnet.experiments.own_pose_flights import MARKS_S, WAYS, fly_alone
from camnet.processes import Workers
from camnet.report.certificate import write_certificate
from camnet.sensing.own_pose_settings import PoseSource
from camnet.simulation.run import run_network

__all__ = ["LATE_S", "ROWS", "print_table", "run", "wilson"]

WORLD, AGENT = "gps_denied", 0
#: the agents that are denied here: the world's one and the opposite one, at the same times, so that every handoff is to
#: or from one of them
DENIED = (0, 2)
#: handoffs count from so long into an outage, s
LATE_S = 20.0
ROWS: dict[str, dict[str, Any]] = {
    "external": {"source": "external"},
    "calibrated": {},
    "raw": {"calibrate": False},
}
#: a few runs show what becomes of it without calibration
RAW_RUNS = 1
#: share of the work that certificate and flights take
_FIRST = 0.1


@dataclass(frozen=True)
class _Task:
    row: str
    seed: int


def run(
    *,
    seeds: int = 11,
    out_dir: Path | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Certify the world, run all rows with the same seeds, fly the filter alone."""
    told = progress or (lambda _: None)
    world = _scenario("calibrated")
    certificate = _certificate(world, seed, out_dir)
    flights = {way: fly_alone(world.agents[AGENT].pose, way, seed) for way in WAYS}
    told(_FIRST)
    tasks = [_Task(row, seed + k) for k in range(seeds) for row in ROWS if row != "raw" or k < RAW_RUNS]
    found: dict[str, list[dict[str, Any]]] = {row: [] for row in ROWS}
    done: dict[int, dict[str, Any]] = {}
    with Workers(min(len(os.sched_getaffinity(0)), len(tasks))) as workers:
        for k, result in workers.finished(_run_one, tasks):
            done[k] = result
            told(_FIRST + (1.0 - _FIRST) * len(done) / len(tasks))
    for k, task in enumerate(tasks):  # in the tasks' order, whoever was first
        found[task.row].append(done[k])
    rows = {row: _summary(results) for row, results in found.items()}
    return {
        "world": WORLD,
        "seeds": seeds,
        "late_s": LATE_S,
        "rows": rows,
        "completed_of_external": _ratio(rows["calibrated"], rows["external"]),
        "raw_completed_of_external": _ratio(rows["raw"], rows["external"]),
        "alone": flights,
        "certificate": certificate,
    }


def _scenario(row: str) -> Scenario:
    scenario = load_scenario(WORLD)
    if not isinstance(scenario, Scenario):
        raise ConfigError(f"{WORLD}: a network was expected")
    agents = list(scenario.agents)
    pose = agents[AGENT].pose.model_copy(update=ROWS[row])
    for j in DENIED:
        agents[j] = agents[j].model_copy(update={"pose": pose})
    return scenario.model_copy(update={"agents": tuple(agents)})


def _certificate(scenario: Scenario, seed: int, out_dir: Path | None) -> dict[str, Any]:
    model = learn_model(scenario, scenario.run.duration_s, seed)
    certified = certify_world(scenario, model, find_largest=False)
    if out_dir is not None:
        (out_dir / "certificate").mkdir(parents=True, exist_ok=True)
        write_certificate(out_dir / "certificate", certified.report, certified.views, certified.lines)
    report = certified.report
    learned = [
        t["learned"] | {"from": t["from"], "to": t["to"]} for t in report["transitions"] if "learned" in t
    ]
    keys = ("from", "to", "verdict", "margin_m", "margin_s")
    return {
        "verdict": report["certificates"]["learned"]["verdict"],
        "unseen": report["claims"]["unseen"]["verdict"],
        "transitions": [{k: t[k] for k in keys} for t in learned],
        "own_pose": report["own_pose"],
    }


def _run_one(task: _Task) -> dict[str, Any]:
    """Run one world and keep what counts."""
    scenario = _scenario(task.row)
    source, names = load_pose(), tuple(scenario.agents[j].name for j in DENIED)
    result = run_network(scenario, task.seed, ("learned",))
    late = [h["completed"] for h in result.handoffs if _late(h, names, source)]
    summary = result.summary
    return {
        "counted": len(late),
        "completed": sum(late),
        "region_exits": summary["region_exits"],
        "collisions": summary["collisions"],
        "outages": summary.get("own_pose", {}).get("outages", []),
        "target_error_m": summary.get("position_rmse_m"),
    }


def load_pose() -> PoseSource:
    """Return the pose source of the denied agent, whose outages decide which handoffs count in all rows."""
    return _scenario("calibrated").agents[AGENT].pose


def _late(handoff: dict[str, Any], names: tuple[str, ...], source: PoseSource) -> bool:
    """Whether a handoff is to or from a denied agent at least `LATE_S` into an outage."""
    moments = [
        handoff[what] for end, what in (("from", "lost_s"), ("to", "entered_s")) if handoff[end] in names
    ]
    return any(b + LATE_S <= t < end for t in moments for b, end in source.outages_s)


def _summary(results: list[dict[str, Any]]) -> dict[str, Any]:
    whole = [o for r in results for o in r["outages"] if "60" in o["error_m"]]
    errors = {mark: np.array([o["error_m"][mark] for o in whole]) for mark in ("10", "30", "60")}
    counted, completed = sum(r["counted"] for r in results), sum(r["completed"] for r in results)
    return {
        "handoffs": counted,
        "completed": completed,
        "share": completed / counted if counted else None,
        "share_ci95": wilson(completed, counted),
        "region_exits": sum(r["region_exits"] for r in results),
        "collisions": sum(r["collisions"] for r in results),
        "outages": len(whole),
        "position_error_p95_m": {k: float(np.percentile(e, 95.0)) for k, e in errors.items() if len(e)},
        "violations": sum(o["violated"] for o in whole),
        "likely_violations": sum(o["likely_violated"] for o in whole),
        "likely_violated_share": sum(o["likely_violated"] for o in whole) / len(whole) if whole else None,
        "premises_broken": sum(o["premise_broken"] for o in whole),
        "closest_to_bound": max((o["error_m"]["largest"] / o["bound_m"] for o in whole), default=None),
    }


def _ratio(row: dict[str, Any], known: dict[str, Any]) -> float | None:
    """Share of handoffs that a row completes, of that with external pose."""
    return row["share"] / known["share"] if row["share"] is not None and known["share"] else None


def wilson(good: int, count: int) -> list[float] | None:
    """Wilson's 95 % interval of a share."""
    if count == 0:
        return None
    z, p = 1.959964, good / count
    middle, wide = p + z * z / (2 * count), z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    return [(middle - wide) / (1 + z * z / count), (middle + wide) / (1 + z * z / count)]


def print_table(result: dict[str, Any]) -> None:
    """Print handoffs, errors and certificate."""
    out = sys.stdout
    out.write(
        f"{'own pose':12s} {'handoffs':>9s} {'completed':>10s} {'p95 error at 60 s':>18s} {'left region':>12s}\n"
    )
    for name, row in result["rows"].items():
        error = row["position_error_p95_m"].get("60")
        shown = "-" if error is None else f"{error:.2f} m"
        share = "-" if row["share"] is None else f"{100 * row['share']:.1f} %"
        out.write(f"{name:12s} {row['handoffs']:9d} {share:>10s} {shown:>18s} {row['region_exits']:12d}\n")
    for way, flights in result["alone"].items():
        for kind, marks in flights.items():
            words = ", ".join(f"{marks[f'{m:g}']:.2f} m after {m:g} s" for m in MARKS_S)
            out.write(f"alone, {way}, {kind}: 95 % below {words}\n")
    row, certificate = result["rows"]["calibrated"], result["certificate"]
    good = sum(t["verdict"] == "certified" for t in certificate["transitions"])
    out.write(f"certificate: {good} of {len(certificate['transitions'])} transitions certified; ")
    out.write(f"violated in {row['violations']} of {row['outages']} outages, ")
    out.write(
        f"95 % version in {row['likely_violations']}; stated premises broken in {row['premises_broken']}\n"
    )
