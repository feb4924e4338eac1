"""Benches for the tests of the emulator: the one in config/, on ports of their own."""

import socket
from pathlib import Path

EMULATED = Path(__file__).parents[3] / "config" / "emulated.toml"


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """Return a port of the loopback that nobody uses."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def write_bench(folder: Path, changes: dict[str, str] | None = None) -> Path:
    """Write config/emulated.toml with ports of its own into `folder`; `changes` replaces text."""
    text = EMULATED.read_text()
    ours = {
        '"/tmp/motord-emulated-bridge"': f'"{folder / "bridge"}"',
        "port = 43117": f"port = {free_port(socket.SOCK_DGRAM)}",
        "tcp_port = 15020": f"tcp_port = {free_port()}",
        "tcp_port = 15021": f"tcp_port = {free_port()}",
    }
    for old, new in (ours | (changes or {})).items():
        assert old in text, f"{old} is not in {EMULATED}"
        text = text.replace(old, new)
    path = folder / "bench.toml"
    path.write_text(text)
    return path
