"""Schemas and channels of an unfinished file whose beginning, under no checksum, is damaged.

The numbers of motord's topics and of their fields are promises, so what is missing is known.
"""

from mcap.records import Channel, Schema

from motord.recording import topics
from motord.recording.mcap.structure import Structure
from motord.recording.topics import Topic
from motord.wire.ticks.blocks import codec_of
from motord.wire.ticks.proto_text import read_record


def repair_schemas(structure: Structure) -> None:
    """Put back what is missing or damaged in a file of motord without an index."""
    library = structure.library  # empty if the header is not readable
    by_motord = library == "" or library.startswith("motord")
    if structure.indexed or not structure.chunks or not by_motord:
        return
    for topic in topics.ALL:
        known = structure.channels.get(topic.number)
        if library == "" and known is not None:
            continue
        if not _usable(structure.schemas.get(topic.number), known, topic):
            structure.schemas[topic.number] = topic.schema
        for number, channel in list(structure.channels.items()):
            if channel.topic == topic.name:
                del structure.channels[number]
        structure.channels[topic.number] = topic.channel


def _usable(schema: Schema | None, channel: Channel | None, topic: Topic) -> bool:
    """Return whether a schema that no checksum covers is one that a version of motord wrote."""
    if schema is None or schema.name != topic.schema.name:
        return False
    if topic.record is None or schema.data == topic.schema.data:
        return True
    try:
        found = read_record(schema.data, schema.name)
        claimed_bytes = int(channel.metadata[topics.MESSAGE_BYTES]) if channel else 0
    except (ValueError, KeyError):
        return False
    pairs = zip(found.fields, topic.record.fields, strict=False)  # fields are only ever appended
    return claimed_bytes == codec_of(found).size and all(
        (a.number, a.name, a.kind) == (b.number, b.name, b.kind) for a, b in pairs
    )
