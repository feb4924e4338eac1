"""The .proto files of motord's messages, made from `motord.schema`: `python -m motord.proto`."""

from collections.abc import Iterator
from pathlib import Path

from motord.schema import TICK, TRUTH
from motord.wire.ticks.proto_text import file_name, proto_text

FOLDER = Path(__file__).parent


def definitions() -> Iterator[tuple[Path, str]]:
    """Yield the path of every .proto file and the text it has to have."""
    for record in (TICK, TRUTH):
        yield FOLDER / file_name(record), proto_text(record)


def write() -> None:
    """Write all .proto files anew."""
    for path, text in definitions():
        path.write_text(text, encoding="utf-8")
