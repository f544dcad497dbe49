"""JSON schema of world files and recipes, for editors that complete and check YAML."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import TypeAdapter

from camnet.config.models import Scenario
from camnet.config.recorded import RecordedScenario
from camnet.config.units import split_unit

__all__ = ["json_schema"]

_PARTIAL = "Partial"


def json_schema() -> dict[str, Any]:
    """Return the schema (draft 2020-12) that a world file, a recording or a recipe fulfils.

    Descriptions are the docstrings of the settings classes; numbers also name their unit. A recipe may leave out
    whatever the world that it names has, at any depth.
    """
    schema = TypeAdapter(Scenario | RecordedScenario).json_schema()
    definitions: dict[str, Any] = schema["$defs"]
    definitions["RecordedScenario"]["required"].remove("data")  # usually given with --set
    for definition in definitions.values():
        _describe_units(definition)
    partial = {f"{_PARTIAL}{name}": _partial(definition) for name, definition in definitions.items()}
    definitions["Recipe"] = _recipe(partial.pop(f"{_PARTIAL}Scenario"))
    definitions.update(partial)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "camnet world file or recipe",
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in ("Scenario", "RecordedScenario", "Recipe")],
        "$defs": definitions,
    }


def _recipe(partial: dict[str, Any]) -> dict[str, Any]:
    world = {"type": "string", "title": "World", "description": "a shipped world's name, or a path"}
    return {
        **partial,
        "title": "Recipe",
        "description": "Sections merged over the world that ``world`` names.",
        "properties": {"world": world, **partial["properties"]},
        "required": ["world"],
    }


def _partial(schema: Any) -> Any:  # noqa: ANN401 - any part of a schema
    """Copy a part of a schema with nothing required, for what is merged over something else."""
    if isinstance(schema, list):
        return [_partial(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    copied = {key: _partial(item) for key, item in schema.items() if key not in ("required", "discriminator")}
    if "oneOf" in copied:  # without its kind, a mapping may fit several members of a union
        copied["anyOf"] = copied.pop("oneOf")
    if "$ref" in copied:
        copied["$ref"] = copied["$ref"].replace("#/$defs/", f"#/$defs/{_PARTIAL}")
    if "name" in copied.get("properties", {}):
        copied["properties"]["remove"] = {"const": True, "description": "take the item of this name away"}
    return copied


def _describe_units(definition: dict[str, Any]) -> None:
    for name, field in _properties(definition):
        unit = split_unit(name)[1]
        if unit is not None and "description" not in field:
            field["description"] = f"in {unit.words}"


def _properties(definition: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    yield from definition.get("properties", {}).items()
