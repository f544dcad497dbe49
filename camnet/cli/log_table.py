"""Rows and columns that ``camnet log`` was asked for, and the forms in which it shows them."""

from __future__ import annotations

import argparse
import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from camnet.cli.parser import suggestion
from camnet.errors import ConfigError, DataError
from camnet.report.run_data import RunData
from camnet.simulation.events import EVENT_COLUMNS, KINDS
from camnet.simulation.log_columns import LogColumn, columns_of

__all__ = ["Table", "as_csv", "as_json", "chosen_columns", "described", "one_of_many"]


@dataclass(frozen=True, slots=True)
class Table:
    """Chosen rows and columns.

    Attributes
    ----------
    columns : what they mean
    values : one list per column; None is an empty cell
    overview : a few lines on the whole run
    """

    columns: Sequence[LogColumn]
    values: Sequence[Sequence[Any]]
    overview: str


def one_of_many(folder: Path) -> None:
    """Refuse the folder of many seeds with a word on which one to take (ConfigError)."""
    runs = sorted(p.name for p in folder.glob("seed-*")) if folder.is_dir() else []
    if runs and not (folder / "log.parquet").exists():
        raise ConfigError(f"{folder}: holds {len(runs)} runs; name one of them, such as {folder / runs[0]}")


def chosen_columns(run: RunData, args: argparse.Namespace) -> Table:
    """Choose by ``--events``, ``--only``, ``--from``, ``--to`` and ``--every``.

    Raises
    ------
    ConfigError
        A pattern of ``--only`` fits no column.
    DataError
        There is no table of events in this run.
    """
    columns: Sequence[LogColumn]
    if args.events:
        if run.events is None:
            raise DataError(
                f"{run.folder}: this run is from before there was a table of events; simulate it again for one"
            )
        columns = EVENT_COLUMNS
        everything = {c.name: [row[c.name] for row in run.events] for c in columns}
    else:
        columns = columns_of(run.network.scenario, run.filters)
        everything = {c.name: [*map(_cell, run.columns[c.name].tolist())] for c in columns}
    chosen = [c for c in columns if c.name in _fitting(args.only, [c.name for c in columns])]
    t_s = np.array(everything["t_s"], dtype=float)
    start, end = (-math.inf if args.start is None else args.start, math.inf if args.end is None else args.end)
    rows = np.flatnonzero((t_s >= start) & (t_s <= end))[:: args.every or 1].tolist()
    return Table(chosen, [[everything[c.name][k] for k in rows] for c in chosen], _overview(run))


def _cell(value: float) -> float | None:
    """Return a number, and none for what is none."""
    return value if math.isfinite(value) else None


def _fitting(only: str | None, names: Sequence[str]) -> set[str]:
    if only is None:
        return set(names)
    found: set[str] = set()
    for pattern in (part.strip() for part in only.split(",")):
        fits = {name for name in names if name == pattern or fnmatchcase(name, pattern)}
        if not fits:
            known = suggestion(pattern, names, 0.6 if len(names) < 20 else 0.0)  # 157 names help nobody
            raise ConfigError(f"--only {pattern!r}: no such column; {known}")
        found |= fits
    return found


def _overview(run: RunData) -> str:
    t_s, names = run.t_s, list(run.columns)
    lines = [
        f"{run.network.scenario.name}, seed {run.network.scenario.seed}",
        f"rows      {len(t_s)}" + (f", from {t_s[0]:g} to {t_s[-1]:g} s" if len(t_s) else ""),
        f"columns   {len(names)} (--columns: names; --describe: units and meanings)",
        f"targets   {', '.join(run.targets) or '–'}; estimators {', '.join(run.filters)}",
        f"agents    {', '.join(run.agents) or '–'}",
    ]
    if run.events is None:
        lines.append("events    none kept: this run is from before there was a table of them")
    else:
        count = Counter(row["event"] for row in run.events)
        lines.append(f"events    {', '.join(f'{kind} {count[kind]}' for kind in KINDS)} (--events)")
    return "\n".join(lines) + "\n"


def described(table: Table) -> str:
    """Return name, unit and meaning, one column a line."""
    width = max(len(c.name) for c in table.columns)
    return "\n".join(f"{c.name:{width}s}  {c.unit:4s} {c.description}" for c in table.columns)


def as_csv(table: Table) -> str:
    """Return CSV; numbers read back to the last bit, empty cells are unknown."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([c.name for c in table.columns])
    writer.writerows(zip(*[[_written(v) for v in column] for column in table.values], strict=True))
    return stream.getvalue()


def _written(value: object) -> object:
    return str(value).lower() if isinstance(value, bool) else value


def as_json(table: Table, numbers: bool) -> dict[str, Any]:
    """Return units and meanings, and the numbers where they are asked for."""
    described = {c.name: {"unit": c.unit, "description": c.description} for c in table.columns}
    if not numbers:
        return {"columns": described}
    values = {c.name: list(v) for c, v in zip(table.columns, table.values, strict=True)}
    return {"columns": described, "values": values}
