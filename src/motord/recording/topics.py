"""The topics of a recording: schema, channel and layout of the messages of each."""

import json
from dataclasses import dataclass
from typing import Any

from mcap.records import Channel, Schema

from motord.schema import TICK, TRUTH, Record
from motord.wire.ticks.blocks import BlockCodec

PROTOBUF = "protobuf"
JSON = "json"
JSON_SCHEMA = "jsonschema"
MESSAGE_BYTES = "message_bytes"
"""Key of a channel's metadata: the length that all its messages have."""


@dataclass(frozen=True)
class Topic:
    """A topic: its channel number (also that of its schema), name and schema."""

    number: int
    name: str
    schema_name: str
    schema_encoding: str
    schema_data: bytes
    message_encoding: str
    record: Record | None = None  # of messages of fixed layout

    def schema(self) -> Schema:
        """Return the MCAP record of its schema."""
        return Schema(
            id=self.number,
            name=self.schema_name,
            encoding=self.schema_encoding,
            data=self.schema_data,
        )

    def channel(self) -> Channel:
        """Return the MCAP record of its channel."""
        size = {MESSAGE_BYTES: str(BlockCodec(self.record).size)} if self.record else {}
        return Channel(
            id=self.number,
            topic=self.name,
            message_encoding=self.message_encoding,
            metadata=size,
            schema_id=self.number,
        )


def _block_topic(number: int, record: Record) -> Topic:
    descriptor = BlockCodec(record).descriptor_set()
    name = f"motord.{record.name}"
    return Topic(number, f"/{record.name.lower()}", name, PROTOBUF, descriptor, PROTOBUF, record)


def _json_topic(number: int, name: str, title: str, properties: dict[str, Any]) -> Topic:
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "type": "object",
        "properties": {"t_ns": {"type": "integer", "description": "Unix time, ns"}, **properties},
        "required": ["t_ns"],
    }
    data = json.dumps(schema, indent=1).encode()
    return Topic(number, name, title, JSON_SCHEMA, data, JSON)


def _number(description: str) -> dict[str, str]:
    return {"type": "number", "description": description}


def _integer(description: str) -> dict[str, str]:
    return {"type": "integer", "description": description}


def _text(description: str) -> dict[str, str]:
    return {"type": "string", "description": description}


TICKS = _block_topic(1, TICK)
TRUTHS = _block_topic(2, TRUTH)
EVENTS = _json_topic(
    3,
    "/event",
    "motord.Event",
    {
        "kind": _text("what sort of event, one word"),
        "message": _text("what happened"),
        "data": {"type": "object", "description": "its particulars"},
    },
)
PLANS = _json_topic(4, "/plan", "motord.Plan", {})
OPERATING_POINTS = _json_topic(
    5,
    "/operating_point",
    "motord.OperatingPoint",
    {
        "index": _integer("plan_point of its ticks"),
        "torque_Nm": _number("torque set-point"),
        "speed_Hz": _number("speed set-point, turns a second"),
        "tick_start": _integer("first tick"),
        "tick_end": _integer("last tick, included"),
        "t_start_ns": _integer("t_ns of the first tick"),
        "t_end_ns": _integer("t_ns of the last tick"),
        "turns": _number("turns captured"),
        "speed_mean_Hz": _number("mean speed, turns a second"),
        "quality": _text("ok, or what is wrong with it"),
        "compensate": _integer("what was compensated: 1 currents, 2 cogging"),
        "take": _integer("which take of the point this is; of several the last good one counts"),
    },
)
ALL = (TICKS, TRUTHS, EVENTS, PLANS, OPERATING_POINTS)
"""All topics. Their numbers are promises: a file whose beginning is damaged is read by them."""
