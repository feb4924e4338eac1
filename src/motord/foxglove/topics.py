"""The topics that the bridge serves, with the schema of each."""

import json
from dataclasses import dataclass

from motord.api.messages import BenchState
from motord.api.plan_messages import MeshView, PlanView
from motord.api.published_message import PublishedMessage
from motord.foxglove.decimation import EXTREMES_NAME, extremes_descriptor_set
from motord.foxglove.json_schema import viewer_schema
from motord.recording import topics as recorded

RATE_HZ = 50.0
"""Messages a second of a topic, events apart; viewers slow down above 60."""


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
    schema = json.dumps(viewer_schema(model, title)).encode()
    return ServedTopic(name, recorded.JSON, title, recorded.JSON_SCHEMA, schema)


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
