"""Options and habits that all commands share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from camnet.cli.arguments import MAX_SEED, positive, seed, seeds
from camnet.cli.messages import LEVELS, say, warn
from camnet.errors import ConfigError
from camnet.processes.place import LOCAL, Place, read_place

__all__ = [
    "add_common",
    "add_messages",
    "add_place",
    "add_scenario",
    "add_seeds",
    "add_set",
    "named_seeds",
    "overrides",
    "positive",
    "progress_bar",
    "say",
    "warn",
]


def add_common(parser: argparse.ArgumentParser, out: str = "nothing is written") -> None:
    """Add ``--json --out --seed --force --quiet --log-level``; ``out`` says what is written without ``--out``."""
    group = parser.add_argument_group("common options")
    group.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    group.add_argument("--out", metavar="DIR", help=f"folder to write (default: {out})")
    group.add_argument(
        "--seed",
        type=seed,
        metavar="N",
        help="fixes everything random, from 0 on (default: the file's, else 0)",
    )
    group.add_argument(
        "--force",
        action="store_true",
        help="replace --out, or start it anew, where it holds only what camnet wrote",
    )
    add_messages(group)


def add_place(parser: argparse._ActionsContainer) -> None:
    """Add ``--on``: where the work is done."""
    parser.add_argument(
        "--on",
        type=_place,
        default=LOCAL,
        metavar="WHERE",
        help="who does the work: local (processes, the default), ray (a Ray cluster of this machine), or ray:ADDRESS "
        "(one that runs already); results are the same",
    )


def _place(text: str) -> Place:
    try:
        return read_place(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("--on ")) from None


def add_messages(parser: argparse._ActionsContainer) -> None:
    """Add ``--quiet`` and ``--log-level``."""
    parser.add_argument("--quiet", action="store_true", help="on standard error only warnings and errors")
    parser.add_argument(
        "--log-level",
        choices=LEVELS,
        default="warning",
        metavar="LEVEL",
        help=f"least severe message of the library to show: {', '.join(LEVELS)} (default: warning)",
    )


def add_seeds(parser: argparse.ArgumentParser, words: str) -> None:
    """Add ``--seeds``, which means the same in every command."""
    parser.add_argument(
        "--seeds",
        type=seeds,
        metavar="SEEDS",
        help=f"{words}: a count (10: ten seeds, from --seed on), a range (1-10) or a list (1,4,9-12)",
    )


def named_seeds(args: argparse.Namespace, default: int = 0) -> tuple[int, ...]:
    """Return the seeds of ``--seeds``; a count starts at ``--seed``, or at ``default`` without it.

    Raises
    ------
    ConfigError
        ``--seeds`` names its seeds and ``--seed`` is given too.
    """
    if args.seeds.count is None and args.seed is not None:
        raise ConfigError(
            f"--seed {args.seed} and --seeds {args.seeds.text}: the seeds are named already; leave --seed out"
        )
    numbers: tuple[int, ...] = args.seeds.numbers(default if args.seed is None else args.seed)
    if numbers[-1] > MAX_SEED:
        raise ConfigError(
            f"--seeds {args.seeds.text}: seed {numbers[-1]} is too large; seeds end at {MAX_SEED}"
        )
    return numbers


def add_set(parser: argparse.ArgumentParser) -> None:
    """Add ``--set``."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="change one setting, e.g. --set targets.robot.motion.speed_mps=0.5 (repeatable; keys: camnet worlds NAME)",
    )


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Add the configuration and the ways to change it."""
    parser.add_argument(
        "config", help="a recipe or world file, a folder with world.yaml, or a shipped world's name"
    )
    add_set(parser)
    parser.add_argument("--duration", type=positive, metavar="S", help="simulated length, s (run.duration_s)")


def overrides(args: argparse.Namespace) -> list[str]:
    """All overrides of the command line as ``key=value``.

    Raises
    ------
    ConfigError
        ``--duration`` and ``--set run.duration_s`` are both given.
    """
    if args.duration is None:
        return list(args.overrides)
    for text in args.overrides:
        if text.partition("=")[0].strip() == "run.duration_s":
            raise ConfigError(
                f"--duration {args.duration:g} and --set {text}: both set run.duration_s; give one"
            )
    return [*args.overrides, f"run.duration_s={args.duration!r}"]


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
