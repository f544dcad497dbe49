"""Formulas from configuration files: numbers, names, arithmetic and functions of one or two numbers, nothing else.

A formula is parsed with Python's grammar, each node of its tree is looked at, and what is no part of a formula is
refused; nothing of it is ever executed as a program.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.errors import ConfigError
from camnet.types import Array

__all__ = ["Expression", "parse_expression"]

_CONSTANTS = {"pi": np.pi, "e": np.e}
_ONE: dict[str, Callable[[Any], Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "abs": np.abs,
    "sign": np.sign,
    "floor": np.floor,
}
_TWO: dict[str, Callable[[Any, Any], Any]] = {
    "atan2": np.arctan2,
    "hypot": np.hypot,
    "min": np.minimum,
    "max": np.maximum,
}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.Mod: np.mod,
}
#: longest formula, characters, and deepest nesting
_LONGEST, _DEEPEST = 2000, 50

_Value = Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, eq=False, slots=True)
class Expression:
    """A formula.

    Attributes
    ----------
    text : as it was written
    names : the variables in it
    """

    text: str
    names: frozenset[str]
    _value: _Value

    def __call__(self, values: Mapping[str, Any]) -> Array:
        """Return the value for numbers or arrays of one shape, by name; NaN where it has none."""
        with np.errstate(all="ignore"):
            return np.asarray(self._value(values), dtype=np.float64)


def parse_expression(text: str | float, names: frozenset[str] | set[str]) -> Expression:
    """Parse a formula of the variables ``names``.

    Raises
    ------
    ConfigError
        It is no formula; the message quotes the part that is not, and says what is possible.
    """
    source = str(text).strip()
    if not 0 < len(source) <= _LONGEST:
        raise ConfigError(f"{source[:40]!r}: a formula of 1 to {_LONGEST} characters was expected")
    try:
        tree = ast.parse(source, mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise ConfigError(f"{source!r}: is no formula: {error}; {_advice(names)}") from None
    used: set[str] = set()
    value = _compiled(tree.body, source, names, used, 0)
    return Expression(source, frozenset(used), value)


def _advice(names: frozenset[str] | set[str]) -> str:
    functions = ", ".join([*_ONE, *_TWO])
    return f"a formula has numbers, {', '.join(sorted(names))}, pi, e, + - * / % **, and {functions}"


def _compiled(
    node: ast.expr, source: str, names: frozenset[str] | set[str], used: set[str], depth: int
) -> _Value:
    if depth > _DEEPEST:
        raise ConfigError(f"{source!r}: nested more than {_DEEPEST} deep")

    def inner(part: ast.expr) -> _Value:
        return _compiled(part, source, names, used, depth + 1)

    if (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    ):
        number = float(node.value)
        return lambda _: number
    if isinstance(node, ast.Name) and node.id in names:
        name = node.id
        used.add(name)
        return lambda values: values[name]
    if isinstance(node, ast.Name) and node.id in _CONSTANTS:
        constant = _CONSTANTS[node.id]
        return lambda _: constant
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        sign, part = (-1.0 if isinstance(node.op, ast.USub) else 1.0), inner(node.operand)
        return lambda values: sign * part(values)
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        joined, left, right = _BINARY[type(node.op)], inner(node.left), inner(node.right)
        return lambda values: joined(left(values), right(values))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        return _call(node, source, inner, names)
    part_text = ast.get_source_segment(source, node) or source
    hint = (
        "; powers are written **" if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor) else ""
    )
    raise ConfigError(f"{source!r}: {part_text!r} is no part of a formula{hint}; {_advice(names)}")


def _call(
    node: ast.Call, source: str, inner: Callable[[ast.expr], _Value], names: frozenset[str] | set[str]
) -> _Value:
    assert isinstance(node.func, ast.Name)
    name, count = node.func.id, len(node.args)
    if name in _ONE and count == 1:
        one, part = _ONE[name], inner(node.args[0])
        return lambda values: one(part(values))
    if name in _TWO and count == 2:
        two, first, second = _TWO[name], inner(node.args[0]), inner(node.args[1])
        return lambda values: two(first(values), second(values))
    if name in _ONE or name in _TWO:
        raise ConfigError(f"{source!r}: {name} takes {1 if name in _ONE else 2} numbers, not {count}")
    raise ConfigError(f"{source!r}: {name!r} is no function; {_advice(names)}")
