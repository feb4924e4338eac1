"""Benches for the tests of the emulator: the one in config/, on ports of their own."""

import itertools
from pathlib import Path

from motord.wire import frames
from tests.support.ports import free_port

EMULATED = Path(__file__).parents[3] / "config" / "emulated.toml"
NUMBERS = itertools.count()


def beat(enable: int) -> frames.Numbered:
    """Return a heartbeat that is newer than every one before it."""
    number = next(NUMBERS)
    heartbeat = frames.Heartbeat.of(number, enable=enable == 1)
    return frames.Numbered(number % frames.SEQUENCE_MODULUS, heartbeat)


PLACES = {
    "emulated": ("/tmp/motord-emulated-bridge", 43117, 15020, 15021),
    "dq": ("/tmp/motord-dq-bridge", 43118, 15030, 15031),
}
"""Bridge port, port of the CAN frames and Modbus ports in the files of config/."""


def write_bench(
    folder: Path, changes: dict[str, str] | None = None, source: Path = EMULATED
) -> Path:
    """Write a file of config/ with ports of its own into `folder`; `changes` replaces text."""
    text = source.read_text()
    bridge, can, brake, drive = PLACES[source.stem]
    ours = {
        f'"{bridge}"': f'"{folder / "bridge"}"',
        f"port = {can}": f"port = {free_port()}",
        f"tcp_port = {brake}": f"tcp_port = {free_port()}",
        f"tcp_port = {drive}": f"tcp_port = {free_port()}",
    }
    for old, new in (ours | (changes or {})).items():
        assert old in text, f"{old} is not in {source}"
        text = text.replace(old, new)
    path = folder / "bench.toml"
    path.write_text(text)
    return path
