"""A clean recording made from a damaged or unfinished one: all its whole chunks, as they are."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord.recording import topics
from motord.recording.chunk import Index, chunk_record
from motord.recording.chunk_decoder import ChunkError, chunk_head, messages
from motord.recording.chunk_source import ChunkSource
from motord.recording.damage import Damage
from motord.recording.errors import RecordError
from motord.recording.json_encoding import mended, to_strings
from motord.recording.mcap_file import PART, Container
from motord.recording.reader import Run, open_run

METADATA_RECOVERED = "motord.recovered"


@dataclass(frozen=True)
class Recovery:
    """What was recovered: the clean file, its ticks and chunks, and what could not be saved."""

    path: Path
    ticks: int
    chunks: int
    damage: Damage | None


def default_output(path: Path) -> Path:
    """Return the name of the clean file of `path`, as in `run.recovered.mcap`."""
    name = path.name.removesuffix(PART).removesuffix(".mcap")
    return path.with_name(f"{name}.recovered.mcap")


def recover(path: Path, output: Path, go_on: Callable[[], bool] = lambda: True) -> Recovery:
    """Write all that can be read of `path` as the new file `output`, for as long as `go_on()`.

    Raises RecordError if `path` is not a recording, if `output` exists or cannot be written, and if
    it was not to go on; then there is no `output`.
    """
    run = open_run(path)
    container = Container(output)
    try:
        ticks, chunks = _copy(run, container, go_on)
        damage = run.damage
        account = {
            "from": path.name,
            "missing": str(damage) if damage else "nothing",
            "bytes_lost": damage.bytes_lost if damage else 0,
        }
        container.metadata(METADATA_RECOVERED, to_strings(account))
        container.finish()
    except RecordError:
        container.discard()
        raise
    finally:
        container.abandon()
    return Recovery(output, ticks, chunks, damage)


def _copy(run: Run, container: Container, go_on: Callable[[], bool]) -> tuple[int, int]:
    """Copy everything that is readable; return the numbers of ticks and of chunks."""
    source = run.source
    for name, strings in source.structure.metadata.items():
        container.metadata(name, mended(strings))
    for channel in source.structure.channels.values():
        schema = source.structure.schemas.get(channel.schema_id)
        container.channel(schema, channel)
    ticks, chunks, tick_channel = 0, 0, source.number(topics.TICKS.name)
    for entry, record, content in source.contents(source.chunks()):
        if not go_on():
            raise RecordError(f"{run.path}: not done in the time that there was")
        try:
            index = _index(source, content)
        except ChunkError as error:
            source.lose(entry, str(error))
            continue
        if not index:
            continue
        container.chunk(_rewritten(record, content, index), index)
        chunks += 1
        ticks += len(index.get(tick_channel or 0, ()))
    return ticks, chunks


def _index(source: ChunkSource, content: memoryview) -> dict[int, Index]:
    """Return log times and offsets of the messages of every channel in a chunk."""
    index: dict[int, list[Index]] = {}
    for part in messages(content, source.layouts):
        index.setdefault(part.channel, []).append(part.index())
    return {channel: np.concatenate(parts) for channel, parts in index.items()}


def _rewritten(record: memoryview, content: memoryview, index: dict[int, Index]) -> bytes:
    """Return the chunk with the times of its messages; only its content is under its checksum."""
    head = chunk_head(record)
    times = np.concatenate([entries[:, 0] for entries in index.values()])
    compressed = bytes(record[head.data_offset :])
    return chunk_record(content, head.compression, compressed, int(times.min()), int(times.max()))
