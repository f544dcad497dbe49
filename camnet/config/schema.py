"""JSON schema of world files and recipes, for editors that complete and check YAML."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

from pydantic import TypeAdapter

from camnet.config.models import Scenario
from camnet.config.recorded import RecordedScenario
from camnet.config.units import split_unit

__all__ = ["json_schema"]


def json_schema() -> dict[str, Any]:
    """Return the schema (draft 2020-12) that a world file, a recording or a recipe fulfils.

    Descriptions are the docstrings of the settings classes; numbers also name their unit. A recipe may leave out
    every section, because the world that it names has them.
    """
    schema = TypeAdapter(Scenario | RecordedScenario).json_schema()
    definitions: dict[str, Any] = schema["$defs"]
    definitions["Recipe"] = _recipe(definitions["Scenario"])
    for definition in definitions.values():
        _describe_units(definition)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "camnet world file or recipe",
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in ("Scenario", "RecordedScenario", "Recipe")],
        "$defs": definitions,
    }


def _recipe(scenario: dict[str, Any]) -> dict[str, Any]:
    recipe = copy.deepcopy(scenario)
    recipe["title"] = "Recipe"
    recipe["description"] = "Sections merged over the world that ``world`` names (a shipped name, or a path)."
    recipe["properties"]["world"] = {"type": "string", "title": "World"}
    recipe["required"] = ["world"]
    return recipe


def _describe_units(definition: dict[str, Any]) -> None:
    for name, field in _properties(definition):
        unit = split_unit(name)[1]
        if unit is not None and "description" not in field:
            field["description"] = f"in {unit.words}"


def _properties(definition: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    yield from definition.get("properties", {}).items()
