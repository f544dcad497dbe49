"""What a compiled function is made of: a digest of its own code and of all that it takes from elsewhere.

Numba keeps compiled code on disk until the *file* of the function changes. What the function calls is part of its
code too, and often lives in other files. The digest follows every name that the byte code reads:

| name stands for | part of the digest |
| --- | --- |
| a compiled function | its byte code and options, and so on with the names that it reads |
| an intrinsic, an instance of a class | the whole file that defines it (its class) |
| a number, a string, an array, a tuple of such | the value |
| a class | its name, and a named tuple's fields |
| anything else | its name |

Docstrings, comments and line numbers are left out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from sys import modules
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import extending as _extending
from numba.core import types as _types
from numba.core.dispatcher import Dispatcher as _Dispatcher

__all__ = ["fields_of", "source_digest"]

#: the inside of Numba has types in part only
types: Any = _types
extending: Any = _extending
_VALUES = (bool, int, float, complex, str, bytes, type(None), np.generic)


def source_digest(function: FunctionType, package: str) -> str | None:
    """Digest of a function that is compiled, and of all that it calls and reads.

    Parameters
    ----------
    function : the Python function, ``py_func`` of a compiled one
    package : name of a package

    Returns
    -------
    str or None
        The same for the same code in every process; another one once anything that is compiled into it has changed.
        None if neither the function nor any that it calls is of ``package``.
    """
    found, waiting = {function}, [function]
    total = hashlib.sha256()
    for current in waiting:
        text, calls = _direct(current)
        total.update(text)
        fresh = [f for f in dict.fromkeys(calls) if f not in found]
        found.update(fresh)
        waiting.extend(fresh)
    if any(f.__module__.split(".")[0] == package for f in found):
        return total.hexdigest()
    return None


def fields_of(of: Any) -> tuple[Any, ...]:  # noqa: ANN401 - one of Numba's types
    """Names of a named tuple's fields, in their order, with those of named tuples inside; of another type nothing.

    Numba tells two named tuples apart by their class and by the types of their fields alone.
    """
    if not isinstance(of, types.BaseNamedTuple):
        return ()
    return (of.fields, tuple(fields_of(field) for field in of.types))


@cache
def _direct(function: FunctionType) -> tuple[bytes, tuple[FunctionType, ...]]:
    """Return what a function itself is made of, and the compiled functions that it reads."""
    calls: list[FunctionType] = []
    parts = [_code(function.__code__, function.__doc__), repr(function.__defaults__)]
    for cell in function.__closure__ or ():
        parts.append(_value(cell.cell_contents, (), calls))
    names = tuple(dict.fromkeys(_names(function.__code__)))
    for name in names:
        if name in function.__globals__:
            parts.append(f"{name} = {_value(function.__globals__[name], names, calls)}")
    return "\n".join(parts).encode(), tuple(calls)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _code(code: CodeType, doc: str | None) -> str:
    constants = [_constant(c) for c in code.co_consts if doc is None or c != doc]
    return f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames} {code.co_freevars}"


def _constant(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, CodeType):
        return _code(value, None)
    return repr(sorted(map(repr, value))) if isinstance(value, frozenset) else repr(value)


def _value(value: Any, names: tuple[str, ...], calls: list[FunctionType]) -> str:  # noqa: ANN401
    """Describe what a name stands for; the compiled functions in it join ``calls``."""
    if isinstance(value, _Dispatcher):
        calls.append(value.py_func)
        return f"compiled with {sorted(value.targetoptions.items())}"
    if isinstance(value, _VALUES):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return str([_value(one, names, calls) for one in value])
    if isinstance(value, ModuleType):
        read = [n for n in names if n in vars(value)]
        return str([f"{n} = {_value(vars(value)[n], (), calls)}" for n in read])
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', '')}"
    if isinstance(value, extending._Intrinsic):
        return _file(value._defn.__module__)
    if hasattr(value, "__qualname__"):  # a function of Python's or of a library
        return f"{value.__module__}.{value.__qualname__}"
    return _file(type(value).__module__)


@cache
def _file(module: str) -> str:
    path = getattr(modules.get(module), "__file__", None)
    if path is None or not Path(path).is_file():
        return module
    return f"{module} {hashlib.sha256(Path(path).read_bytes()).hexdigest()}"
