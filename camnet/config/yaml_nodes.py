"""YAML to a tree that remembers where every value was written.

Errors about a configuration are only as good as their address, so parsing keeps, for every value, the file and
the line of its key. Scalars follow YAML 1.2's core rules (``1e-3`` is a number, ``yes`` and ``12:30`` are text);
only the standard tags are known; a repeated key is an error; anchors and aliases work.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import ComposerError

from camnet.errors import ConfigError

__all__ = ["FieldPath", "Node", "Origin", "Value", "field_text", "parse_yaml"]

FieldPath = tuple[str | int, ...]

Value = Any  #: None, bool, int, float, str, or lists and string-keyed dicts of these

_MAX_NODES = 200_000
_MAX_DEPTH = 40
_TOO_MUCH = f"too large or too deeply nested: at most {_MAX_NODES} values, {_MAX_DEPTH} levels"
_TAG = "tag:yaml.org,2002:"
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a value was written: a file (or the text of an override) and its line, counted from 1.

    ``folder`` is where relative paths written there start.
    """

    source: str
    line: int | None = None
    folder: Path | None = None

    def __str__(self) -> str:
        """``file:line``, or only the source when lines make no sense."""
        return self.source if self.line is None else f"{self.source}:{self.line}"


@dataclass(frozen=True, slots=True)
class Node:
    """A value with its origin; the items of dicts and lists are nodes again."""

    value: bool | int | float | str | dict[str, Node] | list[Node] | None
    origin: Origin

    def plain(self) -> Value:
        """Return the value without origins."""
        if isinstance(self.value, dict):
            return {key: child.plain() for key, child in self.value.items()}
        if isinstance(self.value, list):
            return [child.plain() for child in self.value]
        return self.value

    def child(self, key: str | int) -> Node | None:
        """Return the item ``key`` of a dict or list, or None when there is no such item."""
        if isinstance(self.value, dict) and isinstance(key, str):
            return self.value.get(key)
        if isinstance(self.value, list) and isinstance(key, int) and 0 <= key < len(self.value):
            return self.value[key]
        return None

    def leaves(self, path: FieldPath = ()) -> Iterator[tuple[FieldPath, Node]]:
        """Yield every scalar with its path."""
        if isinstance(self.value, dict):
            for key, child in self.value.items():
                yield from child.leaves((*path, key))
        elif isinstance(self.value, list):
            for index, item in enumerate(self.value):
                yield from item.leaves((*path, index))
        else:
            yield path, self


class _CoreLoader(yaml.SafeLoader):
    """Composes nodes with YAML 1.2 core scalars, up to a number and depth of nodes."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - the shape PyYAML asks for

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._count = self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose one node; a file that is too large fails before the rest of it is parsed."""
        self._count, self._depth = self._count + 1, self._depth + 1
        if self._count > _MAX_NODES or self._depth > _MAX_DEPTH:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise ComposerError(problem=_TOO_MUCH, problem_mark=mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node


for _name, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
):
    _CoreLoader.add_implicit_resolver(_TAG + _name, re.compile(rf"^(?:{_pattern})$"), _first)


def field_text(path: FieldPath) -> str:
    """Write a path as users do: ``cameras[0].intrinsics.fx_px``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def parse_yaml(text: str, origin: Origin, path: FieldPath = ()) -> Node:
    """Parse one YAML document.

    Parameters
    ----------
    text : the document
    origin : what its values come from, at its first line (line None: lines mean nothing there)
    path : the field that the document as a whole is the value of

    Raises
    ------
    ConfigError
        When the text is not one YAML document of standard tags with distinct text keys and finite numbers.
    """
    try:
        root = yaml.compose(text, Loader=_CoreLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = (
            origin if mark is None or origin.line is None else replace(origin, line=origin.line + mark.line)
        )
        raise ConfigError(f"{where}: not valid YAML: {error.problem or error.context}") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{origin.source}: not valid YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise ConfigError(f"{origin.source}: not valid YAML: nested too deeply") from None
    if root is None:
        return Node(None, origin)
    return _Converter(origin).convert(root, root.start_mark, path)


class _Converter:
    """Turns PyYAML's nodes into ours, counting them so that aliases cannot explode."""

    def __init__(self, start: Origin) -> None:
        self.start = start
        self.count = 0

    def convert(self, node: yaml.Node, mark: yaml.Mark, path: FieldPath) -> Node:
        """Convert ``node``; ``mark`` is where its key (or itself) begins."""
        origin = self._origin(mark)
        self.count += 1
        if self.count > _MAX_NODES or len(path) > _MAX_DEPTH:
            raise ConfigError(
                f"{origin}: too large or too deeply nested (an alias that contains itself?): "
                f"at most {_MAX_NODES} values, {_MAX_DEPTH} levels"
            )
        if isinstance(node, yaml.MappingNode):
            _check_tag(node, "map", origin, path)
            return Node(self._mapping(node, path), origin)
        if isinstance(node, yaml.SequenceNode):
            _check_tag(node, "seq", origin, path)
            items = [self.convert(item, item.start_mark, (*path, i)) for i, item in enumerate(node.value)]
            return Node(items, origin)
        assert isinstance(node, yaml.ScalarNode)
        return Node(_scalar(node, origin, path), origin)

    def _mapping(self, node: yaml.MappingNode, path: FieldPath) -> dict[str, Node]:
        result: dict[str, Node] = {}
        for key_node, value_node in node.value:
            origin = self._origin(key_node.start_mark)
            if not isinstance(key_node, yaml.ScalarNode):
                raise ConfigError(
                    f"{origin}: {field_text(path)}: a key must be plain text, not a list or mapping"
                )
            key = str(key_node.value)
            if key in result:
                first = result[key].origin.line
                raise ConfigError(
                    f"{origin}: {field_text((*path, key))}: key {key!r} is given twice"
                    f"{'' if first is None else f' (first in line {first})'}: keep one"
                )
            result[key] = self.convert(value_node, key_node.start_mark, (*path, key))
        return result

    def _origin(self, mark: yaml.Mark) -> Origin:
        return (
            self.start if self.start.line is None else replace(self.start, line=mark.line + self.start.line)
        )


def _check_tag(node: yaml.Node, wanted: str, origin: Origin, path: FieldPath) -> None:
    if node.tag != _TAG + wanted:
        raise ConfigError(
            f"{origin}: {field_text(path)}: unknown tag {node.tag!r}: only plain YAML values are read"
        )


def _scalar(node: yaml.ScalarNode, origin: Origin, path: FieldPath) -> bool | int | float | str | None:
    text = str(node.value)
    kind = node.tag.removeprefix(_TAG)
    if kind not in ("str", "null", "bool", "int", "float"):
        _check_tag(node, "str", origin, path)
    try:
        if kind == "str":
            text.encode("utf-8")  # half a surrogate pair is not text
            return text
        if kind == "null":
            return None
        if kind == "bool":
            return {"true": True, "false": False}[text.lower()]
        if kind == "int" and _LEADING_ZERO.fullmatch(text):
            raise ConfigError(
                f"{origin}: {field_text(path)}: value {text!r}: a number does not begin with 0 (octal or decimal?)"
            )
        if kind == "int" and text[:2] in ("0x", "0o"):
            raise ConfigError(
                f"{origin}: {field_text(path)}: value {text!r}: is hexadecimal or octal; give it in decimal"
            )
        if kind == "int":
            return int(text)
        number = float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        if math.isfinite(number):
            return number
    except (ValueError, KeyError):
        pass
    shown = text if len(text) <= 40 else text[:37] + "..."
    wanted = {"float": "number", "int": "whole number", "str": "text"}.get(kind, kind)
    raise ConfigError(f"{origin}: {field_text(path)}: value {shown!r}: a finite {wanted} was expected")
