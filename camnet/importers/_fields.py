"""Named fields of a file that holds a tree (YAML, JSON, XML): every read names the file, the field and the value."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from camnet.errors import DataError
from camnet.importers._reading import number, open_binary, quoted
from camnet.numerals import LARGEST, read_whole
from camnet.types import Array

__all__ = ["Fields", "json_content", "yaml_content"]

#: longest YAML file, bytes: camera files are small, and the parser is slow
_LONGEST_YAML = 4_000_000
_DEEPEST = 40


@dataclass(frozen=True)
class Fields:
    """A mapping of a file. Leaves are text or nested lists of text, read as numbers by one strict rule.

    Attributes
    ----------
    where : the file
    content : fields by their names
    path : names that lead here, with points between and behind
    """

    where: str
    content: Mapping[str, Any]
    path: str = ""

    def __contains__(self, name: str) -> bool:
        return name in self.content

    def at(self, name: str) -> str:
        """Return file and full name of a field, for messages."""
        return f"{self.where}: {self.path}{name}"

    def one_of(self, names: Sequence[str]) -> str | None:
        """Return which of several spellings of a field is there; two of them are an error."""
        found = [name for name in names if name in self.content]
        if len(found) > 1:
            raise DataError(f"{self.at(found[1])}: means the same as {found[0]}; leave one of them out")
        return found[0] if found else None

    def need(self, name: str) -> Any:  # noqa: ANN401 - a tree
        """Return the value of a field; DataError without it."""
        if name not in self.content:
            has = ", ".join(list(self.content)[:12]) or "none"
            raise DataError(f"{self.at(name)}: is missing; the fields here are {has}")
        return self.content[name]

    def child(self, name: str) -> Fields:
        """Return the mapping below a field."""
        value = self.need(name)
        if not isinstance(value, dict):
            raise DataError(f"{self.at(name)}: is {quoted(str(value))}; fields with names were expected")
        return Fields(self.where, value, f"{self.path}{name}.")

    def children(self, name: str) -> list[Fields]:
        """Return the mappings of a list."""
        value = self.need(name)
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise DataError(f"{self.at(name)}: is {quoted(str(value))}; a list of objects was expected")
        return [Fields(self.where, item, f"{self.path}{name}[{k}].") for k, item in enumerate(value)]

    def text(self, name: str) -> str:
        """Return a text that is not empty."""
        value = self.need(name)
        if not isinstance(value, str) or not value.strip():
            raise DataError(f"{self.at(name)}: is {quoted(str(value))}; a text was expected")
        return value.strip()

    def number(self, name: str, largest: float = LARGEST) -> float:
        """Return a finite number."""
        value = self.need(name)
        if not isinstance(value, str):
            raise DataError(f"{self.at(name)}: is {quoted(str(value))}; a number was expected")
        return number(value, self.where, self.path + name, largest)

    def whole(self, name: str, low: int, high: int) -> int:
        """Return a whole number from ``low`` to ``high``; ``640.`` counts as one, as OpenCV writes it."""
        value = self.need(name)
        try:
            if not isinstance(value, str):
                raise ValueError(f"a whole number from {low} to {high} was expected")
            return read_whole(value.rstrip("0").removesuffix(".") if "." in value else value, low, high)
        except ValueError as error:
            raise DataError(f"{self.at(name)}: is {quoted(str(value))}; {error}") from None

    def numbers(self, name: str, counts: Sequence[int]) -> list[float]:
        """Return the numbers of a list, however nested; their count must be one of ``counts``."""
        flat = _flat(self.need(name))
        if flat is None or len(flat) not in counts:
            had = "no list of numbers" if flat is None else f"{len(flat)} numbers"
            wanted = " or ".join(map(str, counts))
            raise DataError(f"{self.at(name)}: holds {had}; {wanted} were expected")
        return [number(text, self.where, self.path + name) for text in flat]

    def matrix(self, name: str, rows: int, columns: int) -> Array:
        """Return a matrix: rows in a list, or all its numbers row by row."""
        return np.reshape(self.numbers(name, (rows * columns,)), (rows, columns))


def _flat(value: object) -> list[str] | None:
    if isinstance(value, str):
        return [value]
    if not isinstance(value, list):
        return None
    parts = [_flat(item) for item in value]
    return None if any(part is None for part in parts) else [text for part in parts for text in part or ()]


class _TextLoader(yaml.BaseLoader):
    """Leaves stay text; tags are left aside; repeated names and aliases are errors."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(
                None, None, "holds an alias; plain values were expected", event.start_mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        twice = [name for k, name in enumerate(names) if name in names[:k]]
        if twice:
            raise yaml.MarkedYAMLError(None, None, f"the field {twice[0]!r} is there twice", node.start_mark)
        return super().construct_mapping(node, deep=deep)


def yaml_content(path: Path) -> Fields:
    """Read a YAML file, OpenCV's old header ``%YAML:1.0`` included; leaves stay text.

    Raises
    ------
    DataError
        No YAML, no mapping, a repeated name, an alias, or a file that is far too large for what it claims to be.
    """
    with open_binary(path) as stream:
        data = stream.read(_LONGEST_YAML + 1)
    if len(data) > _LONGEST_YAML:
        raise DataError(f"{path}: more than {_LONGEST_YAML:,} bytes; a camera file was expected")
    try:
        text = data.decode("utf-8-sig")
        first, _, rest = text.partition("\n")
        content = yaml.load(rest if first.startswith("%YAML:") else text, _TextLoader)
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: byte {data[error.start]:#04x} is not UTF-8 text") from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark is not None else 1
        raise DataError(f"{path}, line {line}: {error.problem or 'not YAML'}") from None
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as error:
        raise DataError(
            f"{path}: not YAML ({str(error).splitlines()[0] if str(error) else 'nested too deep'})"
        ) from None
    return _mapping(content, path)


def json_content(path: Path, what: str) -> Any:  # noqa: ANN401 - a tree
    """Read a JSON file; numbers stay text, so that one strict rule reads them.

    Raises
    ------
    DataError
        No JSON, or a name that is there twice in one object; ``what`` says what was expected.
    """
    with open_binary(path) as stream:
        data = stream.read()
    try:
        return json.loads(
            data, parse_float=str, parse_int=str, parse_constant=str, object_pairs_hook=_without_repeats
        )
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: is no JSON ({error}); {what} was expected") from None


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(
            f"the name {next(n for n in names if names.count(n) > 1)!r} is there twice in one object"
        )
    return content


def _mapping(content: object, path: Path) -> Fields:
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise DataError(f"{path}: holds no fields with names; a camera file was expected")
    return Fields(str(path), content)
