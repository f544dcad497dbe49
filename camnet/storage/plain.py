"""Records of a program (dataclasses, named tuples and what they hold) as JSON and arrays, and back.

| value | form |
| --- | --- |
| None, truth value, whole number, text, finite number | itself |
| number that is not finite | ``{"is": "float", "of": "nan"}`` |
| array of numbers | ``{"is": "array", "of": NAME}``; the array is kept under that name |
| list, tuple | ``{"is": "list", "of": [...]}``, ``{"is": "tuple", "of": [...]}`` |
| mapping | ``{"is": "mapping", "of": [[key, value], ...]}`` |
| dataclass, named tuple | ``{"is": NAME OF ITS CLASS, "of": {field: value, ...}}`` |

Only classes that the reader names are made again, so that a file cannot make anything else.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camnet.errors import DataError

__all__ = ["from_plain", "to_plain"]

_Arrays = dict[str, NDArray[Any]]


def to_plain(value: object, arrays: _Arrays) -> Any:  # noqa: ANN401 - JSON
    """Return the form of a value; its arrays are added to ``arrays``.

    Raises
    ------
    TypeError
        The value is, or holds, something that the table does not have.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"is": "float", "of": repr(value)}
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"is": "array", "of": name}
    if isinstance(value, Mapping):
        return {"is": "mapping", "of": [[to_plain(k, arrays), to_plain(v, arrays)] for k, v in value.items()]}
    fields = _fields(value)
    if fields is not None:
        return {"is": type(value).__name__, "of": {k: to_plain(v, arrays) for k, v in fields.items()}}
    if isinstance(value, list | tuple):
        return {"is": type(value).__name__, "of": [to_plain(v, arrays) for v in value]}
    raise TypeError(f"{type(value).__name__} has no plain form")


def _fields(value: object) -> dict[str, Any] | None:
    """Fields of a dataclass or a named tuple."""
    if dataclasses.is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    names = getattr(value, "_fields", None)
    return None if names is None or not isinstance(value, tuple) else dict(zip(names, value, strict=True))


def from_plain(form: object, arrays: Mapping[str, NDArray[Any]], classes: Iterable[type]) -> Any:  # noqa: ANN401
    """Return the value of a form; records are made of ``classes``.

    Raises
    ------
    DataError
        The form is none, or of a class that is not among ``classes``.
    """
    by_name = {c.__name__: c for c in classes}
    try:
        return _value(form, arrays, by_name)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise DataError(f"no record in plain form: {error!r}") from error


def _value(form: Any, arrays: Mapping[str, NDArray[Any]], classes: Mapping[str, type]) -> Any:  # noqa: ANN401
    if not isinstance(form, dict):
        if isinstance(form, list):
            raise TypeError("a bare list")
        return form
    kind, of = form["is"], form["of"]
    if kind == "float":
        return float(of)
    if kind == "array":
        return arrays[of]
    if kind in ("list", "tuple"):
        values = [_value(v, arrays, classes) for v in of]
        return values if kind == "list" else tuple(values)
    if kind == "mapping":
        return {_value(k, arrays, classes): _value(v, arrays, classes) for k, v in of}
    return classes[kind](**{name: _value(v, arrays, classes) for name, v in of.items()})
