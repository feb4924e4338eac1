"""The motor's temperatures on the emulator: heated by the rig's currents, read over Modbus."""

import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient

from motord.config import Config, ConfigError, load
from motord.config.reading import check_text
from motord.emulate import EmulatorError
from motord.emulate.bench import EmulatedBench
from motord.emulate.modbus import ModbusServers
from motord.emulate.selection import register_devices
from motord.schema import TRUTH_DTYPE
from tests.support.ports import free_port
from tests.unit.emulate.benches import EMULATED, write_bench
from tests.unit.emulate.test_bench import CONFIG, CURRENTS, TRUTH, operate

CHANNELS = """
[[channels]]
name = "winding_C"
unit = "degC"
scale = 0.1
offset = -40.0
source = {{driver = "modbus", tcp_port = {port}, unit = 5, address = 10, emulated = "winding_C"}}

[[channels]]
name = "housing_C"
unit = "degC"
scale = 0.001
source = {{driver = "modbus", tcp_port = {port}, unit = 5, address = 20, kind = "u32",
          emulated = "housing_C"}}

[[channels]]
name = "oil_bar"
unit = "bar"
source = {{driver = "modbus", tcp_port = 1, address = 1}}
"""


def bench(folder, text: str) -> Config:
    path = write_bench(folder)
    path.write_text(path.read_text() + text.replace(",\n          ", ", "))
    return load(path)


def test_the_currents_of_the_rig_heat_the_motor():
    emulated = EmulatedBench(CONFIG, TRUTH, 0)
    operate(emulated, 0, 500)
    heated_K = emulated.thermal.named_C["winding_C"] - 25.0
    copper_W = TRUTH.motor.resistance_ohm * sum(i_A * i_A for i_A in CURRENTS)
    most_K = 0.5 * copper_W / TRUTH.thermal.winding_J_per_K
    assert 0.7 * most_K < heated_K < 1.1 * most_K  # a tenth of a second of it is still to come


def test_registers_say_what_the_temperatures_are(tmp_path):
    port = free_port()
    config = bench(tmp_path, CHANNELS.format(port=port))
    emulated = EmulatedBench(config, TRUTH, 0)
    emulated.thermal.temperatures_C = (81.26, 50.0, 44.4444)
    devices = register_devices(config, emulated)
    assert list(devices) == ["brake", "drive", "channel winding_C"]
    servers = ModbusServers({"channels": devices["channel winding_C"]})
    servers.start()
    try:
        with ModbusTcpClient("127.0.0.1", port=port) as client:
            assert client.read_input_registers(10, device_id=5).registers == [1213]
            assert client.read_input_registers(20, count=2, device_id=5).registers == [0, 44444]
            assert client.write_register(10, 1, device_id=5).isError()
    finally:
        servers.close()


def test_a_unit_that_the_brake_has_is_refused(tmp_path):
    path = write_bench(tmp_path)
    brake = load(path).brake.modbus
    assert brake is not None
    text = CHANNELS.format(port=brake.tcp_port).replace("unit = 5", "unit = 1")
    path.write_text(path.read_text() + text.replace(",\n          ", ", "))
    config = load(path)
    with pytest.raises(EmulatorError, match="both unit 1"):
        ModbusServers(register_devices(config, EmulatedBench(config, TRUTH, 0)))


def test_simulated_channels_are_not_for_the_emulator(tmp_path):
    text = '[[channels]]\nname = "a"\nunit = ""\nsource = {driver = "simulated"}\n'
    with pytest.raises(ConfigError, match='with the emulator take driver = "modbus"'):
        bench(tmp_path, text)


def test_the_power_of_the_emulated_bench_is_what_its_rig_takes():
    emulated, truth = EmulatedBench(CONFIG, TRUTH, 0), np.zeros(3, TRUTH_DTYPE)
    for row, from_ms in enumerate((0, 400, 500)):
        operate(emulated, from_ms, (400, 500, 501)[row])
        emulated.fill_truth(0, truth[row])
    taken_J = truth["energy_dc_J"][1] - truth["energy_dc_J"][0]
    assert taken_J > 0.2
    assert emulated.quantities["dc_power_W"] == pytest.approx(taken_J / 0.1, rel=0.1)


def test_the_example_in_the_bench_file_is_one():
    lines = EMULATED.read_text().splitlines()
    begin = next(n for n, line in enumerate(lines) if line.startswith("# [[channels]]"))
    end = lines.index("", begin)
    example = "\n".join(line.removeprefix("# ") for line in lines[begin:end])
    [channel] = check_text(EMULATED, "\n".join([*lines, example])).channels
    assert (channel.name, channel.trip_above) == ("winding_C", 130.0)
    assert channel.source.model_dump()["emulated"] == "winding_C"
