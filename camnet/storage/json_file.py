"""JSON as RFC 8259 has it: no NaN, no Infinity, no doubled names, numbers and depth in bounds."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from camnet.errors import DataError
from camnet.storage.reading import read_bounded

__all__ = ["LIMIT_BYTES", "parse_json", "read_json"]

#: no JSON file of camnet is larger
LIMIT_BYTES = 256_000_000
_MOST_DEPTH = 64
_MOST_DIGITS = 40


class _WrongError(ValueError):
    """Something that JSON, or this reader, does not allow."""


def _constant(text: str) -> NoReturn:
    raise _WrongError(f"{text} is no number of JSON")


def _whole(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise _WrongError(f"a number of {len(text)} digits")
    return int(text)


def _real(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _WrongError(f"{text[:40]} is beyond the range of numbers")
    return value


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        doubled = next(name for name in names if names.count(name) > 1)
        raise _WrongError(f"name {doubled!r} stands there twice")
    return content


def parse_json(text: bytes, where: str) -> Any:  # noqa: ANN401 - JSON holds anything
    """Parse one JSON value in UTF-8.

    Raises
    ------
    DataError
        It is none; the message begins with ``where``.
    """
    try:
        content = json.loads(
            text.decode("utf-8"),
            parse_constant=_constant,
            parse_int=_whole,
            parse_float=_real,
            object_pairs_hook=_object,
        )
    except RecursionError:
        raise DataError(f"{where}: is nested too deeply") from None
    except ValueError as error:  # of encoding, syntax, or ours
        raise DataError(f"{where}: is not valid JSON ({error})") from error
    if _depth_exceeds(content, _MOST_DEPTH):
        raise DataError(f"{where}: is nested more than {_MOST_DEPTH} deep")
    return content


def _depth_exceeds(content: object, most: int) -> bool:
    level = [content]
    for _ in range(most):
        inner: list[object] = []
        for value in level:
            if isinstance(value, dict):
                inner.extend(value.values())
            elif isinstance(value, list):
                inner.extend(value)
        level = [value for value in inner if isinstance(value, dict | list)]
        if not level:
            return False
    return True


def read_json(path: Path, limit_bytes: int = LIMIT_BYTES) -> Any:  # noqa: ANN401 - JSON holds anything
    """Read a JSON file (DataError: absent, too large, not JSON)."""
    return parse_json(read_bounded(path, limit_bytes), str(path))
