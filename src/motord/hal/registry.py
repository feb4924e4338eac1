"""Which driver a name in the bench file stands for; imported only when it is used.

Drivers in other packages join through the entry-point group `motord.drivers`, named
`<device>.<driver>`: with `inverter.acme = "acme_motord:Inverter"` a bench may say
`[inverter] driver = "acme"`. A driver is called with the whole `Config` and returns a device as
`hal.base` describes it.
"""

from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import Any, Literal, cast

from motord.config import Config
from motord.config.driver_names import DRIVERS
from motord.hal.base import DeviceError, Rig, SetpointDevice
from motord.hal.wire_rig import WireRig

BUILT_IN = {
    "inverter.can": "motord.hal.inverter.can_drive:CanInverter",
    "inverter.can-dq": "motord.hal.inverter.dq_currents:DqInverter",
    "bridge.can": "motord.hal.bridge.can:CanBridge",
    "bridge.serial": "motord.hal.bridge.serial:SerialBridge",
    "brake.modbus": "motord.hal.modbus.devices:brake",
    "drive.modbus": "motord.hal.modbus.devices:drive",
}

WITHOUT_WIRE = ("inverter.sim", "bridge.sim", "brake.sim", "drive.sim", "brake.none", "drive.none")
"""Names that need no driver: the simulated rig has its own brake and drive."""

SIMULATED_RIG = "motord.hal.sim.rig:SimRig"


def make_rig(config: Config) -> Rig:
    """Return the rig of a bench, not yet opened. Raises DeviceError, ConfigError."""
    if config.simulated:
        return cast("Rig", resolve_name(SIMULATED_RIG)(config))
    inverter, bridge = config.inverter.driver, config.bridge.driver
    return WireRig(_driver("inverter", inverter)(config), _driver("bridge", bridge)(config))


def make_setpoint_device(kind: Literal["brake", "drive"], config: Config) -> SetpointDevice:
    """Return brake or drive of a bench, not yet opened. Raises DeviceError.

    The supervisor itself deals with "none" and "sim", which are no devices.
    """
    name = config.brake.driver if kind == "brake" else config.drive.driver
    return cast("SetpointDevice", _driver(kind, name)(config))


def known(kind: str) -> list[str]:
    """Return the names of the drivers for a kind of device, those of other packages included."""
    names = [*BUILT_IN, *WITHOUT_WIRE, *(entry.name for entry in entry_points(group=DRIVERS))]
    return sorted({name.partition(".")[2] for name in names if name.startswith(f"{kind}.")})


def _driver(kind: str, name: str) -> Any:
    """Return the class or function that makes a driver of a `Config`. Raises DeviceError."""
    target = BUILT_IN.get(f"{kind}.{name}")
    if target is None:
        found = entry_points(group=DRIVERS, name=f"{kind}.{name}")
        if not found:
            raise DeviceError(
                f'[{kind}] driver = "{name}" is not known; known: {", ".join(known(kind))}'
            )
        target = next(iter(found)).value
    try:
        made = resolve_name(target)
        if not callable(made):
            raise ValueError("it names no class or function")
    except (ImportError, AttributeError, ValueError) as error:
        raise DeviceError(
            f'[{kind}] driver = "{name}": cannot load {target}: {error}; '
            "is the package that brings it installed completely?"
        ) from error
    return made
