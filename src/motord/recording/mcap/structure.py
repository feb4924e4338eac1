"""What is where in an MCAP file."""

from dataclasses import dataclass, field

from mcap.records import Channel, Header, McapRecord, Metadata, Schema

from motord.recording.damage import Loss


@dataclass(frozen=True)
class ChunkEntry:
    """A chunk's place; `channels` are those that it has messages of, None if not known."""

    offset: int
    size: int
    start_ns: int
    end_ns: int
    content_size: int
    channels: frozenset[int] | None


@dataclass
class Structure:
    """What is in a file, and which parts of it are not readable.

    `indexed`: it comes from the file's own summary; only then are there `counts`, the number of
    messages of each channel. `data_end` is the offset of the record that ends the messages, None
    if there is none; `data_crc` the checksum of all before it, 0 for none. `loose_messages`: there
    are messages outside chunks; `library`: what wrote the file.
    """

    size: int
    indexed: bool
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    chunks: list[ChunkEntry] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    data_end: int | None = None
    data_crc: int = 0
    loose_messages: bool = False
    library: str = ""

    def keep(self, record: McapRecord) -> None:
        """Take over header, schemas, channels and metadata, the first of each; ignore others."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata.setdefault(record.name, record.metadata)
        elif isinstance(record, Header):
            self.library = record.library
