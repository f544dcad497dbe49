"""From validation errors to messages: file, line, field, value, and what would be right."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from camnet.config.fields import annotation_at, data_path, field_names, model_at, plain_types, setting_paths
from camnet.config.units import convert, split_unit, text_with_unit
from camnet.config.yaml_nodes import FieldPath, Node, Value, field_text
from camnet.errors import CamnetError, ConfigError

__all__ = ["Problem", "find", "raise_problems", "show", "validate"]

_Model = TypeVar("_Model", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong: the field, its value as text (empty: it has none) and the advice."""

    path: FieldPath
    value: str
    advice: str

    def text(self, root: Node) -> str:
        """Write the message with the address that ``root`` knows for the field."""
        origin = find(root, self.path).origin
        value = f" value {self.value}:" if self.value else ""
        return f"{origin}: {field_text(self.path) or 'the document'}:{value} {self.advice}"


def find(root: Node, path: FieldPath) -> Node:
    """Return the node at ``path``, or the deepest one on the way there."""
    node = root
    for part in path:
        child = node.child(part)
        if child is None:
            break
        node = child
    return node


def show(value: Value) -> str:
    """Quote a value: texts whole up to a line or two, since they may be paths; the rest shortened."""
    if isinstance(value, str):
        return repr(value) if len(value) <= 300 else repr(value[:297]) + "..."
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 72 else text[:69] + "..."


def raise_problems(problems: Iterable[Problem], root: Node, kind: type[CamnetError] = ConfigError) -> None:
    """Raise one error that lists all problems; return when there are none."""
    lines = list(dict.fromkeys(problem.text(root) for problem in problems))
    if len(lines) == 1:
        raise kind(lines[0])
    if lines:
        raise kind("\n".join([f"{len(lines)} problems:", *(f"  {line}" for line in lines)]))


def validate(model: type[_Model], root: Node) -> _Model:
    """Validate data strictly (no text taken for a number, no unknown key).

    Raises
    ------
    ConfigError
        With one line for every problem found.
    """
    try:
        result = model.model_validate_json(json.dumps(root.plain()), strict=True)
    except ValidationError as error:
        problems = [
            _problem(model, root, dict(item))
            for item in error.errors(include_url=False, include_context=True)
        ]
        raise_problems(_without_echoes(problems), root)
        raise
    raise_problems(_large_angles(root), root)
    return result


def _without_echoes(problems: list[Problem]) -> list[Problem]:
    """Keep one problem a field; a wrong number of list items is reported by the list."""
    kept: dict[FieldPath, Problem] = {}
    for problem in problems:
        kept.setdefault(problem.path, problem)
    return list(kept.values())


def _large_angles(root: Node) -> list[Problem]:
    problems = []
    for path, leaf in root.leaves():
        name = next((part for part in reversed(path) if isinstance(part, str)), "")
        unit = split_unit(name)[1]
        number = leaf.value
        if unit is None or unit.words != "radians" or isinstance(number, bool):
            continue
        if isinstance(number, int | float) and abs(number) > 2 * math.pi:
            advice = f"more than a full turn in radians: degrees? {number} degrees are {math.radians(number):.6g} rad"
            problems.append(Problem(path, show(number), advice))
    return problems


def _problem(model: type[BaseModel], root: Node, error: Mapping[str, Any]) -> Problem:
    path = data_path(model, error["loc"], root)
    kind = error["type"]
    if kind == "extra_forbidden":
        return _unknown_key(model, root, path)
    if kind == "missing":
        return _missing(model, root, path)
    node = find(root, path)
    value = show(node.plain())
    if kind in ("too_long", "too_short") and isinstance(node.value, list):
        return Problem(path, value, _list_advice(model, path, root, error))
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _tag_problem(model, root, path, error)
    if kind == "literal_error":
        return Problem(path, value, _choice_advice(node.plain(), _choices(annotation_at(model, path, root))))
    if kind.endswith(("_type", "_parsing", "_from_float")):
        return Problem(path, value, _type_advice(model, root, path, node.plain()))
    message = re.sub(r"^(Input|Value error,|Assertion failed,) ?(should )?", "must ", str(error["msg"]))
    return Problem(path, value, message)


def _unknown_key(model: type[BaseModel], root: Node, path: FieldPath) -> Problem:
    """Advise on a key that does not exist: another unit, a misspelling, or the list of what exists."""
    key, parent = str(path[-1]), path[:-1]
    owner = model_at(model, parent, root)
    known = field_names(owner) if owner is not None else []
    node = find(root, path)
    place = f" in {field_text(parent)}" if parent else ""
    stem, unit = split_unit(key)
    for name in known:
        other, wanted = split_unit(name)
        if other == stem and wanted is not None:
            number = None if unit is None else convert(node.plain(), unit, wanted)
            hint = f"{name}: {number}" if number else repr(name)
            advice = f"unknown key {key!r}{place}: the unit here is {wanted.words}: write {hint}"
            return Problem(path, show(node.plain()), advice)
    meant = _meant(model, root, key, known)
    if meant:
        advice = f"did you mean {meant!r}?"
    else:
        advice = f"known keys: {', '.join(known)}" if known else "no keys are known here"
    return Problem(path, show(node.plain()), f"unknown key {key!r}{place}: {advice}")


def _meant(model: type[BaseModel], root: Node, key: str, known: list[str]) -> str | None:
    """Return what a key was meant to be: a setting elsewhere of that very name, a similar one here, or elsewhere."""
    close = difflib.get_close_matches(key, known, 1, 0.6)
    return _elsewhere(model, root, key, 1.0) or (close[0] if close else _elsewhere(model, root, key, 0.75))


def _elsewhere(model: type[BaseModel], root: Node, key: str, likeness: float) -> str | None:
    """Return the dotted path of a setting elsewhere whose name, with or without its unit, is like ``key``."""
    stem = split_unit(key)[0]
    paths: dict[str, str] = {}
    for path in sorted(setting_paths(model, root), key=len, reverse=True):  # the shortest path to a name wins
        if isinstance(path[-1], str):
            text = _written(path, root)
            paths[path[-1]] = text
            paths[split_unit(path[-1])[0]] = text
    found = [m for word in (key, stem) for m in difflib.get_close_matches(word, paths, 1, likeness)]
    return paths[found[0]] if found else None


def _written(path: FieldPath, root: Node) -> str:
    """Write a path as ``--set`` takes it, items of lists by their names."""
    parts: list[str] = []
    node: Node | None = root
    for part in path:
        node = None if node is None else node.child(part)
        name = None if node is None or not isinstance(part, int) else node.child("name")
        parts.append(str(part) if name is None else str(name.value))
    return ".".join(parts)


def _missing(model: type[BaseModel], root: Node, path: FieldPath) -> Problem:
    if path and isinstance(path[-1], int):  # a tuple with too few items
        node = find(root, path[:-1])
        return Problem(
            path[:-1], show(node.plain()), f"too short: {_expected(model, path[:-1], root)} expected"
        )
    owner = model_at(model, path[:-1], root)
    field = owner.model_fields.get(str(path[-1])) if owner is not None else None
    what = field.description if field is not None and field.description else _expected(model, path, root)
    return Problem(path, "", f"missing: give {what}")


def _list_advice(model: type[BaseModel], path: FieldPath, root: Node, error: Mapping[str, Any]) -> str:
    context = error.get("ctx", {})
    if error["type"] == "too_short":
        return f"too few items: at least {context.get('min_length')}"
    return f"too many items: {_expected(model, path, root)} expected"


def _tag_problem(model: type[BaseModel], root: Node, path: FieldPath, error: Mapping[str, Any]) -> Problem:
    context = error.get("ctx", {})
    key = str(context.get("discriminator", "'kind'")).strip("'")
    models = [m for m in plain_types(annotation_at(model, path, root)) if hasattr(m, "model_fields")]
    choices = [c for m in models if key in m.model_fields for c in _choices(m.model_fields[key].annotation)]
    if error["type"] == "union_tag_not_found":
        return Problem((*path, key), "", f"missing: give one of {', '.join(choices)}")
    given = find(root, (*path, key)).plain()
    return Problem((*path, key), show(given), _choice_advice(given, choices))


def _choices(annotation: Any) -> list[str]:  # noqa: ANN401 - a type expression
    return [
        str(choice)
        for member in plain_types(annotation)
        if get_origin(member) is Literal
        for choice in get_args(member)
    ]


def _choice_advice(given: Value, choices: list[str]) -> str:
    close = difflib.get_close_matches(str(given), choices, 1)
    advice = f"must be {choices[0]!r}" if len(choices) == 1 else f"must be one of {', '.join(choices)}"
    return f"{advice}: did you mean {close[0]!r}?" if close else advice


def _type_advice(model: type[BaseModel], root: Node, path: FieldPath, given: Value) -> str:
    name = next((part for part in reversed(path) if isinstance(part, str)), "")
    unit = split_unit(name)[1]
    number = text_with_unit(given) if isinstance(given, str) else None
    if number is not None and unit is not None:
        converted = convert(number[0], number[1], unit)
        if converted is not None:
            return f"a plain number in {unit.words} is expected: {converted}"
        return f"a plain number in {unit.words} is expected, not {number[1].words}"
    expected = _expected(model, path, root)
    return f"{expected} expected" + (f" (in {unit.words})" if unit is not None else "")


def _expected(model: type[BaseModel], path: FieldPath, root: Node) -> str:
    """Describe the type of a field in words."""
    members = plain_types(annotation_at(model, path, root))
    if not members:
        return "another kind of value is"
    return " or ".join(dict.fromkeys(_words(member) for member in members))


_WORDS = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}


def _words(annotation: Any) -> str:  # noqa: ANN401 - a type expression
    if get_origin(annotation) is tuple:
        arguments = get_args(annotation)
        inner = {float: "numbers", int: "whole numbers", str: "texts"}
        item = plain_types(arguments[0])[0]
        words = inner.get(item, "mappings" if hasattr(item, "model_fields") else "lists")
        return f"a list of {words}" if arguments[-1] is Ellipsis else f"a list of {len(arguments)} {words}"
    if get_origin(annotation) is Literal:
        return "one of " + ", ".join(str(choice) for choice in get_args(annotation))
    if hasattr(annotation, "model_fields"):
        return f"a mapping with {', '.join(field_names(annotation))}"
    return _WORDS.get(annotation, "a path")
