import pytest

from motord.config import load
from motord.rig import truth
from motord.wire.can import dbc
from tests.unit.emulate.benches import EMULATED


@pytest.mark.parametrize("name", ["emulated.toml", "bench.toml"])
def test_the_bench_files_are_valid(name):
    config = load(EMULATED.with_name(name))
    assert len(dbc.load(config.inverter.can).feedback) == 2
    assert (config.inverter.driver, config.bridge.driver) == ("can", "serial")
    assert (config.brake.driver, config.drive.driver) == ("modbus", "modbus")


def test_the_emulated_bench_keeps_to_this_computer():
    config = load(EMULATED)
    assert config.inverter.can.options["hop_limit"] == 0
    assert {config.brake.modbus.host, config.drive.modbus.host} == {"127.0.0.1"}


def test_the_emulated_bench_file_agrees_with_its_rig():
    config, rig = load(EMULATED), truth.load(load(EMULATED).bench.rig)
    configured, true = config.motor, rig.motor
    assert (configured.pole_pairs, configured.connection) == (true.pole_pairs, true.connection)
    assert configured.counts == rig.encoder.counts
    assert configured.back_emf == true.back_emf
    assert config.torque_sensor.gain_Nm_per_V == rig.torque_sensor.gain_Nm_per_V
    assert config.torque_sensor.resonance_Hz == rig.torque_sensor.resonance_Hz
    assert config.bridge.adc_V_per_count == pytest.approx(rig.torque_sensor.adc_V_per_count)
