"""What every slow device with one set-point promises (`hal.base.SetpointDevice`).

A driver joins by a function in `DEVICES` that yields the device, and what its other end was told.
"""

import math
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from motord.config import BrakeConfig, Config, ModbusConfig
from motord.emulate.devices import RegisterDevice
from motord.emulate.modbus import ModbusServers
from motord.hal.base import DeviceError, DeviceReading, SetpointDevice
from motord.hal.registry import make_setpoint_device
from motord.wire.registers import layout
from tests.contract.peers import MOTOR
from tests.modbus.peers import BAUD, Peer, SerialLine

Told = Callable[[], float]
Pair = tuple[SetpointDevice, Told, Callable[[], None]]


def modbus_tcp(folder: Path) -> Iterator[Pair]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    yield from _modbus(ModbusConfig(tcp_port=port, timeout_s=2.0))


def modbus_rtu(folder: Path) -> Iterator[Pair]:
    port = str(folder / "port")
    yield from _modbus(ModbusConfig(transport="rtu", serial_port=port, timeout_s=2.0))


def _config(table: ModbusConfig) -> Config:
    return Config(motor=MOTOR, brake=BrakeConfig(driver="modbus", modbus=table))


def _modbus(table: ModbusConfig) -> Iterator[Pair]:
    other_end = RegisterDevice(table, 0.0, 1.0)
    servers = ModbusServers({"brake": (table, other_end)})
    servers.start()
    device = make_setpoint_device("brake", _config(table))
    yield device, lambda: other_end.setpoint, servers.close
    device.close()
    servers.close()


def libmodbus_tcp(folder: Path) -> Iterator[Pair]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    yield from _libmodbus(
        ModbusConfig(tcp_port=port, timeout_s=2.0), Peer("server", "tcp", port, 1)
    )


def libmodbus_rtu(folder: Path) -> Iterator[Pair]:
    line = SerialLine()
    try:
        table = ModbusConfig(transport="rtu", serial_port=line.host, timeout_s=1.0)
        yield from _libmodbus(table, Peer("server", "rtu", line.device, BAUD, 1))
    finally:
        line.close()


def _libmodbus(table: ModbusConfig, other_end: Peer) -> Iterator[Pair]:
    with other_end:
        device = make_setpoint_device("brake", _config(table))
        told = layout(table).setpoint
        yield device, lambda: told.decode(other_end.numbers("read", told.address)), other_end.close
        device.close()


DEVICES = (modbus_tcp, modbus_rtu, libmodbus_tcp, libmodbus_rtu)


@pytest.fixture(params=DEVICES, ids=lambda make: make.__name__)
def pair(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Pair]:
    with contextmanager(request.param)(tmp_path) as made:
        yield made


def test_exchange_writes_and_reads_back(pair: Pair) -> None:
    device, told, _ = pair
    device.open()
    reading = device.exchange(0.5)
    assert isinstance(reading, DeviceReading)
    assert reading.setpoint == pytest.approx(0.5, abs=1e-3)
    assert told() == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
def test_a_setpoint_that_is_no_number_is_zero(pair: Pair, wild: float) -> None:
    device, told, _ = pair
    device.open()
    device.exchange(0.5)
    device.exchange(wild)
    assert told() == 0.0


def test_a_setpoint_is_kept_in_its_range(pair: Pair) -> None:
    device, told, _ = pair
    device.open()
    for asked, kept in ((7.0, 1.0), (-7.0, 0.0)):
        device.exchange(asked)
        assert told() == kept


def test_safe_stop_at_any_time(pair: Pair) -> None:
    device, told, _ = pair
    device.safe_stop()
    device.open()
    device.exchange(1.0)
    device.safe_stop()
    assert told() == 0.0
    device.close()
    device.safe_stop()


def test_closes_twice(pair: Pair) -> None:
    device, _, _ = pair
    device.open()
    device.close()
    device.close()


def test_a_device_that_is_gone_is_one_clear_line(pair: Pair) -> None:
    device, _, end = pair
    device.open()
    end()
    for use in (lambda: device.exchange(0.5), device.open):
        with pytest.raises(DeviceError) as caught:
            use()
        assert "brake" in str(caught.value)
        assert "\n" not in str(caught.value)
    device.safe_stop()
