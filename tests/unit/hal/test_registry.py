from importlib.metadata import EntryPoint
from pkgutil import resolve_name

import pytest

from motord import config
from motord.config import BrakeConfig, Config, ModbusConfig
from motord.config.devices import InverterConfig
from motord.config.driver_names import DRIVERS
from motord.hal import registry
from motord.hal.base import DeviceError
from motord.hal.bridge.serial import SerialBridge
from motord.hal.inverter.can_drive import CanInverter
from motord.hal.modbus.devices import ModbusDevice
from motord.hal.sim.rig import SimRig
from motord.hal.wire_rig import WireRig
from tests.contract.peers import MOTOR, bench


class Foreign:
    """A driver as another package would bring it."""

    def __init__(self, config: Config) -> None:
        self.config = config


FOREIGN = EntryPoint("inverter.foreign", f"{__name__}:Foreign", DRIVERS)
BROKEN = EntryPoint("inverter.broken", "no.such.module:Driver", DRIVERS)
NAMELESS = EntryPoint("inverter.nameless", f"{__name__}:Missing", DRIVERS)
MODULE = EntryPoint("inverter.module", __name__, DRIVERS)


@pytest.fixture(autouse=True)
def others(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(group: str, name: str | None = None) -> list[EntryPoint]:
        assert group == "motord.drivers"
        return [e for e in (FOREIGN, BROKEN, NAMELESS, MODULE) if name in (None, e.name)]

    monkeypatch.setattr(registry, "entry_points", found)


def with_driver(name: str) -> Config:
    setup = bench()
    inverter = InverterConfig(driver=name, can=setup.inverter.can)
    return setup.model_copy(update={"inverter": inverter})


def test_the_simulated_rig() -> None:
    assert isinstance(registry.make_rig(config.load()), SimRig)


def test_the_wires() -> None:
    rig = registry.make_rig(bench())
    assert isinstance(rig, WireRig)
    assert isinstance(rig._inverter, CanInverter)
    assert isinstance(rig._bridge, SerialBridge)


def test_a_driver_of_another_package() -> None:
    rig = registry.make_rig(with_driver("foreign"))
    assert isinstance(rig, WireRig)
    assert isinstance(rig._inverter, Foreign)
    assert rig._inverter.config.inverter.driver == "foreign"


@pytest.mark.parametrize("kind", ["brake", "drive"])
def test_slow_devices(kind: str) -> None:
    modbus = {"driver": "modbus", "modbus": ModbusConfig(watchdog_s=0.2, setpoint_kind="i32")}
    setup = Config(motor=MOTOR, **{kind: modbus})
    device = registry.make_setpoint_device(kind, setup)
    assert isinstance(device, ModbusDevice)


def test_the_message_on_an_unknown_driver_names_the_known_ones() -> None:
    with pytest.raises(DeviceError) as caught:
        registry.make_rig(with_driver("telepathy"))
    assert str(caught.value) == (
        '[inverter] driver = "telepathy" is not known; known: broken, can, can-dq, '
        "foreign, module, nameless, sim"
    )
    setup = Config(motor=MOTOR, brake=BrakeConfig(driver="anvil"))
    with pytest.raises(DeviceError, match="known: modbus, none, sim"):
        registry.make_setpoint_device("brake", setup)


@pytest.mark.parametrize("name", ["broken", "nameless", "module"])
def test_a_driver_that_cannot_be_loaded(name: str) -> None:
    with pytest.raises(DeviceError, match="installed completely"):
        registry.make_rig(with_driver(name))


def test_every_built_in_driver_can_be_loaded() -> None:
    for target in (*registry.BUILT_IN.values(), registry.SIMULATED_RIG):
        assert callable(resolve_name(target))


def test_what_a_driver_of_another_package_imports_is_where_it_was() -> None:
    names = {
        "motord.hal.base": (
            "BridgeDriver BridgeStatus DeviceError DeviceReading InverterDriver InverterStatus "
            "SetpointDevice"
        ),
        "motord.config": (
            "BridgeConfig ChannelConfig Config Finite Fraction InverterConfig NonNegative "
            "Positive Section load"
        ),
    }
    for module, wanted in names.items():
        for name in wanted.split():
            assert resolve_name(f"{module}:{name}") is not None
