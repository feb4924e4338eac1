"""The text of a unit for one bench, made from the unit that ships with motord."""

import ipaddress
import re
from collections.abc import Iterator
from pathlib import Path

from motord.config import Config, packaged
from motord.deployment.files import DeploymentError

STATE = Path("/var/lib/motord")
"""The only folder that the unit lets the daemon write to."""


def system_unit(program: tuple[str, ...], bench_file: Path, bench: Config) -> str:
    """Return the unit of the system, for what this bench reaches. program: what starts motord."""
    lines = "\n".join((_start(program, bench_file), *_reached(bench)))
    return _with_start(packaged("systemd/motord.service").read_text(), lines)


def user_unit(program: tuple[str, ...], bench_file: Path) -> str:
    """Return the unit of a user, who has the bench file where it is."""
    text = packaged("systemd/user/motord.service").read_text()
    text = text.replace("WorkingDirectory=%h", f"WorkingDirectory={_path(bench_file.parent)}")
    return _with_start(text, _start(program, bench_file))


def _with_start(unit: str, lines: str) -> str:
    return re.sub(r"^ExecStart=.*$", lambda _: lines, unit, flags=re.MULTILINE)


def _start(program: tuple[str, ...], bench_file: Path) -> str:
    return "ExecStart=" + " ".join(map(_quoted, (*program, "run", "--config", str(bench_file))))


def _quoted(word: str) -> str:
    """Return a word of a command line as systemd.service(5) reads it."""
    _one_line(word)
    word = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{word}"' if re.search(r"[\s\"';\\]", word) else word


def _path(path: Path) -> str:
    """Return a path as systemd.exec(5) reads it."""
    return _one_line(str(path)).replace("%", "%%")


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise DeploymentError(f"{text!r}: a name with line breaks does not go into a unit; move it")
    return text


def _reached(bench: Config) -> Iterator[str]:
    """Yield what the unit opens for this bench: where it records, its devices on the network."""
    runs = bench.recording.directory
    if runs.is_absolute() and not runs.is_relative_to(STATE):
        yield f"ReadWritePaths={_quoted(str(runs))}"
    for device in (bench.brake, bench.drive):
        if device.driver == "modbus" and device.modbus and device.modbus.transport == "tcp":
            address = _address(device.modbus.host)
            if address is not None and not address.is_loopback:
                yield f"IPAddressAllow={address}"


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        if host == "localhost":
            return None
        raise DeploymentError(
            f"a unit opens the network for addresses, not for names: write the address of {host} "
            "as host in [brake.modbus] or [drive.modbus]"
        ) from None
