"""The topics of a recording: schema, channel and layout of the messages of each."""

import json
from dataclasses import dataclass, field, replace
from typing import Any

from mcap.records import Channel, Schema

from motord.recording import event_log
from motord.recording.json_encoding import JsonSchema
from motord.schema import TICK, TRUTH, Record
from motord.wire.ticks.blocks import codec_of
from motord.wire.ticks.proto_text import descriptor_set

FORMAT = "1"
"""Version of what the metadata records and topics mean; readers refuse one they do not know."""

METADATA = "motord"
METADATA_END = "motord.end"

PROTOBUF = "protobuf"
JSON = "json"
JSON_SCHEMA = "jsonschema"
MESSAGE_BYTES = "message_bytes"
"""Key of a channel's metadata: the length that all its messages have."""


@dataclass(frozen=True)
class Topic:
    """A topic: its MCAP records, which have one number, and what its messages look like.

    record: layout of the messages, if it is fixed.
    """

    schema: Schema
    channel: Channel
    record: Record | None = None
    content: JsonSchema = field(default_factory=dict)
    """JSON Schema of its messages, if they are JSON."""

    @property
    def number(self) -> int:
        """The number of its channel, also that of its schema."""
        return self.channel.id

    @property
    def name(self) -> str:
        """The name in the file."""
        return self.channel.topic


def _block_topic(number: int, record: Record) -> Topic:
    size = {MESSAGE_BYTES: str(codec_of(record).size)}
    topic = f"/{record.name.lower()}"
    return Topic(
        Schema(
            data=descriptor_set(record), encoding=PROTOBUF, id=number, name=f"motord.{record.name}"
        ),
        Channel(id=number, message_encoding=PROTOBUF, metadata=size, schema_id=number, topic=topic),
        record,
    )


def _json_topic(
    number: int,
    name: str,
    title: str,
    properties: dict[str, Any],
    *,
    required: tuple[str, ...] = (),
    schema_name: str = "",
) -> Topic:
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "type": "object",
        "properties": {"t_ns": _property("integer", "Unix time, ns"), **properties},
        "required": ["t_ns", *required],
    }
    data = json.dumps(schema, indent=1).encode()
    return Topic(
        Schema(data=data, encoding=JSON_SCHEMA, id=number, name=schema_name or title),
        Channel(id=number, message_encoding=JSON, metadata={}, schema_id=number, topic=name),
        content=schema,
    )


def _property(kind: str, description: str) -> dict[str, str]:
    return {"type": kind, "description": description}


TICKS = _block_topic(1, TICK)
TRUTHS = _block_topic(2, TRUTH)
EVENTS = _json_topic(
    3,
    "/event",
    "motord.Event",
    {
        "kind": _property("string", "what sort of event, one word"),
        "message": _property("string", "what happened"),
        "data": {"type": "object", "description": "its particulars"},
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
            "description": "t_ns, as foxglove.Log has it",
        },
        "level": _property("integer", "2 information, 3 warning, 4 error"),
        "name": _property("string", "kind, as foxglove.Log has it"),
    },
    required=("kind",),
    schema_name=event_log.SCHEMA_NAME,
)
PLANS = _json_topic(4, "/plan", "motord.Plan", {})
OPERATING_POINTS = _json_topic(
    5,
    "/operating_point",
    "motord.OperatingPoint",
    {
        "index": _property("integer", "plan_point of its ticks"),
        "torque_Nm": _property("number", "torque set-point"),
        "speed_Hz": _property("number", "speed set-point, turns a second"),
        "tick_start": _property("integer", "first tick"),
        "tick_end": _property("integer", "last tick, included"),
        "t_start_ns": _property("integer", "t_ns of the first tick"),
        "t_end_ns": _property("integer", "t_ns of the last tick"),
        "turns": _property("number", "turns captured"),
        "speed_mean_Hz": _property("number", "mean speed, turns a second"),
        "quality": _property("string", "ok, or what is wrong with it"),
        "compensate": _property("integer", "what was compensated: 1 currents, 2 cogging"),
        "repetition": _property("integer", "of a soak: which repetition, from 1"),
        "inner_index": _property("integer", "of a soak: number of the point in the inner plan"),
        "driven": _property("boolean", "the rotor was driven from outside"),
        "turns_from_start": _property(
            "boolean", "whole turns count from the first tick, not from the encoder's zero"
        ),
        "induced": _property("object", "errors put on the currents: alpha, beta_A"),
        "temperatures": {
            "type": "object",
            "additionalProperties": {
                "type": "object",
                "properties": {
                    "mean_C": {"type": "number"},
                    "change_K": {"type": "number"},
                },
            },
            "description": "mean and change of channels with a role; null where not known",
        },
        "take": _property(
            "integer", "which take of the point this is; of several the last good one counts"
        ),
        "rms_error_percent": _property(
            "number", "RMS of measured less set torque, percent of rated, as seen while taken"
        ),
        "mean_error_percent": _property("number", "mean of the same, if the sensor passes it"),
    },
    required=(
        *("index", "torque_Nm", "speed_Hz", "tick_start", "tick_end", "t_start_ns", "t_end_ns"),
    ),
)
STATES = _json_topic(
    6,
    "/state",
    "motord.State",
    {
        "state": _property("string", "OFF, READY, ENABLED or TRIPPED"),
        "fault": _property("string", "what is wrong with the bench, or nothing"),
        "trips": {
            "type": "array",
            "items": {"type": "string"},
            "description": "latched causes; in OFF: what bars enabling",
        },
        "first_trip": _property("string", "the first cause"),
        "holder": _property("string", "who is in command, or nobody"),
        "plan": _property("string", "plan under way, or none"),
        "plan_state": _property("string", "running, pausing, paused or ending"),
        "torque_Nm": _property("number", "torque set-point"),
        "speed_Hz": _property("number", "speed that the brake holds, turns a second; 0: none"),
        "drive_Hz": _property("number", "speed of the external drive, turns a second"),
        "compensate": _property("integer", "what is compensated: 1 currents, 2 cogging, 4 learned"),
    },
)
CHANNEL_TOPIC = "/channel/"
"""What the topics of slow channels begin with; their name follows."""
CHANNELS_FROM = 100
"""Number of the first slow channel in a file, the others follow as they come."""


def channel_topic(number: int, name: str, unit: str, timeout_s: float) -> Topic:
    """Return the topic of a slow channel; its metadata say unit, and for how long a value holds."""
    properties = {
        "value": _property("number", f"value in {unit or 'its unit'}; null: no valid one"),
        "raw": _property("number", "as its source gave it; null: not a number"),
        "status": _property("string", "ok, warn, trip, broken or frozen"),
    }
    topic = _json_topic(number, f"{CHANNEL_TOPIC}{name}", "motord.Channel", properties)
    metadata = {"unit": unit, "timeout_s": str(timeout_s)}
    return replace(topic, channel=replace(topic.channel, metadata=metadata))


ALL = (TICKS, TRUTHS, EVENTS, PLANS, OPERATING_POINTS, STATES)
"""All topics. Their numbers are promises: a file whose beginning is damaged is read by them."""
