"""Settings of drivers of other packages, in the bench file's tables of devices."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from motord import config
from motord.config import InverterConfig
from motord.config.base import Positive, Section
from motord.config.devices import BridgeConfig, DeviceConfig
from motord.config.devices.slow_devices import BrakeConfig, DriveConfig
from motord.hal.base import DeviceError
from motord.hal.driver_settings import read_settings
from motord.hal.registry import BUILT_IN, WITHOUT_WIRE


class Settings(Section):
    """What a foreign drive has."""

    host: str
    rate_Hz: Positive = 1000.0


def bench(**settings: object) -> config.Config:
    inverter = InverterConfig(driver="acme", settings=settings)
    return config.load().model_copy(update={"inverter": inverter})


def test_settings_are_as_the_driver_has_them() -> None:
    assert read_settings("inverter", Settings, bench(host="drive")) == Settings(host="drive")


@pytest.mark.parametrize(
    ("settings", "wrong"),
    [
        ({}, r"^\[inverter.settings\] host: Field required$"),
        ({"host": "drive", "rate_Hz": "1 kHz"}, r"rate_Hz: Input should be a valid number"),
        ({"host": "drive", "rate_Hz": -1.0}, r"rate_Hz: Input should be greater than 0"),
        (
            {"host": 7, "prot": 1},
            r"host: .*string, got 7\n\[inverter.settings\] prot: is not known",
        ),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(settings: dict, wrong: str) -> None:
    with pytest.raises(DeviceError, match=wrong):
        read_settings("inverter", Settings, bench(**settings))


@pytest.mark.parametrize("kind", [InverterConfig, BridgeConfig, BrakeConfig, DriveConfig])
def test_our_own_drivers_have_none(kind: type[DeviceConfig]) -> None:
    for driver in kind.OWN:
        with pytest.raises(ValidationError, match=f'driver = "{driver}" has no settings'):
            kind.model_validate({"driver": driver, "settings": {"host": "drive"}})


def test_our_own_drivers_are_those_of_the_registry() -> None:
    kinds = {"inverter": InverterConfig, "bridge": BridgeConfig}
    kinds |= {"brake": BrakeConfig, "drive": DriveConfig}
    own = {f"{name}.{driver}" for name, kind in kinds.items() for driver in kind.OWN}
    assert own == {*BUILT_IN, *WITHOUT_WIRE}


def test_a_bench_file_has_them_in_its_table(tmp_path: Path) -> None:
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    path = tmp_path / "bench.toml"
    for name in ("inverter", "bridge"):
        table = f'[{name}]\ndriver = "acme"\nsettings = {{ host = "drive", gains = [1.0, 2] }}\n'
        text = text.replace(f'[{name}]\ndriver = "sim"\n', table)
    path.write_text(text)
    loaded = config.load(path)
    assert loaded.inverter.settings == {"host": "drive", "gains": [1.0, 2]}
    dumped = loaded.model_dump(mode="json")
    assert dumped["bridge"]["settings"] == loaded.bridge.settings
    assert "settings" not in dumped["brake"]  # recordings of benches without are as they were
    assert config.Config.model_validate(dumped | {"bench": loaded.bench}).bridge == loaded.bridge
