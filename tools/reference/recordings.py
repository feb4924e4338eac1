"""The page of what a recording holds: topics, fields, flags, status words."""

import json
from collections.abc import Iterator
from enum import IntEnum, IntFlag

from tools.reference.attributes import summary
from tools.reference.markdown import code, page, table
from tools.reference.models import TYPES

from motord.attribute_docs import described
from motord.recording.topics import ALL, JSON_SCHEMA, Topic
from motord.schema import (
    BridgeStatus,
    Compensate,
    Flag,
    InverterStatus,
    Record,
    State,
)

INTRO = """A recording is an [MCAP](https://mcap.dev) file. What its topics are for, how it is
written and what survives what: [Recordings](../recording.md). Numbers of fields and bits are
promises: they are never reused, only added to. `motord.Tick` is also what the keys `tick` and
`ticks` [publish](rpc.md#keys), and what [`tick.proto`](../../src/motord/proto/tick.proto)
describes."""


def recordings() -> str:
    """Return the page."""
    topics = [
        (code(one.name), f"[`{one.schema.name}`](#{_anchor(one)})", one.channel.message_encoding)
        for one in ALL
        if _content(one)
    ]
    return page(
        "Topics and fields of a recording",
        "motord.schema and motord.recording.topics",
        INTRO,
        "## Topics",
        table(("topic", "messages", "encoding"), topics),
        *(part for one in ALL if _content(one) for part in _topic(one)),
        *_bits("Flags", Flag),
        *_bits("States", State),
        *_bits("Bits of inverter_status", InverterStatus),
        *_bits("Bits of bridge_status", BridgeStatus),
        *_bits("Bits of compensate", Compensate),
    )


def _anchor(topic: Topic) -> str:
    return topic.schema.name.lower().replace(".", "")


def _content(topic: Topic) -> str:
    if topic.record is not None:
        return _record(topic.record)
    if topic.schema.encoding != JSON_SCHEMA:
        return ""
    properties = json.loads(topic.schema.data)["properties"]
    rows = [
        (code(name), TYPES.get(one.get("type", ""), ""), one.get("description", ""))
        for name, one in properties.items()
    ]
    return table(("field", "type", "meaning"), rows)


def _record(record: Record) -> str:
    rows = [(str(f.number), code(f.name), f.kind, f.unit, f.meaning) for f in record.fields]
    return table(("no.", "field", "type", "unit", "meaning"), rows)


def _topic(topic: Topic) -> Iterator[str]:
    yield f"## {topic.schema.name}"
    yield topic.record.meaning if topic.record else f"Topic `{topic.name}`."
    yield _content(topic)


def _bits(title: str, kind: type[IntEnum | IntFlag]) -> Iterator[str]:
    meaning = described(kind)
    yield f"## {title}"
    yield summary(kind)
    flags = issubclass(kind, IntFlag)
    rows = [
        (
            str(one.bit_length() - 1 if flags else int(one)),
            code(name),
            meaning[name],
        )
        for name, one in kind.__members__.items()
    ]
    yield table(("bit" if flags else "value", "name", "meaning"), rows)
