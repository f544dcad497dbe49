"""``camnet log``: what a run's log and its table of events hold, as words, CSV or JSON."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from camnet.cli.arguments import whole
from camnet.cli.common import add_messages, positive, say
from camnet.cli.log_table import as_csv, as_json, chosen_columns, described, one_of_many
from camnet.cli.output import output_folder, print_json
from camnet.errors import ConfigError
from camnet.storage.whole_file import write_text

__all__ = ["add_parser"]

_DESCRIPTION = """Show the log of a run: its columns with their units and meanings, its numbers as CSV, or its events.

  camnet log runs/first                                      what is in it
  camnet log runs/first --columns                            the names of the columns, one a line
  camnet log runs/first --describe --only 'robot.p_*'        unit and meaning of some of them
  camnet log runs/first --csv --only 't_s,*.p_?_m' --every 10
  camnet log runs/first --events                             sightings, losses, handoffs, collisions
  camnet log runs/first --events --csv --out runs/table      events.csv in a folder

The same units and meanings are in the metadata of log.parquet and events.parquet (docs/log.md)."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "log",
        help="columns, units, numbers and events of a run",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="RUN", help="folder that camnet simulate wrote")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--csv", action="store_true", help="the numbers, on standard output or in --out")
    form.add_argument("--describe", action="store_true", help="name, unit and meaning of every column")
    form.add_argument("--columns", action="store_true", help="names of the columns, one a line")
    parser.add_argument("--events", action="store_true", help="the table of events instead of the log")
    parser.add_argument(
        "--only",
        metavar="NAMES",
        help="columns to show: names or patterns with * and ?, parted by commas (default: all)",
    )
    parser.add_argument("--from", dest="start", type=float, metavar="S", help="rows from this time on, s")
    parser.add_argument("--to", dest="end", type=positive, metavar="S", help="rows up to this time, s")
    parser.add_argument("--every", type=whole(1, 10**9), metavar="N", help="each N-th row (default: 1)")
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    parser.add_argument("--out", metavar="DIR", help="--csv: folder to write (default: standard output)")
    parser.add_argument(
        "--force", action="store_true", help="replace --out where it holds only what camnet wrote"
    )
    add_messages(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read the run, choose columns and rows, show them."""
    from camnet.report.run_data import load_run

    if args.out is not None and not args.csv:
        raise ConfigError(f"--out {args.out}: is where --csv writes; add --csv")
    if args.start is not None and args.end is not None and not args.start < args.end:
        raise ConfigError(f"--from {args.start:g} --to {args.end:g}: --from must be before --to")
    one_of_many(args.folder)
    table = chosen_columns(load_run(args.folder), args)
    if args.csv and not args.json:
        _csv(args, as_csv(table))
    elif args.json:
        print_json(as_json(table, numbers=args.csv or args.events))
    elif args.columns:
        print("\n".join(column.name for column in table.columns))
    elif args.describe:
        print(described(table))
    else:
        print(table.overview if not args.events else as_csv(table), end="")
    return 0


def _csv(args: argparse.Namespace, text: str) -> None:
    if args.out is None:
        sys.stdout.write(text)
        return
    with output_folder(args, "log") as output:
        assert output is not None  # --out is given
        name = "events.csv" if args.events else "log.csv"
        write_text(output.path / name, text)
    say(f"wrote {output.folder / name}")
