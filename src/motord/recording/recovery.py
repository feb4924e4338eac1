"""A clean recording made from a damaged or unfinished one: all its whole chunks, as they are."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from motord.recording import topics
from motord.recording.damage import Damage
from motord.recording.errors import RecordError
from motord.recording.file_names import whole_of
from motord.recording.json_encoding import repaired, to_strings
from motord.recording.mcap.chunk_builder import make_chunk
from motord.recording.mcap.chunk_decoder import chunk_head
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.reader import Run, open_run

METADATA_RECOVERED = "motord.recovered"
NOTHING = "nothing"
"""What is missing where nothing is."""


@dataclass(frozen=True)
class Recovery:
    """What was recovered: the clean file, its ticks and chunks, and what could not be saved."""

    path: Path
    ticks: int
    chunks: int
    damage: Damage | None


def default_output(path: Path) -> Path:
    """Return the name of the clean file of `path`, as in `run.recovered.mcap`."""
    name = whole_of(path).name.removesuffix(".mcap")
    return path.with_name(f"{name}.recovered.mcap")


def recover(path: Path, output: Path, go_on: Callable[[], bool] = lambda: True) -> Recovery:
    """Write all that can be read of `path` as the new file `output`, for as long as `go_on()`.

    Raises RecordError if `path` is not a recording, if `output` exists or cannot be written, and if
    it was not to go on; then there is no `output`.
    """
    run = open_run(path)
    output_file = McapFile(output)
    try:
        ticks, chunks = _copy(run, output_file, go_on)
        output_file.metadata(METADATA_RECOVERED, to_strings(_account(run)))
        output_file.finish()
    except BaseException:  # an interrupt, too
        output_file.discard()
        raise
    finally:
        output_file.abandon()
    return Recovery(output, ticks, chunks, run.damage)


def _account(run: Run) -> dict[str, object]:
    """Return what a clean file says of its recovery; what an earlier one lacked is missing, too."""
    damage, earlier = run.damage, run.source.metadata(METADATA_RECOVERED)
    missing = [str(earlier.get("missing", NOTHING)), str(damage or NOTHING)]
    lost = earlier.get("bytes_lost")
    return {
        "from": run.path.name,
        "missing": "; ".join(text for text in missing if text != NOTHING) or NOTHING,
        "bytes_lost": (lost if isinstance(lost, int) else 0) + (damage.bytes_lost if damage else 0),
    }


def _copy(run: Run, output_file: McapFile, go_on: Callable[[], bool]) -> tuple[int, int]:
    """Copy everything that is readable; return the numbers of ticks and of chunks."""
    source = run.source
    for name, strings in source.structure.metadata.items():
        if name != METADATA_RECOVERED:
            output_file.metadata(name, repaired(strings))
    for channel in source.structure.channels.values():
        schema = source.structure.schemas.get(channel.schema_id)
        output_file.channel(schema, channel)
    ticks, chunks, tick_channel = 0, 0, source.number(topics.TICKS.name)
    for chunk in source.read(source.chunks()):
        if not go_on():
            raise RecordError(f"{run.path}: not done in the time that there was")
        index = chunk.index()
        if index:
            head = chunk_head(chunk.record)  # its times are under no checksum: messages have them
            compressed = bytes(chunk.record[head.data_offset :])
            record = make_chunk(chunk.content, head.compression, compressed, index)
            output_file.chunk(record, index)
            chunks += 1
            ticks += len(index.get(tick_channel or 0, ()))
    return ticks, chunks
