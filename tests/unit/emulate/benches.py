"""Benches for the tests of the emulator: the one in config/, on ports of their own."""

import itertools
import re
from pathlib import Path

from motord.config import Config, packaged
from motord.emulate.board import Board
from motord.wire.bridge import frames
from tests.support.ports import free_port

EMULATED = Path(__file__).parents[3] / "config" / "emulated.toml"
NUMBERS = itertools.count()


def beat(enable: int) -> frames.Numbered:
    """Return a heartbeat that is newer than every one before it."""
    number = next(NUMBERS)
    heartbeat = frames.Heartbeat.of(number, enable=enable == 1)
    return frames.Numbered(number % frames.SEQUENCE_MODULUS, heartbeat)


def configure(board: Board, config: Config) -> None:
    """Be the host of the bench that starts at time 0."""
    timeout_us = round(config.bridge.heartbeat_timeout_s * 1e6)
    wanted = frames.Configure(config.sample_rate_Hz, timeout_us)
    for frame in (wanted, frames.HelloRequest(frames.PROTOCOL)):
        board.receive(0, frames.Numbered(0, frame))


PLACES = {
    "emulated": ("/tmp/motord-emulated-bridge", 43117, 15020, 15021),
    "dq": ("/tmp/motord-dq-bridge", 43118, 15030, 15031),
}
"""Bridge port, port of the CAN frames and Modbus ports in the files of config/."""


DRAG = {"viscous_Nm_s_per_rad": "0.13"}
"""3 Nm turn a rotor with such bearings at 23 rad/s, below `trip_speed_rad_s`, without a brake."""
NO_OFFSETS = {"beta_A": "[0.0, 0.0, 0.0]"}
"""A rotor that rests stays where it is when the power stage is switched on."""


def write_bench(
    folder: Path,
    changes: dict[str, str] | None = None,
    source: Path = EMULATED,
    rig: dict[str, str] | None = None,
) -> Path:
    """Write a file of config/ with ports of its own into `folder`; `changes` replaces text.

    `rig` has other values of the rig by their keys, for a file of its own next to the bench's.
    """
    text = source.read_text()
    if rig is not None:
        [name] = re.findall(r'^rig = "package:(.*)"', text, flags=re.MULTILINE)
        truth = packaged(name).read_text()
        for key, value in rig.items():
            truth, found = re.subn(rf"^{key} = .*$", f"{key} = {value}", truth, flags=re.MULTILINE)
            assert found == 1
        (folder / "rig.toml").write_text(truth)
        text = text.replace(f'"package:{name}"', '"rig.toml"')
    bridge, can, brake, drive = PLACES[source.stem]
    ours = {
        f'"{bridge}"': f'"{folder / "bridge"}"',
        f"port = {can}": f"port = {free_port()}",
        f"tcp_port = {brake}": f"tcp_port = {free_port()}",
        f"tcp_port = {drive}": f"tcp_port = {free_port()}",
        "[zenoh]\n": f'[zenoh]\nlisten = ["tcp/127.0.0.1:{free_port()}"]\n',
    }
    for old, new in (ours | (changes or {})).items():
        assert old in text, f"{old} is not in {source}"
        text = text.replace(old, new)
    path = folder / "bench.toml"
    path.write_text(text)
    return path
