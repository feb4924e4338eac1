import socket
import threading

import pytest
from pymodbus.client import ModbusTcpClient

from motord.config import ModbusConfig
from motord.emulate import EmulatorError, modbus
from motord.emulate.devices import RegisterDevice
from motord.emulate.modbus import ModbusServers
from tests.support.ports import free_port


def unit(**table):
    config = ModbusConfig(**table)
    return config, RegisterDevice(config, 0.0, 1.0)


def test_two_units_share_a_port():
    port = free_port()
    devices = {"brake": unit(tcp_port=port, unit=1), "drive": unit(tcp_port=port, unit=2)}
    servers = ModbusServers(devices)
    servers.start()
    with ModbusTcpClient("127.0.0.1", port=port) as client:
        client.write_register(0, 1000, device_id=1)
        client.write_register(0, 2000, device_id=2)
    servers.close()
    assert [device.setpoint for _, device in devices.values()] == pytest.approx([0.1, 0.2])


def test_two_devices_may_not_be_the_same_unit():
    with pytest.raises(EmulatorError, match=r"\[drive.modbus\] and \[brake.modbus\] are both unit"):
        ModbusServers({"brake": unit(), "drive": unit()})


def test_a_port_in_use_is_reported_and_nothing_is_left_running(tmp_path):
    link = tmp_path / "port"
    before = threading.active_count()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        servers = ModbusServers(
            {
                "brake": unit(transport="rtu", serial_port=str(link)),
                "drive": unit(tcp_port=taken.getsockname()[1]),
            }
        )
        with pytest.raises(EmulatorError, match=r"Address already in use; is another emulator"):
            servers.start()
    servers.close()
    assert threading.active_count() == before
    assert not link.is_symlink()


def test_a_port_that_is_taken_at_the_last_moment_is_refused(monkeypatch):
    monkeypatch.setattr(modbus, "_refuse_taken", lambda *_: None)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        servers = ModbusServers({"drive": unit(tcp_port=taken.getsockname()[1])})
        with pytest.raises(EmulatorError, match=r"Modbus at 127\.0\.0\.1: Could not start listen"):
            servers.start()


def test_an_address_of_another_computer_is_reported():
    servers = ModbusServers({"brake": unit(host="192.0.2.77", tcp_port=free_port())})
    with pytest.raises(EmulatorError, match=r"192\.0\.2\.77:\d+: Cannot assign"):
        servers.start()


def test_status_and_value_are_read_only():
    port = free_port()
    servers = ModbusServers({"brake": unit(tcp_port=port)})
    servers.start()
    with ModbusTcpClient("127.0.0.1", port=port) as client:
        assert client.write_register(16, 1, device_id=1).exception_code == 2
        assert client.read_holding_registers(16, count=2, device_id=1).registers == [1, 0]
    servers.close()


def test_address_texts():
    assert ModbusConfig(host="10.0.0.1", tcp_port=502).place == "10.0.0.1:502"
    assert ModbusConfig(transport="rtu", serial_port="/dev/x").place == "/dev/x"
