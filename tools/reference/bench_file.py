"""The pages of the bench file and of the import map: every table, every key."""

from collections.abc import Iterator

from pydantic import BaseModel
from tools.reference.attributes import summary
from tools.reference.markdown import page
from tools.reference.models import fields

from motord.config import (
    BackEmfHarmonic,
    BridgeCanConfig,
    CanBusConfig,
    CanConfig,
    CanopenConfig,
    CanSignalMap,
    ChannelConfig,
    DqConfig,
    ModbusConfig,
)
from motord.config.channel_sources import (
    CanSource,
    ModbusSource,
    OtherSource,
    SerialSource,
    SimulatedSource,
)
from motord.config.experiments import plan_kinds
from motord.config.motor.back_emf import BackEmfTable
from motord.config.plans.inertia import SpringConfig
from motord.config.sections import Sections
from motord.config.zenoh import TlsConfig
from motord.importing.mapping import Column, CsvMap, ImportMap, MdfMap, SplitMap, TdmsMap

Tables = dict[str, tuple[type[BaseModel], BaseModel | None]]
"""Heading to model, and to its values if the defaults are not the model's own."""

BELOW: dict[str, dict[str, type[BaseModel]]] = {
    "inverter": {
        "[inverter.can]": CanConfig,
        "[inverter.can.signals]": CanSignalMap,
        "[inverter.can.canopen]": CanopenConfig,
        "[inverter.dq]": DqConfig,
    },
    "bridge": {"[bridge.can]": BridgeCanConfig},
    "drive": {"[brake.modbus], [drive.modbus]": ModbusConfig},
    "motor": {"[motor] back_emf": BackEmfHarmonic, "[motor] back_emf, as a file": BackEmfTable},
    "zenoh": {"[zenoh.tls]": TlsConfig},
    "plans.inertia-oscillation": {"[[plans.inertia-oscillation.springs]]": SpringConfig},
}
"""Tables that are part of another one."""

CHANNELS: dict[str, type[BaseModel]] = {
    "[[channels]]": ChannelConfig,
    '[channels.source] driver = "modbus"': ModbusSource,
    '[channels.source] driver = "can"': CanSource,
    "[channels.source] bus": CanBusConfig,
    '[channels.source] driver = "serial"': SerialSource,
    '[channels.source] driver = "simulated"': SimulatedSource,
    "[channels.source] of another package": OtherSource,
}
"""Slow channels: any number of them, and what a source may be."""

BENCH = """A bench file is TOML. Every key is optional unless it says **required**; an unknown key
is an error that names it, and so is a value of another type. Numbers carry their unit in their
name. Paths are looked for next to the file; `package:NAME` ships with motord.

`config/bench.toml` is an example for a real bench, `config/emulated.toml` one for the emulator.
`motord check -c FILE` says what is wrong, with file and line. That includes rules between several
tables: that limits, rates and timeouts leave every [interlock](interlocks.md) its time, for
instance."""

IMPORT = """`motord record import FILE --map MAP.toml` makes a recording of a file from elsewhere
([how](../import.md)). The fields that `[columns]` and `[constants]` may name are those of a
[tick](recording.md#motordtick), and `t_s`, `speed_Hz` and `speed_set_Hz`."""


def _bench_tables() -> Tables:
    tables: Tables = {}
    for name, field in Sections.model_fields.items():
        if name == "channels":
            tables |= {heading: (one, None) for heading, one in CHANNELS.items()}
        elif name != "plans" and isinstance(field.annotation, type):
            tables[f"[{name}]"] = (field.annotation, None)
            tables |= {heading: (one, None) for heading, one in BELOW.get(name, {}).items()}
    for name, kind in plan_kinds().items():
        if kind.make.startswith("motord."):
            tables[f"[plans.{name}]"] = (type(kind.settings), kind.settings)
            below = BELOW.get(f"plans.{name}", {})
            tables |= {heading: (one, None) for heading, one in below.items()}
    return tables


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    kept = "".join(c for c in heading.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def sections(tables: Tables) -> Iterator[str]:
    """Yield heading, summary and keys of each table."""
    links: dict[str, str] = {}
    for heading, (model, _) in tables.items():
        links.setdefault(model.__name__, f"[`{heading}`](#{anchor(heading)})")
    for heading, (model, values) in tables.items():
        yield f"## {heading}"
        yield summary(model)
        yield fields(model, links, values)


def bench_file() -> str:
    """Return the page of the bench file."""
    return page("The bench file", "motord.config", BENCH, *sections(_bench_tables()))


def import_map() -> str:
    """Return the page of the import map."""
    tables: Tables = {
        "The file": (ImportMap, None),
        "[columns]": (Column, None),
        "[split]": (SplitMap, None),
        "[csv]": (CsvMap, None),
        "[tdms]": (TdmsMap, None),
        "[mdf]": (MdfMap, None),
    }
    return page("The import map", "motord.importing.mapping", IMPORT, *sections(tables))
