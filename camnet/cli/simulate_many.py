"""The part of ``camnet simulate`` that runs many seeds: in parallel, resumable, with a table over all of them."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camnet import __version__
from camnet.cli.common import named_seeds, progress_bar, say, warn
from camnet.cli.output import print_json, resumed_folder, write_json
from camnet.config.models import Scenario
from camnet.errors import DataError
from camnet.report import REPORT_FILES
from camnet.simulation.log import RunLog
from camnet.simulation.run_files import read_run, write_run
from camnet.storage.marker import MARKER
from camnet.storage.partial import replaced_folder

__all__ = ["run_and_write"]

#: summary, handoffs, log and events of a run
_Done = tuple[dict[str, Any], list[dict[str, Any]], RunLog, list[dict[str, Any]]]

_RUN = ("summary.json", "handoffs.json", "log.parquet", "events.parquet", MARKER, *REPORT_FILES)
_FILES = ("summary.json", *(f"seed-*/{name}" for name in _RUN))


def run_and_write(args: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Run every seed that is not there yet, then write and print the table."""
    seeds = list(named_seeds(args, scenario.seed))
    with resumed_folder(folder, "simulate-seeds", _FILES, args.force) as locked:
        content = _run_missing(args, scenario, locked, seeds)
        write_json(locked / "summary.json", content)
    if args.json:
        print_json(content)
    else:
        _print(content)
    say(f"wrote {folder}")
    return 0


def _run_missing(
    args: argparse.Namespace, scenario: Scenario, folder: Path, seeds: list[int]
) -> dict[str, Any]:
    """Run what is not there, and put the table together."""
    wanted = [s for s in seeds if not _finished(folder, scenario, s)]
    if len(wanted) < len(seeds):
        say(f"{len(seeds) - len(wanted)} of {len(seeds)} seeds are there already and are kept")
    if wanted and args.on.shares_files:
        _compile(scenario)
    with progress_bar(len(seeds), "seeds", "seeds", args.quiet) as advance:
        advance(len(seeds) - len(wanted))
        work: Callable[[int], _Done | None] = (
            partial(_one, scenario, folder) if args.on.shares_files else partial(_run, scenario)
        )
        with args.on.workers(args.jobs or 2) as workers:
            for done, (k, result) in enumerate(workers.finished(work, wanted), start=1):
                if result is not None:
                    _write(scenario, folder, wanted[k], result)
                advance(len(seeds) - len(wanted) + done)
    summaries = {s: read_run(folder / f"seed-{s}").content["summary"] for s in seeds}
    return {
        "aggregate": _aggregate(list(summaries.values())),
        "runs": {str(s): summary for s, summary in summaries.items()},
        "version": __version__,
        "config": scenario.model_dump(mode="json"),
    }


def _compile(scenario: Scenario) -> None:
    """Run a moment here, so that the workers do not compile the same."""
    from camnet.simulation.run import run_network

    moment = scenario.run.model_copy(update={"duration_s": 1.0})
    run_network(scenario.model_copy(update={"run": moment}), scenario.seed)


def _one(scenario: Scenario, folder: Path, seed: int) -> None:
    """Run one seed in a worker and write its folder (no pictures)."""
    _write(scenario, folder, seed, _run(scenario, seed))


def _run(scenario: Scenario, seed: int) -> _Done:
    """Run one seed."""
    from camnet.simulation.run import run_network

    result = run_network(scenario, seed)
    if result.interrupted:  # in the main process, with one job
        raise KeyboardInterrupt
    return result.summary, result.handoffs, result.log, result.events


def _write(scenario: Scenario, folder: Path, seed: int, result: _Done) -> None:
    """Write the folder of a seed; on a cluster the machine that gave the command does."""
    summary, handoffs, log, events = result
    with replaced_folder(folder / f"seed-{seed}", "simulate") as temporary:
        config = scenario.model_copy(update={"seed": seed}).model_dump(mode="json")
        content = {"summary": summary, "seed": seed, "version": __version__, "config": config}
        write_run(temporary, content, handoffs, log, events)


def _finished(folder: Path, scenario: Scenario, seed: int) -> bool:
    """Whether this seed was run before with the same settings and version; a damaged run counts as absent."""
    run = folder / f"seed-{seed}"
    if not os.path.lexists(run):
        return False
    try:
        content = read_run(run).content
    except DataError as error:
        warn(f"{error}; seed {seed} is run again")
        return False
    config = scenario.model_copy(update={"seed": seed}).model_dump(mode="json")
    return bool((content["config"], content["seed"], content["version"]) == (config, seed, __version__))


def _aggregate(summaries: list[dict[str, Any]]) -> dict[str, Any]:
    """Totals over seeds, and the mean and the worst of every error row."""
    attempted = sum(s["handoffs"]["attempted"] for s in summaries)
    completed = sum(s["handoffs"]["completed"] for s in summaries)
    driving = summaries[0]["estimator_in_charge"]
    rows = {
        driving: summaries,
        **{name: [s["baselines"][name] for s in summaries] for name in summaries[0]["baselines"]},
    }
    return {
        "seeds": len(summaries),
        "handoffs": {"attempted": attempted, "completed": completed},
        "handoff_success": completed / attempted if attempted else None,
        "collisions": sum(s["collisions"] for s in summaries),
        "region_exits": sum(s["region_exits"] for s in summaries),
        "time_in_view": float(np.mean([s["time_in_view"] for s in summaries])),
        "bound_exceeded": sum(s["controller"].get("bound_exceeded", 0) for s in summaries),
        "max_error_m": max((s["controller"].get("max_error") or 0.0) for s in summaries),
        "position_rmse_m": {name: _row(row, "position_rmse_m") for name, row in rows.items()},
        "orientation_rmse_deg": {name: _row(row, "orientation_rmse_deg") for name, row in rows.items()},
    }


def _row(summaries: list[dict[str, Any]], what: str) -> dict[str, dict[str, float] | None]:
    result: dict[str, dict[str, float] | None] = {}
    for when in ("seen", "unseen", "unseen_first_lap"):
        values = [s[what][when] for s in summaries if s[what][when] is not None]
        result[when] = {"mean": float(np.mean(values)), "max": float(np.max(values))} if values else None
    return result


def _print(content: dict[str, Any]) -> None:
    total = content["aggregate"]
    done = total["handoffs"]
    print(f"{total['seeds']} seeds: {done['completed']} of {done['attempted']} handoffs completed, ", end="")
    print(
        f"{total['collisions']} collisions, {total['region_exits']} exits, in view {total['time_in_view']:.1%}"
    )
    print("position RMSE, mean (worst) over seeds, m      seen       unseen lap 1     unseen lap 3 on")
    for name, row in total["position_rmse_m"].items():
        cells = [row[when] for when in ("seen", "unseen_first_lap", "unseen")]
        texts = ["      –       " if c is None else f"{c['mean']:.3f} ({c['max']:.3f})" for c in cells]
        print(f"  {name:40s} " + "   ".join(f"{t:>14s}" for t in texts))
