"""Texts of the command line to numbers: strict, bounded, with messages that say what would be right.

Each function is a ``type`` of argparse: it returns the value or raises ``argparse.ArgumentTypeError``. Digits are
ASCII; ``1_000``, ``nan`` and ``inf``, which Python's own conversions take, are refused.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from camnet.errors import ConfigError
from camnet.numerals import read_decimal, read_whole

__all__ = ["MAX_SEED", "MAX_SEEDS", "Seeds", "non_negative", "numbers", "positive", "seed", "seeds", "whole"]

#: largest seed of the command line: what 32 bits hold
MAX_SEED = 2**32 - 1
#: most seeds of one command
MAX_SEEDS = 10_000

_RANGE = re.compile(r"([0-9]{1,18})(?:-([0-9]{1,18}))?")


def _real(text: str, what: str) -> float:
    try:
        return read_decimal(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number; give {what}, such as 2.5") from None


def positive(text: str) -> float:
    """Parse a finite number > 0."""
    value = _real(text, "a positive number")
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not positive; give a positive number")
    return value


def non_negative(text: str) -> float:
    """Parse a finite number >= 0."""
    value = _real(text, "a number from 0 on")
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is negative; give a number from 0 on")
    return value


def whole(least: int, most: int) -> Callable[[str], int]:
    """Return a parser of whole numbers from ``least`` to ``most``."""

    def parse(text: str) -> int:
        try:
            return read_whole(text, least, most)
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"{text!r}: give a whole number from {least} to {most}"
            ) from None

    return parse


def numbers(option: str, text: str, names: Sequence[str], example: str) -> list[float]:
    """Parse numbers with commas between them, one for each name.

    Raises
    ------
    ConfigError
        Names the option, quotes the text and shows an example.
    """
    parts = text.split(",")
    try:
        if len(parts) != len(names):
            raise ValueError(f"{len(names)} numbers were expected, not {len(parts)}")
        return [read_decimal(part) for part in parts]
    except ValueError as error:
        raise ConfigError(f"{option} {text!r}: {error}: give {','.join(names)}, such as {example}") from None


def seed(text: str) -> int:
    """Parse one seed, 0 to ``MAX_SEED``."""
    return whole(0, MAX_SEED)(text)


@dataclass(frozen=True, slots=True)
class Seeds:
    """The seeds that ``--seeds`` names: a count (from ``--seed`` on), or the seeds themselves."""

    text: str
    count: int | None
    named: tuple[int, ...] = ()

    def numbers(self, first: int) -> tuple[int, ...]:
        """Return the seeds in ascending order; a count starts at ``first``."""
        return self.named if self.count is None else tuple(range(first, first + self.count))


def seeds(text: str) -> Seeds:
    """Parse ``10`` (ten seeds, from ``--seed`` on), ``1-10``, or ``1,4,9-12``."""
    stripped = text.replace(" ", "")
    if re.fullmatch(r"[0-9]{1,18}", stripped):
        return Seeds(stripped, _bounded(int(stripped), text))
    spans = [_span(part, text) for part in stripped.split(",")]
    _bounded(sum(high - low + 1 for low, high in spans), text)
    return Seeds(stripped, None, tuple(sorted({s for low, high in spans for s in range(low, high + 1)})))


def _span(part: str, text: str) -> tuple[int, int]:
    match = _RANGE.fullmatch(part)
    low, high = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if high < low:
        raise argparse.ArgumentTypeError(
            f"{text!r}: give a count (10), a range (1-10) or a list (1,4,9-12) of seeds from 0 on"
        )
    if high > MAX_SEED:
        raise argparse.ArgumentTypeError(
            f"{text!r}: seed {high} is too large; give seeds from 0 to {MAX_SEED}"
        )
    return low, high


def _bounded(count: int, text: str) -> int:
    if not 1 <= count <= MAX_SEEDS:
        raise argparse.ArgumentTypeError(f"{text!r}: {count} seeds; give 1 to {MAX_SEEDS} of them")
    return count
