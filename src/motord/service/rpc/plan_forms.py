"""The settings of a plan as a form needs them: type, unit, default, limits, choices, one line.

All of it is in the plan's section of the bench file: bounds in the types, the line as the string
below a field, or its description; the unit is the end of its name.
"""

from typing import Any

from motord.api.replies import SettingField
from motord.attribute_docs import described
from motord.config.base import Section
from motord.config.unit_suffixes import unit_of

_TYPES = {
    "number": "number",
    "integer": "integer",
    "boolean": "boolean",
    "string": "text",
    "object": "object",
}


def setting_fields(section: Section) -> list[SettingField]:
    """Return the settings of a section with the values that it has as defaults."""
    schema = type(section).model_json_schema()
    return _fields(type(section), schema, schema.get("$defs", {}), section.model_dump(mode="json"))


def _fields(
    section: type[Section],
    schema: dict[str, Any],
    definitions: dict[str, Any],
    defaults: dict[str, Any],
) -> list[SettingField]:
    lines = described(section)
    return [
        SettingField(
            name=name,
            unit=unit_of(name),
            default=defaults.get(name),
            help=content.get("description", lines.get(name, "")),
            **_type_of(content, definitions),
        )
        for name, content in schema["properties"].items()
    ]


def _type_of(content: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    """Return type, limits and choices of a value by its JSON schema."""
    if "anyOf" in content:
        [some] = [one for one in content["anyOf"] if one.get("type") != "null"]
        return {**_type_of(some, definitions), "optional": True}
    if "enum" in content:
        return {"type": "choice", "choices": list(content["enum"])}
    if content.get("type") == "array":
        return _list_type(content, definitions)
    return {
        "type": _TYPES.get(content.get("type", ""), "other"),
        **_limit(content, "minimum", "exclusiveMinimum"),
        **_limit(content, "maximum", "exclusiveMaximum"),
    }


def _list_type(content: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    one = content["prefixItems"][0] if "prefixItems" in content else content["items"]
    lengths = {"length_min": content.get("minItems", 0), "length_max": content.get("maxItems")}
    if "$ref" in one:
        columns = definitions[one["$ref"].rpartition("/")[2]]["properties"]
        return {"type": "table", "columns": list(columns), **lengths}
    return {**_type_of(one, definitions), "type": "list", **lengths}


def _limit(content: dict[str, Any], included: str, excluded: str) -> dict[str, Any]:
    if excluded in content:
        return {included: content[excluded], f"{included}_excluded": True}
    return {included: content[included]} if included in content else {}
