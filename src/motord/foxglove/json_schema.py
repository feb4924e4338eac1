"""JSON Schema of a published message in the few forms that viewers understand.

They know neither references nor alternatives: every property has one type, and an object that may
be null has the type of the object.
"""

from typing import Any

from pydantic import BaseModel

_KEPT = ("type", "enum", "description")


def viewer_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the schema of `model`, called `title`."""
    schema = model.model_json_schema(mode="serialization")
    return {"title": title, **_plain(schema, schema.get("$defs", {}))}


def _plain(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in node:
        return _plain(definitions[node["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in node:
        return _plain(next(n for n in node["anyOf"] if n.get("type") != "null"), definitions)
    plain = {key: node[key] for key in _KEPT if key in node}
    if node.get("type") == "array":
        items = node.get("items") or node["prefixItems"][0]
        return {**plain, "items": _plain(items, definitions)}
    if node.get("type") == "object":
        properties = node.get("properties", {})
        return {
            **plain,
            "properties": {name: _plain(item, definitions) for name, item in properties.items()},
        }
    return plain
