"""Pydantic models as tables: key, type, unit, default, limits, meaning."""

import json
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from tools.reference.markdown import code, table

from motord.attribute_docs import described
from motord.config import unit_suffixes

SYMBOLS = {"us": "µs", "kg m2": "kg m²", "degC": "°C", "ohm": "Ω"}
"""Of units, for people."""
TYPES = {
    "string": "text",
    "integer": "whole number",
    "number": "number",
    "boolean": "`true` or `false`",
    "object": "table",
    "null": "`null`",
}
FORMATS = {"path": "path", "date-time": "date and time"}
BOUNDS = {
    "minimum": "≥\N{NO-BREAK SPACE}{}",
    "exclusiveMinimum": ">\N{NO-BREAK SPACE}{}",
    "maximum": "≤\N{NO-BREAK SPACE}{}",
    "exclusiveMaximum": "<\N{NO-BREAK SPACE}{}",
}
COUNTS = {"minItems": "at least {}", "maxItems": "at most {}", "maxLength": "at most {} characters"}


def unit_of(name: str) -> str:
    """Return the unit that a name ends with, "" if it has none."""
    quantity = re.sub(r"_(min|max|p50|p99)$", "", name)
    unit = unit_suffixes.unit_of(name) or unit_suffixes.unit_of(quantity)
    return SYMBOLS.get(unit, unit)


def fields(model: type[BaseModel], links: dict[str, str], values: BaseModel | None = None) -> str:
    """Return the fields of a model that is written, their defaults those of `values` if given.

    links: names of models, and what stands for each where it is the type of a field.
    """
    schema = properties(model)
    meaning = described(model)
    rows = []
    for name, field in model.model_fields.items():
        kinds = list(_alternatives(schema[name]))
        types = " or ".join(dict.fromkeys(type_of(kind, links) for kind in kinds))
        limits = dict.fromkeys(part for kind in kinds for part in limits_of(kind))
        rows.append(
            (
                code(name),
                ", ".join([types, *limits]),
                unit_of(name) if "number" in types else "",
                default_of(name, field.get_default(call_default_factory=True), values),
                meaning.get(name, ""),
            )
        )
    return table(("key", "type", "unit", "default", "meaning"), rows)


def output_fields(model: type[BaseModel], links: dict[str, str]) -> str:
    """Return the fields of a model that is read: without defaults and limits."""
    schema, meaning = properties(model), described(model)
    rows = []
    for name in model.model_fields:
        kinds = schema[name].get("anyOf") or [schema[name]]
        types = " or ".join(dict.fromkeys(type_of(kind, links) for kind in kinds))
        unit = unit_of(name) if "number" in types else ""
        rows.append((code(name), types, unit, meaning.get(name, "")))
    return table(("key", "type", "unit", "meaning"), rows)


@cache
def properties(model: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON schema of each field of a model."""
    found: dict[str, Any] = model.model_json_schema().get("properties", {})
    return found


def _alternatives(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the types that a field may have, without what stands for a value that is left out."""
    for one in schema.get("anyOf") or schema.get("oneOf") or [schema]:
        if one.get("type") != "null" and one.get("maxItems") != 0:
            yield one


def type_of(schema: dict[str, Any], links: dict[str, str]) -> str:
    """Return the description of a field's type."""
    if reference := schema.get("$ref"):
        name = reference.rpartition("/")[2]
        return {"JsonValue": "any value", **links}[name]  # a model that is on no page is an error
    if "enum" in schema or "const" in schema:
        return ", ".join(code(json.dumps(one)) for one in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        return _list_type(schema, links)
    if isinstance(of := schema.get("additionalProperties"), dict):
        return f"table of {type_of(of, links)}"
    return FORMATS.get(schema.get("format", ""), TYPES.get(schema.get("type", ""), "any value"))


def _list_type(schema: dict[str, Any], links: dict[str, str]) -> str:
    items = schema.get("prefixItems") or [schema.get("items", {})]
    alternatives = [kind for one in items for kind in one.get("anyOf") or [one]]
    of = " or ".join(dict.fromkeys(type_of(one, links) for one in alternatives))
    return f"{len(items)} x {of}" if "prefixItems" in schema else f"list of {of}"


def limits_of(schema: dict[str, Any]) -> Iterator[str]:
    """Yield the limits of a field, then those of its elements."""
    for key, text in (BOUNDS | COUNTS).items():
        if key in schema and not ("prefixItems" in schema and key.endswith("Items")):
            yield text.format(f"{schema[key]:.6g}" if abs(schema[key]) < 1e6 else schema[key])
    items = schema.get("prefixItems") or [schema.get("items") or schema.get("additionalProperties")]
    for one in items:
        if isinstance(one, dict):
            for kind in _alternatives(one):
                yield from limits_of(kind)


def default_of(name: str, default: Any, values: BaseModel | None) -> str:
    """Return a default as the file would have it; nothing for a table or what may be left out."""
    if values is not None:
        default = getattr(values, name)
    if default is PydanticUndefined:
        return "**required**"
    if default is None or isinstance(default, BaseModel):
        return ""
    if isinstance(default, tuple | list) and any(isinstance(one, BaseModel) for one in default):
        return ""
    return code(json.dumps(default, default=str, ensure_ascii=False))
