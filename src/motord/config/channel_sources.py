"""`[channels.source]`: where a slow channel comes from; `driver` says which of these it is."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, JsonValue, Tag

from motord.config.base import BitRate, PlainName, Section, matching
from motord.config.devices import CanBusConfig
from motord.config.devices.slow_devices import ModbusLinkConfig, RegisterKind

Line = tuple[str, ...]
"""What channels have in common that are read one after the other: a port, a bus, a driver."""
RigQuantity = Literal["winding_C", "magnet_C", "housing_C", "dc_power_W"]
"""What a channel reads of the rig: a node of its thermal network, or its power from the DC supply.
"""
Timeout = Annotated[float, Field(gt=0, le=5)]


class ModbusSource(ModbusLinkConfig):
    """A register of a Modbus device, by TCP or RTU."""

    driver: Literal["modbus"]
    """`"modbus"`."""
    address: Annotated[int, Field(ge=0, le=65535)]
    """Counted from 0: 30001 or 40001 in many manuals."""
    kind: RegisterKind = "i16"
    """`u` unsigned, `i` two's complement; one register of 16 bits or two."""
    word_order: Literal["big", "little"] = "big"
    """Which half of a 32-bit number comes first."""
    table: Literal["holding", "input"] = "input"
    """Where the register is."""
    emulated: RigQuantity | None = None
    """What `motord emulate` puts there; left out: the emulator does not serve it."""

    @property
    def line(self) -> Line:
        """The connection or serial line."""
        return ("modbus", self.transport, self.place)

    @property
    def read_s(self) -> float:
        """The longest that a reading takes; after one that failed a serial line is left alone."""
        return self.timeout_s if self.transport == "tcp" else 2 * self.timeout_s


class CanSource(Section):
    """A signal of a DBC, on the inverter's CAN bus or another one."""

    driver: Literal["can"]
    """`"can"`."""
    dbc: Path
    """The DBC; next to the bench file, or `package:NAME`."""
    signal: Annotated[str, matching(r"[^.]+\.[^.]+", "Message.Signal, with one dot")]
    """`Message.Signal`, not multiplexed."""
    bus: CanBusConfig | None = None
    """A bus of its own; left out: that of `[inverter.can]`."""

    @property
    def line(self) -> Line:
        """The bus."""
        return ("can", self.bus.place if self.bus is not None else "")

    @property
    def read_s(self) -> float:
        """The longest that a reading takes: frames come by themselves."""
        return 0.0


def _one_value(pattern: str) -> str:
    try:
        compiled = re.compile(pattern)
    except re.error as error:
        raise ValueError(f"not a regular expression: {error}") from None
    if not compiled.groups or len(compiled.groupindex) > 1:
        raise ValueError(
            "needs a group around the number, the first or the only one with a name, "
            r"such as T1=(-?[0-9.]+)"
        )
    return pattern


class SerialSource(Section):
    """A number in the lines of text that come from a serial port."""

    driver: Literal["serial"]
    """`"serial"`."""
    port: Annotated[str, Field(min_length=1)]
    """Serial port; several channels may be in its lines."""
    baud: BitRate = 9600
    """Baud rate."""
    pattern: Annotated[str, AfterValidator(_one_value)]
    """Regular expression that is looked for in a line: its named group, or its first, is a number.
    """
    request: str = ""
    """Sent before each reading, with its line end such as `"MEAS?\\r\\n"`; left out: lines come by
    themselves."""
    timeout_s: Timeout = 0.5
    """How long to wait for the answer to a request."""

    @property
    def line(self) -> Line:
        """The port."""
        return ("serial", self.port)

    @property
    def read_s(self) -> float:
        """The longest that a reading takes."""
        return self.timeout_s if self.request else 0.0


class SimulatedSource(Section):
    """A temperature of the simulated rig, or its DC power."""

    driver: Literal["simulated"]
    """`"simulated"`."""
    quantity: RigQuantity = "winding_C"
    """Which temperature: of the windings, the magnets or the housing; or the power from the DC
    supply, the mean since the reading before."""

    @property
    def line(self) -> Line:
        """The rig."""
        return ("simulated",)

    @property
    def read_s(self) -> float:
        """The longest that a reading takes."""
        return 0.0


class OtherSource(Section):
    """A driver of another package, by its entry point in the group `motord.channels`."""

    driver: PlainName
    """The name of its entry point."""
    timeout_s: Timeout = 1.0
    """The longest that a reading takes, as its documentation says."""
    settings: dict[str, JsonValue] = Field(default_factory=dict)
    """Settings of the driver, which states what they are."""

    @property
    def line(self) -> Line:
        """None that motord knows of: each such channel has a thread of its own."""
        return ()

    @property
    def read_s(self) -> float:
        """The longest that a reading takes."""
        return self.timeout_s


OWN = {"modbus": "Modbus", "can": "Can", "serial": "Serial", "simulated": "Simulated"}


def _tag(source: Any) -> str:
    name = source.get("driver") if isinstance(source, dict) else getattr(source, "driver", None)
    return OWN.get(str(name), "Other")


ChannelSource = Annotated[
    Annotated[ModbusSource, Tag("Modbus")]
    | Annotated[CanSource, Tag("Can")]
    | Annotated[SerialSource, Tag("Serial")]
    | Annotated[SimulatedSource, Tag("Simulated")]
    | Annotated[OtherSource, Tag("Other")],
    Discriminator(_tag),
]
"""By `driver`; a name that is none of motord's own is looked for among the entry points."""
