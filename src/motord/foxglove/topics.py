"""The topics that the bridge serves, with the schema of each."""

import json
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from motord.api.messages import BenchState
from motord.api.plan_messages import MeshView, PlanView
from motord.api.published_message import PublishedMessage
from motord.foxglove.decimation import EXTREMES_NAME, extremes_descriptor_set
from motord.recording import topics as recorded

RATE_HZ = 50.0
"""At most so many messages a second of a topic, events apart; viewers slow down above 60."""

_KEPT = ("type", "enum", "description")
"""What is kept of a property in a JSON Schema."""


@dataclass(frozen=True)
class ServedTopic:
    """A topic: name, encoding of its messages, and their schema."""

    name: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


def _recorded(topic: recorded.Topic) -> ServedTopic:
    channel, schema = topic.channel, topic.schema
    return ServedTopic(
        channel.topic, channel.message_encoding, schema.name, schema.encoding, schema.data
    )


def _document(name: str, title: str, model: type[PublishedMessage]) -> ServedTopic:
    schema = json.dumps(_viewer_schema(model, title)).encode()
    return ServedTopic(name, recorded.JSON, title, recorded.JSON_SCHEMA, schema)


def _viewer_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the schema of `model`, called `title`, in the few forms that viewers understand.

    They know neither references nor alternatives: every property has one type, and an object that
    may be null has the type of the object.
    """
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


TICK = _recorded(recorded.TICKS)
EXTREMES = ServedTopic(
    "/tick_extremes",
    recorded.PROTOBUF,
    EXTREMES_NAME,
    recorded.PROTOBUF,
    extremes_descriptor_set(),
)
STATE = _recorded(recorded.STATES)
BENCH = _document("/bench", "motord.BenchState", BenchState)
EVENT = _recorded(recorded.EVENTS)
PLAN = _document("/plan", "motord.Plan", PlanView)
MESH = _document("/mesh", "motord.Mesh", MeshView)
SERVED = (TICK, EXTREMES, STATE, BENCH, EVENT, PLAN, MESH)
