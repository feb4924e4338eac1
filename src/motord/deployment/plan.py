"""What a service consists of: its files, and the commands that put them in force."""

import ipaddress
import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from motord.config import Config, load, packaged
from motord.config.devices.slow_devices import ModbusLinkConfig
from motord.config.named_files import named_files
from motord.deployment.files import DeployedFile, DeploymentError
from motord.process.home_folder import in_home
from motord.process.module_command import module_command
from motord.untrusted import parse_toml, read_text

STATE = Path("/var/lib/motord")
"""The only folder that the unit lets the daemon write to."""
UNIT = "motord.service"
ETC = Path("/etc/motord")
BENCH = ETC / "bench.toml"
HOMES = ("/home", "/root", "/run/user")
"""What `ProtectHome=` hides from the unit."""

Commands = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class ServiceRequest:
    """What is asked for. program: what starts motord; can_bitrates: nominal, data (bit/s).

    With can_bitrates its CAN channels are set up at boot; user: in the user's own systemd.
    """

    bench_file: str
    program: tuple[str, ...]
    user: bool = False
    can_bitrates: tuple[int, int] | None = None


def files_of(request: ServiceRequest) -> tuple[DeployedFile, ...]:
    """Return the files of a service. Raises ConfigError, DeploymentError."""
    bench_file = Path(request.bench_file)
    bench = load(bench_file)
    if request.user and request.can_bitrates:
        raise DeploymentError("--can-bitrate: only a service of the system brings CAN channels up")
    if request.user:
        unit = user_unit(request.program, bench_file.absolute())
        return (DeployedFile(user_units() / UNIT, unit),)
    return (
        *_bench_files(bench_file),
        DeployedFile(Path("/etc/systemd/system", UNIT), system_unit(request.program, BENCH, bench)),
        _shipped("60-motord.rules", "/etc/udev/rules.d/60-motord.rules"),
        _shipped("motord.sysusers.conf", "/etc/sysusers.d/motord.conf"),
        *(_can_networks(bench, *request.can_bitrates) if request.can_bitrates else ()),
    )


def activation(request: ServiceRequest, *, now: bool) -> Commands:
    """Return the commands that put the files in force; now: the service is started, too."""
    enable = ("enable", *(("--now",) if now else ()), UNIT)
    if request.user:
        return (("systemctl", "--user", "daemon-reload"), ("systemctl", "--user", *enable))
    return (
        ("systemd-sysusers", "/etc/sysusers.d/motord.conf"),
        *chain.from_iterable(map(_given, _runs_elsewhere(load(Path(request.bench_file))))),
        ("udevadm", "control", "--reload"),
        ("udevadm", "trigger", "--action=add", "--subsystem-match=tty",
         "--subsystem-match=usb-serial", "--subsystem-match=misc"),
        *((("networkctl", "reload"),) if request.can_bitrates else ()),
        ("systemctl", "daemon-reload"),
        ("systemctl", *enable),
    )  # fmt: skip


def before_removal(*, user: bool) -> Commands:
    """Return the commands that stop a service: the bench ramps down and is disabled."""
    return (("systemctl", *(("--user",) if user else ()), "disable", "--now", UNIT),)


def after_removal(*, user: bool) -> Commands:
    """Return the commands after the files are gone."""
    if user:
        return (("systemctl", "--user", "daemon-reload"),)
    return (("systemctl", "daemon-reload"), ("udevadm", "control", "--reload"))


def manifest(*, user: bool) -> Path:
    """Return where it is remembered what was written."""
    if user:
        return in_home("XDG_STATE_HOME", ".local", "state") / "motord" / "service.json"
    return ETC / ".service.json"


def user_units() -> Path:
    """Return the folder of a user's own units (systemd.unit(5))."""
    return in_home("XDG_CONFIG_HOME", ".config") / "systemd" / "user"


def this_program() -> tuple[str, ...]:
    """Return what starts this motord."""
    script = Path(sys.executable).with_name("motord")
    return (str(script),) if script.exists() else tuple(module_command("motord"))


def hidden_parts() -> list[str]:
    """Return what of this motord a service of the system could not see."""
    own = (sys.prefix, sys.base_prefix, str(Path(__file__).parents[1]))
    return [place for place in dict.fromkeys(own) if is_hidden(Path(place))]


def is_hidden(path: Path) -> bool:
    """Return whether the system's unit cannot see a path, or what it leads to."""
    return any(one.is_relative_to(home) for one in (path, path.resolve()) for home in HOMES)


def _shipped(name: str, path: str) -> DeployedFile:
    return DeployedFile(Path(path), packaged(f"systemd/{name}").read_text())


def _bench_files(bench_file: Path) -> Iterator[DeployedFile]:
    """Yield the bench file and what it names by relative paths, as files next to it."""
    text = read_text(bench_file)
    yield DeployedFile(BENCH, text, kept=True)
    for _, key, name in named_files(parse_toml(text)):
        named = Path(name)
        if name.startswith("package:"):
            continue
        if named.is_absolute():
            _visible(named, key, ETC)
        elif key in ("ca", "certificate", "key", "roles"):
            raise DeploymentError(
                f"{bench_file}: [zenoh.tls] {key} = {name!r} is not copied, it decides who "
                f"gets in: name it by its whole path, in a folder below {ETC}"
            )
        elif ".." in named.parts:
            raise DeploymentError(
                f"{bench_file}: {key} = {name!r} is outside of its folder and would not be found "
                f"from {ETC}: put it next to the bench file"
            )
        else:
            yield DeployedFile(ETC / named, _text(bench_file.parent / named), kept=True)


def _visible(path: Path, key: str, better: Path) -> Path:
    """Return what a key names by its whole path. Raises DeploymentError if it is in a home."""
    if is_hidden(path):
        raise DeploymentError(
            f"{key} = '{path}' is in a home, which the service cannot see: put it below {better}"
        )
    return path


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except UnicodeDecodeError:
        raise DeploymentError(
            f"{path}: not a text file in UTF-8: convert it, or put it into {ETC} and name it by "
            "its whole path"
        ) from None


def _can_networks(bench: Config, bitrate: int, data_bitrate: int) -> Iterator[DeployedFile]:
    """Yield what brings the CAN channels of a bench up at boot (systemd-networkd)."""
    buses = [bench.inverter.can if bench.inverter.driver.startswith("can") else None,
             bench.bridge.can if bench.bridge.driver == "can" else None]  # fmt: skip
    kernels = [bus for bus in buses if bus and bus.interface == "socketcan"]
    if not kernels:
        raise DeploymentError("--can-bitrate: this bench has no CAN channel of the kernel")
    shipped = packaged("systemd/80-motord-can.network").read_text()
    for channel in dict.fromkeys(bus.channel for bus in kernels):
        text = shipped.replace("Name=can0", f"Name={channel}")
        text = text.replace("BitRate=1M\n", f"BitRate={bitrate}\n", 1)
        text = text.replace("DataBitRate=4M", f"DataBitRate={data_bitrate}")
        if not any(bus.fd for bus in kernels if bus.channel == channel):  # an adapter may lack it
            text = re.sub(r"^(DataBitRate|FDMode)=.*\n", "", text, flags=re.MULTILINE)
        yield DeployedFile(Path(f"/etc/systemd/network/80-motord-{channel}.network"), text)


def system_unit(program: tuple[str, ...], bench_file: Path, bench: Config) -> str:
    """Return the unit of the system, for what this bench reaches. program: what starts motord."""
    lines = "\n".join((_start(program, bench_file), *_reached(bench)))
    unit = _with_start(packaged("systemd/motord.service").read_text(), lines)
    for runs in _runs_elsewhere(bench):  # not into the folder beneath a disk that is mounted later
        unit = unit.replace("\n[Service]", f"RequiresMountsFor={_quoted(str(runs))}\n\n[Service]")
    return unit


def user_unit(program: tuple[str, ...], bench_file: Path) -> str:
    """Return the unit of a user, who has the bench file where it is."""
    text = packaged("systemd/user/motord.service").read_text()
    text = text.replace("WorkingDirectory=%h", f"WorkingDirectory={_path(bench_file.parent)}")
    return _with_start(text, _start(program, bench_file))


def _with_start(unit: str, lines: str) -> str:
    return re.sub(r"^ExecStart=.*$", lambda _: lines, unit, flags=re.MULTILINE)


def _start(program: tuple[str, ...], bench_file: Path) -> str:
    path, *words = map(_quoted, (*program, "run", "--config", str(bench_file)))
    return " ".join((f"ExecStart={path}", *(word.replace("$", "$$") for word in words)))


def _quoted(word: str) -> str:
    """Return one of several words of a line as systemd.syntax(7) reads it."""
    _one_line(word)
    word = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%")
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
    for runs in _runs_elsewhere(bench):
        yield f"ReadWritePaths={_quoted(str(runs))}"
    links: list[ModbusLinkConfig | None] = [
        *(device.modbus for device in (bench.brake, bench.drive) if device.driver == "modbus"),
        *(one.source for one in bench.channels if isinstance(one.source, ModbusLinkConfig)),
    ]
    hosts = dict.fromkeys(link.host for link in links if link and link.transport == "tcp")
    for address in map(_address, hosts):
        if address is not None and not address.is_loopback:
            yield f"IPAddressAllow={address}"


def _runs_elsewhere(bench: Config) -> tuple[Path, ...]:
    """Return the folder of recordings, as one path, or none if it is below `STATE`.

    Raises DeploymentError.
    """
    runs = Path(os.path.normpath(STATE / bench.recording.directory))  # it may be ../runs
    if runs.is_relative_to(STATE):
        return ()
    return (_visible(runs, "[recording] directory", Path("/srv")),)


def _given(runs: Path) -> Commands:
    """Return what gives a folder to the service; of those that are there an empty one of root."""
    if not os.path.lexists(runs):
        return (("install", "-d", "-o", "motord", "-g", "motord", "-m", "0750", str(runs)),)
    with suppress(OSError):  # whoever may not look may not give it away, either
        if runs.stat().st_uid == 0 and {one.name for one in runs.iterdir()} <= {"lost+found"}:
            return (("chown", "motord", str(runs)),)  # a group that shares it still may
    return ()


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        if host == "localhost":
            return None
        raise DeploymentError(
            f"a unit opens the network for addresses, not for names: write the address of {host} "
            "as host in the bench file"
        ) from None
