"""What a new bench file begins as: an example of motord's, with the tables of an inverter.

The command line lists them, so that nothing heavy is imported before one is read.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

Tables = dict[str, Any]

CHECK = "CHECK"
"""Begins the comment of a value that is the example's and was not asked for."""


@dataclass(frozen=True)
class Template:
    """An example to begin with. file: packaged; real: of hardware, not simulated or emulated.

    bridge: driver of the board, where it is not that of the file.
    """

    file: str
    summary: str
    next_steps: tuple[str, ...]
    real: bool = False
    bridge: str = ""

    def tables(self) -> Tables:
        """Return the example's content."""
        tables = _read(self.file)[1]
        rig = tables["bench"].get("rig", "")
        if rig and not rig.startswith("package:"):  # seen from the package's folder
            tables["bench"]["rig"] = f"package:{rig}"
        if self.bridge == "can":
            tables["bridge"] = _bridge_on_can(tables["bridge"])
        return tables


_ON_THE_WIRE = (
    "motord emulate -c {file}    # in a terminal of its own: the devices",
    "motord check -c {file}",
    "motord run -c {file}        # the daemon: OFF until someone enables",
)
_REAL = (
    "motord check -c {file} --rt    # every device, one after the other; nothing is enabled",
    "motord run -c {file}           # the daemon: OFF until someone enables",
)

TEMPLATES = {
    "simulated": Template(
        "sim.toml",
        "no devices: a simulated rig inside the daemon",
        ("motord check -c {file}", "motord run -c {file}    # the daemon: OFF until enabled"),
    ),
    "emulated": Template(
        "examples/emulated.toml",
        "no devices: the real drivers, and emulated devices at the other end of the wire",
        _ON_THE_WIRE,
    ),
    "emulated-dq": Template(
        "examples/dq.toml", "the same with an inverter that takes d and q currents", _ON_THE_WIRE
    ),
    "serial-bridge": Template(
        "examples/bench.toml", "a real bench, its bridge board on a serial port", _REAL, real=True
    ),
    "can-bridge": Template(
        "examples/bench.toml", "a real bench, its bridge board on CAN", _REAL, True, "can"
    ),
}

INVERTERS = {
    "phase-currents": "takes a current for each phase; names of its DBC to be filled in",
    "dq": "takes currents along d and q; names of its DBC to be filled in",
    "moteus": "moteus, d and q currents over CAN FD",
    "odrive": "ODrive, current along q",
    "vesc": "VESC, current along q",
    "cia402": "CiA 402 profile, current along q",
}
"""Inverters of a real bench, and what they are."""


def inverter_tables(name: str) -> Tables:
    """Return the table `[inverter]` for one of INVERTERS. Raises ConfigError."""
    from motord.config import ConfigError

    if name not in INVERTERS:
        raise ConfigError(f"no inverter {name}; there are {', '.join(INVERTERS)}")
    real: Tables = _read("examples/bench.toml")[1]["inverter"]
    if name == "phase-currents":
        return real
    own: Tables = _read(_inverter_file(name))[1]["inverter"]
    times = {key: value for key, value in real.items() if key.endswith("_s")}
    if name == "dq":  # its times are those of an emulated bench
        own = {"driver": own["driver"], "dq": own["dq"], "can": own["can"]}
    own["can"] = {**own["can"], "interface": "socketcan", "channel": "can0", "options": {}}
    return {"driver": own["driver"], **times, **own}


@dataclass(frozen=True)
class KeyComments:
    """Comments of the files that a bench file begins as, by key.

    general: those of an example; own: those of the file of one inverter, which say more of its
    values than any description of the key.
    """

    general: dict[str, str]
    own: dict[str, str]


def notes(template: Template, inverter: str) -> KeyComments:
    """Return the comments of the files that a bench file begins as."""
    own = _notes(_inverter_file(inverter)) if template.real and known(inverter) else ()
    return KeyComments(dict(_notes(template.file)), dict(own))


def known(inverter: str) -> frozenset[str]:
    """Return the tables that need no check: the messages of an inverter that is named."""
    named = inverter not in ("", "phase-currents", "dq")
    return frozenset({"inverter.can.signals", "inverter.can.dbc"} if named else ())


def _inverter_file(name: str) -> str:
    """Return the packaged file that describes one of INVERTERS, the default for ""."""
    own = {"": "examples/bench.toml", "phase-currents": "examples/bench.toml",
           "dq": "examples/dq.toml"}  # fmt: skip
    return own.get(name, f"drives/{name}.toml")


def _notes(file: str) -> Iterator[tuple[str, str]]:
    """Yield keys and the comments behind their values."""
    table = ""
    for line in _read(file)[0].splitlines():
        if head := re.match(r"\[([^]]+)\]", line):
            table = head[1]
        elif note := re.match(r'("[^"]+"|\w+) = .*?  # (.*)', line):
            yield f"{table}.{note[1]}", note[2]


def _read(file: str) -> tuple[str, Tables]:
    """Return text and content of a packaged file."""
    from motord.config import packaged, read_toml

    return read_toml(packaged(file))


def _bridge_on_can(serial: Tables) -> Tables:
    timing = {key: value for key, value in serial.items() if key not in ("driver", "port", "baud")}
    bus = {
        "interface": "socketcan", "channel": "can1", "fd": True,
        "bitrate": 1_000_000, "data_bitrate": 5_000_000,
    }  # fmt: skip
    return {"driver": "can", **timing, "can": bus}
