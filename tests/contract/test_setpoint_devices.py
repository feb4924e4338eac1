"""What every slow device with one set-point promises (`hal.base.SetpointDevice`).

A driver joins by a function in `DEVICES`, or by the option `--setpoint-device=MODULE:FUNCTION`,
that yields a `Pair`; its set-point is that of a brake, 0 to 1. That each promise is one that a
driver can break is shown in `test_mutants`.
"""

import math
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from motord.config import BrakeConfig, Config, ModbusConfig
from motord.emulate.devices import RegisterDevice
from motord.emulate.modbus import ModbusServers
from motord.hal.base import DeviceError, DeviceReading, SetpointDevice
from motord.hal.modbus.devices import ModbusDevice
from motord.hal.modbus.link import RtuLink, TcpLink
from motord.hal.registry import make_setpoint_device
from motord.wire.modbus.registers import DeviceStatus, layout
from tests.contract.peers import MOTOR, until
from tests.modbus.peers import BAUD, Peer, SerialLine
from tests.support.patience import PATIENCE_S

GONE_S = 0.15
"""Timeout once the other end is gone: on a serial line it is silent. While it is there a driver
waits with the tests' patience, longer than a bench file may let it.
"""


@dataclass
class Pair:
    """A device under test, not yet open, and its other end."""

    device: SetpointDevice
    received: Callable[[], float]
    """The set-point that the other end has."""
    measure: Callable[[float, DeviceStatus], None]
    """Lets the other end say this value and status from now on."""
    vanish: Callable[[], None]
    """Ends the other end for good."""


def modbus_tcp(folder: Path) -> Iterator[Pair]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    yield from _modbus(ModbusConfig(tcp_port=port))


def modbus_wide(folder: Path) -> Iterator[Pair]:
    """The other way in all that a table may say of registers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    table = ModbusConfig(
        tcp_port=port, unit=7, setpoint_kind="i32", setpoint_scale=1e-6,
        read_table="input", status_register=0, value_register=1, value_kind="i32",
        value_scale=1e-3, word_order="little",
    )  # fmt: skip
    yield from _modbus(table)


def modbus_rtu(folder: Path) -> Iterator[Pair]:
    port = str(folder / "port")
    yield from _modbus(ModbusConfig(transport="rtu", serial_port=port))


def _config(table: ModbusConfig) -> Config:
    return Config(motor=MOTOR, brake=BrakeConfig(driver="modbus", modbus=table))


def _pair(table: ModbusConfig, end: Callable[[], None], **other_end: Callable[..., Any]) -> Pair:
    """Return a driver for `table` and its other end, which `end` ends."""
    device = make_setpoint_device("brake", _config(table))
    assert isinstance(device, ModbusDevice)
    client = device._client

    def wait_for(timeout_s: float) -> None:
        client._config = client._config.model_copy(update={"timeout_s": timeout_s})
        if isinstance(client._link, TcpLink | RtuLink):
            client._link._timeout_s = timeout_s

    def vanish() -> None:
        end()
        wait_for(GONE_S)

    wait_for(PATIENCE_S)
    return Pair(device, vanish=vanish, **other_end)


def _modbus(table: ModbusConfig) -> Iterator[Pair]:
    other_end = RegisterDevice(table, 0.0, 1.0)
    servers = ModbusServers({"brake": (table, other_end)})
    servers.start()
    pair = _pair(
        table, servers.close, received=lambda: other_end.setpoint, measure=other_end.measure
    )
    yield pair
    pair.device.close()
    servers.close()


def libmodbus_tcp(folder: Path) -> Iterator[Pair]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    yield from _libmodbus(ModbusConfig(tcp_port=port), Peer("server", "tcp", port, 1))


def libmodbus_rtu(folder: Path) -> Iterator[Pair]:
    line = SerialLine()
    try:
        table = ModbusConfig(transport="rtu", serial_port=line.host)
        yield from _libmodbus(table, Peer("server", "rtu", line.device, BAUD, 1))
    finally:
        line.close()


def _libmodbus(table: ModbusConfig, other_end: Peer) -> Iterator[Pair]:
    with other_end:
        parts = layout(table)

        def received() -> float:
            return parts.setpoint.decode(other_end.numbers("read", parts.setpoint.address))

        def measure(value: float, status: DeviceStatus) -> None:
            [count] = parts.value.encode(value)
            assert other_end("holding", parts.value.address, count) == "ok"
            assert other_end("holding", parts.status.address, parts.status_word(status)) == "ok"

        pair = _pair(table, other_end.close, received=received, measure=measure)
        yield pair
        pair.device.close()


DEVICES = (modbus_tcp, modbus_wide, modbus_rtu, libmodbus_tcp, libmodbus_rtu)


@pytest.fixture
def pair(make_pair: Callable[[Path], Iterator[Pair]], tmp_path: Path) -> Iterator[Pair]:
    with contextmanager(make_pair)(tmp_path) as made:
        yield made


def test_exchange_writes_and_reads_back(pair: Pair) -> None:
    """What is read back is what the device has, which rounds; not what it was sent."""
    pair.device.open()
    for asked in (0.5, 0.123456):
        reading = pair.device.exchange(asked)
        assert isinstance(reading, DeviceReading)
        assert pair.received() == pytest.approx(asked, abs=1e-3)
        assert reading.setpoint == pytest.approx(pair.received(), abs=1e-9)


def test_shows_what_the_device_says(pair: Pair) -> None:
    pair.device.open()
    for value, status in (
        (12.5, DeviceStatus.READY),
        (-3.0, DeviceStatus.FAULT),
        (7.0, DeviceStatus.READY | DeviceStatus.FAULT),
    ):
        pair.measure(value, status)
        reading = pair.device.exchange(0.5)
        assert reading.value == pytest.approx(value, abs=0.05)
        assert reading.status == status


@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
def test_a_setpoint_that_is_no_number_is_zero(pair: Pair, wild: float) -> None:
    pair.device.open()
    pair.device.exchange(0.5)
    assert pair.received() == pytest.approx(0.5, abs=1e-3)
    pair.device.exchange(wild)
    assert pair.received() == 0.0


def test_a_setpoint_is_kept_in_its_range(pair: Pair) -> None:
    pair.device.open()
    for asked, kept in ((7.0, 1.0), (-7.0, 0.0)):
        pair.device.exchange(asked)
        assert pair.received() == kept


def test_opening_asks_for_nothing(pair: Pair) -> None:
    """A device that is opened anew goes on with its last set-point, until it gets another."""
    pair.device.open()
    pair.device.exchange(0.5)
    pair.device.close()
    pair.device.open()
    assert pair.received() == pytest.approx(0.5, abs=1e-3)


def test_safe_stop_at_any_time(pair: Pair) -> None:
    pair.device.safe_stop()
    pair.device.open()
    pair.device.exchange(1.0)
    pair.device.safe_stop()
    assert pair.received() == 0.0
    pair.device.exchange(1.0)
    pair.device.close()
    pair.device.safe_stop()
    assert pair.received() == 0.0


def test_closes_twice_and_leaves_nothing_open(pair: Pair) -> None:
    def held() -> tuple[int, int]:
        return len(os.listdir("/proc/self/fd")), threading.active_count()  # noqa: PTH208

    before = held()
    pair.device.open()
    pair.device.exchange(0.5)
    pair.device.close()
    pair.device.close()
    until(lambda: held() == before)  # the other end's too


def test_a_device_that_is_gone_is_one_clear_line(pair: Pair) -> None:
    """Each time; what it last said is not passed on as what it says."""
    pair.device.open()
    pair.device.exchange(0.5)
    pair.vanish()
    for use in (lambda: pair.device.exchange(0.5), pair.device.open):
        with pytest.raises(DeviceError) as caught:
            use()
        assert "brake" in str(caught.value)
        assert "\n" not in str(caught.value)
    pair.device.safe_stop()
