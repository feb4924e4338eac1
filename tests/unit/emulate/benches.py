"""Benches for the tests of the emulator: the one in config/, on ports of their own."""

import socket
from pathlib import Path

from motord.config import Config, load

EMULATED = Path(__file__).parents[3] / "config" / "emulated.toml"


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """Return a port of the loopback that nobody uses."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def bench(folder: Path, **changes: object) -> Config:
    """Return config/emulated.toml with ports of its own; `changes` by dotted name, __ for a dot."""
    data = load(EMULATED).model_dump()
    ours: dict[str, object] = {
        "bridge__port": str(folder / "bridge"),
        "inverter__can__options": {"port": free_port(socket.SOCK_DGRAM), "hop_limit": 0},
        "brake__modbus__tcp_port": free_port(),
        "drive__modbus__tcp_port": free_port(),
    }
    for name, value in (ours | changes).items():
        *tables, key = name.split("__")
        table = data
        for part in tables:
            table = table[part]
        table[key] = value
    return Config.model_validate(data)
