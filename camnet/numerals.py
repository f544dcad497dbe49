"""Numbers as people and files write them, read strictly and in one way everywhere.

Python's own ``float`` and ``int`` take more than anybody means in a data file: ``nan``, ``1_000``, digits of other
scripts. Here a number is ASCII: a sign, digits with at most one decimal point, an exponent. Refusals say what would be
right.
"""

from __future__ import annotations

import math
import re

__all__ = ["LARGEST", "read_decimal", "read_whole"]

#: largest magnitude of any quantity in SI units, pixels or counts that a file may state
LARGEST = 1e12
#: longest text of a number
_LONGEST = 64
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE = re.compile(r"[+-]?[0-9]+")
_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]+)?")
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(?:[_' ,][0-9]{3})+(?:\.[0-9]+)?|[+-]?[0-9]+(?:_[0-9]+)+(?:\.[0-9]+)?")


def read_decimal(text: str, largest: float = LARGEST) -> float:
    """Read a finite decimal number.

    Parameters
    ----------
    text : the number; blanks around it are left out
    largest : largest magnitude allowed

    Raises
    ------
    ValueError
        Says what was expected instead, as the end of a sentence that quotes the text.
    """
    written = text.strip(" \t\r\n")
    if not _DECIMAL.fullmatch(written) or len(written) > _LONGEST:
        raise ValueError(_advice(written, "a decimal number"))
    value = float(written)
    if not math.isfinite(value) or abs(value) > largest:
        raise ValueError(f"a number between {-largest:g} and {largest:g} was expected")
    return value


def read_whole(text: str, low: int, high: int) -> int:
    """Read a whole number from ``low`` to ``high``.

    Raises
    ------
    ValueError
        Says what was expected instead, as the end of a sentence that quotes the text.
    """
    written = text.strip(" \t\r\n")
    if not _WHOLE.fullmatch(written) or len(written) > _LONGEST:
        raise ValueError(_advice(written, f"a whole number from {low} to {high}"))
    value = int(written)
    if not low <= value <= high:
        raise ValueError(f"a whole number from {low} to {high} was expected")
    return value


def _advice(written: str, what: str) -> str:
    if written.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        return "a finite number was expected"
    if _GROUPED.fullmatch(written):
        return f"{what} without separators between the digits was expected"
    if _COMMA.fullmatch(written):
        return f"{what} with a point, not a comma, was expected"
    if any(c.isdigit() and not c.isascii() for c in written):
        return f"{what} in the digits 0 to 9 was expected"
    return f"{what} was expected"
