"""The files of a run: ``summary.json``, ``handoffs.json``, ``log.parquet`` and ``events.parquet``, checked when read.

``summary.json`` also seals all of them (`camnet.storage.seal`), so that a run folder is what a run wrote or is refused.
Runs from before there was a table of events have no seal of one, and are read without it. The real-time factor is no
part of the seal: equal runs have equal seals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from camnet.config.models import Scenario
from camnet.errors import DataError
from camnet.simulation.events import EVENT_FIELDS
from camnet.simulation.instruments import INSTRUMENTS
from camnet.simulation.log import RunLog
from camnet.simulation.log_columns import columns_of
from camnet.storage.json_file import read_json
from camnet.storage.records import read_records, write_records
from camnet.storage.seal import seal_of
from camnet.storage.table import read_table
from camnet.storage.whole_file import write_json
from camnet.types import Array

__all__ = ["RunFiles", "read_run", "write_run"]

_CONTENT = {"summary", "seed", "version", "config", "seals"}
_HANDOFF = {"target", "from", "to", "lost_s", "entered_s", "seen_s", "delay_s", "completed"}
#: absent in runs from before agents could lose their pose
_LOST_FOR = {"from_lost_for_s", "to_lost_for_s"}
#: columns of the truth that may be unknown, as nothing is certified; those of estimators are what they made of it
_MAY_BE_NAN = (".off_left_s", ".off_margin_m", ".size_sd")


@dataclass(frozen=True, eq=False, slots=True)
class RunFiles:
    """What a run folder holds.

    Attributes
    ----------
    scenario : what was run
    content : of ``summary.json``: summary, seed, version, config
    handoffs : of ``handoffs.json``
    columns : the log, name -> (rows,)
    events : the table of events (`camnet.simulation.events`); None: the run is from before there was one
    """

    scenario: Scenario
    content: dict[str, Any]
    handoffs: list[dict[str, Any]]
    columns: dict[str, Array]
    events: list[dict[str, Any]] | None


def write_run(
    folder: Path,
    content: Mapping[str, Any],
    handoffs: list[dict[str, Any]],
    log: RunLog,
    events: list[dict[str, Any]],
) -> None:
    """Write the four files; ``content`` has summary, seed, version and config."""
    columns = {name: log.values[:, i] for i, name in enumerate(log.columns)}
    write_json(folder / "handoffs.json", handoffs)
    log.write(folder / "log.parquet")
    write_records(folder / "events.parquet", EVENT_FIELDS, events)
    write_json(folder / "summary.json", {**content, "seals": _seals(content, handoffs, columns, events)})


def _seals(
    content: Mapping[str, Any],
    handoffs: list[dict[str, Any]],
    columns: Mapping[str, Array],
    events: list[dict[str, Any]] | None,
) -> dict[str, str]:
    summary = {k: v for k, v in content["summary"].items() if k != "real_time_factor"}
    return {
        "summary": seal_of({**content, "summary": summary}),
        "handoffs": seal_of(handoffs),
        "log": seal_of(None, columns),
        **({} if events is None else {"events": seal_of(events)}),
    }


def read_run(folder: Path) -> RunFiles:
    """Read a run folder.

    Raises
    ------
    DataError
        A file is missing, damaged, not of a run, or not what the run wrote; names the file and what is wrong in it.
    """
    path = folder / "summary.json"
    content = read_json(path)
    if not isinstance(content, dict) or set(content) != _CONTENT or not isinstance(content["summary"], dict):
        raise DataError(f"{path}: is not the summary of a run; camnet simulate writes one")
    seals = content.pop("seals")
    try:
        scenario = Scenario.model_validate(content["config"])
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise DataError(f"{path}: config.{where}: {first['msg']}") from error
    _check_summary(path, content["summary"], scenario)
    if not isinstance(seals, dict) or seals.get("summary") != _seals(content, [], {}, None)["summary"]:
        raise DataError(f"{path}: its content is not what the run wrote (its seal does not fit)")
    handoffs = read_json(folder / "handoffs.json")
    _check_handoffs(folder / "handoffs.json", handoffs, scenario)
    estimators = (content["summary"]["estimator_in_charge"], *content["summary"]["baselines"])
    names = [column.name for column in columns_of(scenario, estimators)]
    columns = read_table(folder / "log.parquet", names)
    estimates = tuple(f"{target.name}.{name}." for target in scenario.targets for name in estimators)
    told = tuple(f".{what}" for what in INSTRUMENTS)
    truth = {
        n: values for n, values in columns.items() if not n.startswith(estimates) and not n.endswith(told)
    }
    _check_log(folder / "log.parquet", truth)
    events = read_records(folder / "events.parquet", EVENT_FIELDS) if "events" in seals else None
    ending = {"summary": "json", "handoffs": "json"}
    for name, seal in _seals(content, handoffs, columns, events).items():
        if seals.get(name) != seal:
            file = folder / f"{name}.{ending.get(name, 'parquet')}"
            raise DataError(f"{file}: its content is not what the run wrote (its seal does not fit)")
    return RunFiles(scenario, content, handoffs, columns, events)


def _check_summary(path: Path, summary: dict[str, Any], scenario: Scenario) -> None:
    """See that the figures which are read back are there and possible; the seal answers for the rest."""

    def number(name: str, low: float, high: float = math.inf) -> None:
        value = summary.get(name)
        if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
            raise DataError(f"{path}: summary.{name} = {value!r}, expected a number in [{low:g}, {high:g}]")

    number("time_in_view", 0.0, 1.0)
    number("simulated_s", 0.0)
    number("collisions", 0.0)
    if summary.get("real_time_factor") is not None:
        number("real_time_factor", 0.0)
    if not isinstance(summary.get("interrupted"), bool):
        raise DataError(
            f"{path}: summary.interrupted = {summary.get('interrupted')!r}, expected true or false"
        )
    baselines = summary.get("baselines")
    known = set(scenario.run.estimators)
    if not isinstance(baselines, dict) or {*baselines, summary.get("estimator_in_charge")} != known:
        raise DataError(
            f"{path}: summary: its estimators are not those of the run, {', '.join(sorted(known))}"
        )
    for name in (
        "handoffs",
        "reacquisition_delay_s",
        "position_rmse_m",
        "orientation_rmse_deg",
        "dwell",
        "controller",
    ):
        if not isinstance(summary.get(name), dict):
            raise DataError(f"{path}: summary.{name} is missing")


def _check_handoffs(path: Path, handoffs: object, scenario: Scenario) -> None:
    if not isinstance(handoffs, list) or not all(
        isinstance(h, dict) and set(h) in (_HANDOFF, _HANDOFF | _LOST_FOR) for h in handoffs
    ):
        raise DataError(f"{path}: is not a list of handoffs")
    targets = {target.name for target in scenario.targets}
    for k, h in enumerate(handoffs):
        times = [h["lost_s"], h["entered_s"], *([] if h["seen_s"] is None else [h["seen_s"]])]
        right = all(isinstance(t, int | float) and not isinstance(t, bool) and t >= 0.0 for t in times)
        if h["target"] not in targets or not isinstance(h["completed"], bool) or not right:
            raise DataError(f"{path}: entry {k}: {h} is no handoff of this run")


def _check_log(path: Path, truth: Mapping[str, Array]) -> None:
    """See that the truth in a log is finite, its times increase and its quaternions are of length 1."""
    for name, values in truth.items():
        if not name.endswith(_MAY_BE_NAN) and not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise DataError(f"{path}: column {name!r}, row {row}: {values[row]} is not a finite number")
    if not (np.diff(truth["t_s"]) > 0.0).all():
        raise DataError(f"{path}: column 't_s': times do not increase")
    for name in truth:
        if name.endswith("_w"):
            parts = np.clip([truth[f"{name[:-1]}{axis}"] for axis in "wxyz"], -2.0, 2.0)
            if not np.allclose(np.sum(np.square(parts), axis=0), 1.0, atol=1e-6):
                raise DataError(f"{path}: columns '{name[:-1]}*': are no quaternions of length 1")
