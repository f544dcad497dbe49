from __future__ import annotations

from typing import Any

import yaml

from camnet.config import shipped_worlds
from camnet.config.models import Scenario
from camnet.config.schema import json_schema

SCHEMA = json_schema()


def resolved(schema: dict[str, Any]) -> dict[str, Any]:
    while "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    return schema


def fits(value: object, schema: dict[str, Any]) -> bool:
    """A validator of the part of JSON schema that pydantic writes for settings."""
    schema = resolved(schema)
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return any(fits(value, member) for member in schema[union])
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    match schema.get("type"):
        case "object":
            known, others = schema.get("properties", {}), schema.get("additionalProperties", False)
            return (
                isinstance(value, dict)
                and set(schema.get("required", [])) <= set(value)
                and all(
                    fits(item, known[key]) if key in known else bool(others) and fits(item, others)
                    for key, item in value.items()
                )
            )
        case "array":
            if not isinstance(value, list) or not (
                schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", 10**9)
            ):
                return False
            heads = schema.get("prefixItems", [])
            rest = schema.get("items", {})
            return all(fits(v, heads[i] if i < len(heads) else rest) for i, v in enumerate(value))
        case "number" | "integer" as kind:
            return (
                isinstance(value, int if kind == "integer" else int | float)
                and not isinstance(value, bool)
                and value > schema.get("exclusiveMinimum", -1e300)
                and schema.get("minimum", -1e300) <= value <= schema.get("maximum", 1e300)
            )
        case "string":
            return isinstance(value, str)
        case "null":
            return value is None
    return True


def test_shipped_worlds_fit_the_schema_and_broken_ones_do_not():
    for path in shipped_worlds().values():
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert fits(data, SCHEMA), path
        assert not fits({**data, "regionz": []}, SCHEMA)
        assert not fits({key: value for key, value in data.items() if key != "cameras"}, SCHEMA)
        assert not fits({**data, "run": {"duration_s": -1}}, SCHEMA)


def test_recipes_fit_the_schema(project_root):
    for path in sorted((project_root / "configs").glob("*.yaml")):
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert fits(data, SCHEMA), path
        assert not fits({**data, "runn": {}}, SCHEMA)


def test_the_schema_describes_what_editors_show():
    scenario = SCHEMA["$defs"]["Scenario"]
    assert set(scenario["properties"]) == set(Scenario.model_fields)
    assert scenario["additionalProperties"] is False
    assert SCHEMA["$defs"]["Region"]["description"].startswith("Operating region")
    assert SCHEMA["$defs"]["CameraModel"]["properties"]["near_m"]["description"] == "in metres"
    assert SCHEMA["$defs"]["Recipe"]["required"] == ["world"]


def test_every_reference_of_the_schema_leads_somewhere():
    def references(part: object) -> set[str]:
        if isinstance(part, dict):
            own = {part["$ref"]} if "$ref" in part else set()
            return own.union(*(references(item) for item in part.values()))
        return set().union(*(references(item) for item in part)) if isinstance(part, list) else set()

    names = {reference.removeprefix("#/$defs/") for reference in references(SCHEMA)}
    assert names <= set(SCHEMA["$defs"])
