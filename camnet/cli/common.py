"""Options and habits that all commands share."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

__all__ = ["add_common", "add_scenario", "overrides", "positive", "progress_bar", "say"]


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add ``--json --out --seed --force --quiet``."""
    group = parser.add_argument_group("common options")
    group.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    group.add_argument("--out", metavar="DIR", help="folder to write (default: runs/<name>-seed<seed>)")
    group.add_argument(
        "--seed", type=int, metavar="N", help="fixes everything random (default: the file's, else 0)"
    )
    group.add_argument("--force", action="store_true", help="replace --out if it holds something already")
    group.add_argument("--quiet", action="store_true", help="no progress bar")


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Add the configuration and the ways to change it."""
    parser.add_argument(
        "config", help="a recipe or world file, a folder with world.yaml, or a shipped world's name"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="change one setting, e.g. --set targets.robot.motion.speed_mps=0.5 (repeatable)",
    )
    parser.add_argument("--duration", type=positive, metavar="S", help="simulated length, s (run.duration_s)")


def overrides(args: argparse.Namespace) -> list[str]:
    """All overrides of the command line as ``key=value``."""
    extra = [] if args.duration is None else [f"run.duration_s={args.duration:g}"]
    return [*args.overrides, *extra]


def positive(text: str) -> float:
    """Parse a positive finite number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number; give a positive number") from None
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"{text!r} is not positive; give a positive number")
    return value


@contextmanager
def progress_bar(total: float, words: str, unit: str, quiet: bool) -> Iterator[Any]:
    """Show a progress bar on standard error; yields a function that takes the progress so far, and words if any."""
    layout = "{desc}: {percentage:3.0f}% |{bar}| {n:.0f}/{total:.0f} {unit} [{elapsed}<{remaining}]{postfix}"
    with tqdm(
        total=total, desc=words, unit=unit, disable=quiet or None, file=sys.stderr, bar_format=layout
    ) as bar:

        def advance(done: float, words: str = "") -> None:
            if words:
                bar.set_postfix_str(words, refresh=False)
            bar.update(done - bar.n)

        yield advance


def say(words: str) -> None:
    """Tell the person at the terminal something (standard error; standard output is for results)."""
    print(words, file=sys.stderr, flush=True)
