import pytest

from motord.config import Config, load
from motord.emulate import EmulatorError
from motord.emulate.bench import EmulatedBench
from motord.emulate.selection import check_drivers, is_fast, register_devices
from motord.rig.truth import RigTruth
from motord.wire.can import dbc
from tests.unit.emulate.benches import EMULATED

CONFIG = load(EMULATED)


def changed(**sections: dict[str, object]) -> Config:
    data = CONFIG.model_dump()
    for name, values in sections.items():
        data[name] |= values
    return Config.model_validate(data)


def test_a_simulated_bench_has_nothing_on_the_wire():
    with pytest.raises(EmulatorError, match=r'\[inverter\] driver = "sim": the emulator serves'):
        check_drivers(load())


def test_a_driver_of_another_package_cannot_be_emulated():
    with pytest.raises(EmulatorError, match=r'\[bridge\] driver = "acme"'):
        check_drivers(changed(bridge={"driver": "acme"}))


def test_only_devices_on_modbus_get_a_server():
    bench = EmulatedBench(CONFIG, RigTruth(), 0)
    assert set(register_devices(CONFIG, bench)) == {"brake", "drive"}
    assert set(register_devices(changed(drive={"driver": "none"}), bench)) == {"brake"}


def test_currents_are_fast_and_the_rest_is_slow():
    codec = dbc.load(CONFIG.inverter.can)
    assert {m.name: is_fast(m) for m in codec.feedback} == {
        "PhaseFeedback": True,
        "InverterStatus": False,
    }
