"""What a compiled function is made of: a digest of its own code and of all that it takes from elsewhere.

What a function calls is part of its code too, and often lives in other files. The digest follows every name that the
byte code reads:

| name stands for | part of the digest |
| --- | --- |
| a compiled function | its byte code and options, and so on with the names that it reads |
| an intrinsic, an instance of a class | the whole file that defines it (its class), and what the instance says itself |
| a number, a string, an array, a tuple of such | the value |
| a class | its name, and a named tuple's fields |
| anything else | its name |

Docstrings, comments and line numbers are left out. An instance that stands for more than the file of its class has a
method ``compiled_source`` that says so (`layout_text` for a named tuple).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from sys import modules
from types import CodeType, FunctionType, ModuleType
from typing import Any, get_type_hints

import numpy as np
from numba import extending as _extending
from numba.core import types as _types
from numba.core.dispatcher import Dispatcher as _Dispatcher

__all__ = ["layout_text", "source_digest", "type_text"]

#: the inside of Numba has types in part only
types: Any = _types
extending: Any = _extending
_VALUES = (bool, int, float, complex, str, bytes, type(None), np.generic)


def source_digest(function: FunctionType) -> str:
    """Digest of a function that is compiled, and of all that it calls and reads.

    Parameters
    ----------
    function : the Python function, ``py_func`` of a compiled one

    Returns
    -------
    str
        The same for the same code in every process; another one once anything that is compiled into it has changed.
    """
    found, waiting = {function}, [function]
    total = hashlib.sha256()
    for current in waiting:
        text, calls = _direct(current)
        total.update(text)
        fresh = [f for f in dict.fromkeys(calls) if f not in found]
        found.update(fresh)
        waiting.extend(fresh)
    return total.hexdigest()


def type_text(of: Any) -> str:  # noqa: ANN401 - one of Numba's types
    """Describe a type for a name on disk: with the class and the fields' names of named tuples, and of those inside.

    Numba's own name of a named tuple tells its class's name and the fields' types alone.
    """
    text = f"{type(of).__name__} {of}"
    if isinstance(of, types.BaseNamedTuple):
        made = of.instance_class
        inside = [type_text(field) for field in of.types]
        return f"{text} of {made.__module__}.{made.__qualname__} {of.fields} {inside}"
    if isinstance(of, types.BaseTuple):
        return f"{text} {[type_text(field) for field in of]}"
    return text


def layout_text(made: type, seen: tuple[type, ...] = ()) -> str:
    """Describe a class of named tuples: its fields and their annotations, and those of named tuples inside."""
    text = f"{made.__module__}.{made.__qualname__}"
    if not hasattr(made, "_fields") or made in seen:
        return text
    try:
        hints = get_type_hints(made)
    except NameError:  # names that only a type checker sees
        hints = dict(made.__annotations__)
    inside = [
        f"{name}: {layout_text(of, (*seen, made)) if isinstance(of, type) else of}"
        for name, of in hints.items()
    ]
    return f"{text}({', '.join(inside)})"


@cache
def _direct(function: FunctionType) -> tuple[bytes, tuple[FunctionType, ...]]:
    """Return what a function itself is made of, and the compiled functions that it reads."""
    calls: list[FunctionType] = []
    defaults = (function.__defaults__, function.__kwdefaults__)
    parts = [_code(function.__code__, function.__doc__), repr(defaults)]
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
    counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return f"{code.co_code.hex()} {code.co_exceptiontable.hex()} {counts} {constants} {names}"


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
    text = _file(type(value).__module__)
    return f"{text} {value.compiled_source()}" if hasattr(value, "compiled_source") else text


@cache
def _file(module: str) -> str:
    path = getattr(modules.get(module), "__file__", None)
    if path is None or not Path(path).is_file():
        return module
    return f"{module} {hashlib.sha256(Path(path).read_bytes()).hexdigest()}"
