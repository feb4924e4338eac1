"""Benches for the tests of the emulator: the one in config/, on ports of their own."""

import itertools
import re
from pathlib import Path

from motord.config import packaged
from motord.wire.bridge import frames
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


DRAG_NM_S_PER_RAD = 0.13
"""3 Nm turn a rotor with such bearings at 23 rad/s, below `trip_speed_rad_s`, without a brake."""


def write_bench(
    folder: Path,
    changes: dict[str, str] | None = None,
    source: Path = EMULATED,
    drag_Nm_s_per_rad: float | None = None,
) -> Path:
    """Write a file of config/ with ports of its own into `folder`; `changes` replaces text.

    `drag_Nm_s_per_rad` gives the rig other bearings, in a file of its own next to the bench's.
    """
    text = source.read_text()
    if drag_Nm_s_per_rad is not None:
        rig, found = re.subn(
            r"^(viscous_Nm_s_per_rad) = .*$",
            rf"\1 = {drag_Nm_s_per_rad}",
            packaged("report.rig.toml").read_text(),
            flags=re.MULTILINE,
        )
        assert found == 1
        (folder / "rig.toml").write_text(rig)
        text = text.replace('"package:report.rig.toml"', '"rig.toml"')
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
