import math
import os
import socket
import struct
import threading
import tty
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motord.config import Config, ModbusConfig
from motord.emulate.devices import RegisterDevice
from motord.emulate.modbus import ModbusServers
from motord.hal.base import DeviceError
from motord.hal.modbus import devices
from motord.hal.modbus.devices import ModbusDevice
from motord.wire.modbus.registers import DeviceStatus
from tests.contract.peers import until
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port
from tests.support.properties import examples

AT_ONCE_S = 1e-9
"""For what never answers: it is over before the first attempt, which is made all the same."""

MOTOR = {
    "name": "motor",
    "pole_pairs": 8,
    "slots": 48,
    "counts": 4096,
    "rated_torque_Nm": 6.0,
    "connection": "independent",
    "back_emf": ({"order": 1, "amplitude_V_s_per_rad": 0.206},),
}


def patient(**table):
    """Return a table that waits for an answer longer than a bench file may let it."""
    return ModbusConfig(**table).model_copy(update={"timeout_s": PATIENCE_S})


def tables(tmp_path):
    """One table for each transport and each way that the registers can lie."""
    return {
        "tcp": patient(tcp_port=free_port()),
        "tcp-wide": patient(
            tcp_port=free_port(),
            unit=7,
            setpoint_kind="i32",
            setpoint_scale=1e-6,
            read_table="input",
            status_register=0,
            value_register=1,
            value_kind="i32",
            value_scale=1e-3,
            word_order="little",
        ),
        "rtu": patient(transport="rtu", serial_port=str(tmp_path / "port")),
    }


@pytest.fixture(params=["tcp", "tcp-wide", "rtu"])
def pair(request, tmp_path):
    """Yield (host, device): both ends of one connection."""
    table = tables(tmp_path)[request.param]
    device = RegisterDevice(table, -1.0, 1.0)
    servers = ModbusServers({"brake": (table, device)})
    servers.start()
    host = ModbusDevice("brake", table, -1.0, 1.0)
    yield host, device
    host.close()
    servers.close()


def test_a_fault_is_seen(pair):
    host, device = pair
    device.measure(math.nan, DeviceStatus.FAULT)
    reading = host.exchange(0.0)
    assert reading.status == DeviceStatus.FAULT
    assert reading.value == 0.0


def test_the_next_exchange_connects_again(pair):
    host, _ = pair
    host.exchange(0.5)
    host.close()
    assert host.exchange(0.75).setpoint == pytest.approx(0.75)


@pytest.fixture(scope="module")
def brake_pair():
    table = patient(tcp_port=free_port())
    device = RegisterDevice(table, 0.0, 1.0)
    servers = ModbusServers({"brake": (table, device)})
    servers.start()
    host = ModbusDevice("brake", table, 0.0, 1.0)
    yield host, device
    host.close()
    servers.close()


@settings(max_examples=examples(50), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(setpoint=st.floats())
def test_no_set_point_leaves_the_range(brake_pair, setpoint):
    host, device = brake_pair
    reading = host.exchange(setpoint)
    assert 0.0 <= device.setpoint <= 1.0
    expected = min(max(setpoint, 0.0), 1.0) if math.isfinite(setpoint) else 0.0
    assert reading.setpoint == pytest.approx(expected, abs=6e-5)


def test_a_refused_connection_is_one_clear_line():
    table = ModbusConfig(tcp_port=free_port(), connect_timeout_s=AT_ONCE_S)
    with pytest.raises(DeviceError) as caught:
        ModbusDevice("brake", table, 0.0, 1.0).open()
    line = str(caught.value)
    assert line.startswith(f"[brake.modbus] 127.0.0.1:{table.tcp_port} unit 1: refused")
    assert "\n" not in line
    ModbusDevice("brake", table, 0.0, 1.0).safe_stop()  # nothing to stop: silent


def test_a_device_may_still_be_starting_when_it_is_opened(monkeypatch):
    """It is switched on together with the computer, or that is busy."""
    table = patient(tcp_port=free_port(), connect_timeout_s=60.0)
    servers = ModbusServers({"brake": (table, RegisterDevice(table, 0.0, 1.0))})
    pauses_s = []

    def pause(pause_s):
        pauses_s.append(pause_s)
        if len(pauses_s) == 3:
            servers.start()

    monkeypatch.setattr("motord.hal.modbus.devices.time.sleep", pause)
    host = ModbusDevice("brake", table, 0.0, 1.0)
    host.open()
    assert len(pauses_s) >= 3
    assert host.exchange(0.5).setpoint == pytest.approx(0.5, abs=6e-5)
    host.close()
    servers.close()


@pytest.fixture
def not_tried_again(monkeypatch):
    """Fail if a driver waits: these errors no waiting mends."""
    monkeypatch.setattr("motord.hal.modbus.devices.time.sleep", lambda _: pytest.fail("waited"))


def test_a_host_that_does_not_exist_is_named(not_tried_again):
    table = ModbusConfig(host="no-such-host.invalid")
    with pytest.raises(DeviceError, match=r"no-such-host\.invalid:502 unit 1: cannot connect"):
        ModbusDevice("drive", table, 0.0, 1.0).open()


def test_a_wrong_unit_is_reported_over_tcp(brake_pair):
    host, _ = brake_pair
    table = host._config.model_copy(update={"unit": 9, "connect_timeout_s": AT_ONCE_S})
    stranger = ModbusDevice("brake", table, 0.0, 1.0)
    with pytest.raises(DeviceError, match=r"unit 9: .*exception 11 \(no such unit\)"):
        stranger.open()
    stranger.close()


def test_a_wrong_register_is_reported(brake_pair, not_tried_again):
    host, _ = brake_pair
    table = host._config.model_copy(update={"status_register": 400})
    lost = ModbusDevice("brake", table, 0.0, 1.0)
    with pytest.raises(DeviceError, match=r"register 400: .*exception 2 \(no such register\)"):
        lost.open()
    lost.close()


def test_a_value_out_of_the_devices_range_is_reported(brake_pair):
    host, device = brake_pair
    host.exchange(0.5)
    greedy = ModbusDevice("brake", host._config, 0.0, 2.0)
    with pytest.raises(DeviceError, match=r"exception 3 \(value not accepted\)"):
        greedy.exchange(1.5)
    greedy.close()
    assert device.setpoint == 0.5


class Scripted:
    """A TCP server that answers each request with what `answer(request)` returns."""

    def __init__(self, answer):
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]
        self.connections = 0
        self.answer = answer
        self.thread = threading.Thread(target=self.serve)
        self.thread.start()

    def serve(self):
        while True:
            try:
                connection, _ = self.server.accept()
            except OSError:
                return
            self.connections += 1
            with connection, suppress(ConnectionError):  # a request without an answer is aborted
                while request := connection.recv(300):
                    answer = self.answer(request)
                    if answer is None:
                        break
                    connection.sendall(answer)

    def close(self):
        self.server.shutdown(socket.SHUT_RDWR)
        self.server.close()
        self.thread.join()


@pytest.fixture
def scripted():
    servers = []

    def make(answer, *, answers=True):
        server = Scripted(answer)
        table = patient(tcp_port=server.port, connect_timeout_s=AT_ONCE_S)
        if not answers:
            table = table.model_copy(update={"timeout_s": 0.05})
        host = ModbusDevice("brake", table, 0.0, 1.0)
        servers.append((server, host))
        return server, host

    yield make
    for server, host in servers:
        host.close()
        server.close()


def test_silence_costs_one_timeout_and_the_next_exchange_connects_anew(scripted):
    requests = []
    server, host = scripted(lambda request: requests.append(request) or b"", answers=False)
    for _ in range(2):
        with pytest.raises(DeviceError, match=r"no valid answer within 0\.05 s"):
            host.exchange(0.0)
    host.close()
    with socket.create_connection(("127.0.0.1", server.port)) as last:  # it takes them in turn
        last.sendall(b"last")
        until(lambda: b"last" in requests)
    assert (len(requests), server.connections) == (3, 3)  # nothing is asked again


def test_a_connection_that_ends_is_reported(scripted):
    _, host = scripted(lambda _request: None)
    with pytest.raises(DeviceError, match="connection lost"):
        host.exchange(0.0)


def test_an_answer_of_the_wrong_length_is_reported(scripted):
    def two_registers(request):
        transaction = request[:2]
        return transaction + struct.pack(">HHBBBHH", 0, 7, 1, 3, 4, 1, 2)

    _, host = scripted(two_registers)
    with pytest.raises(DeviceError, match="does not fit the question"):
        host.open()


def test_an_unknown_exception_code_is_reported(scripted):
    _, host = scripted(lambda r: r[:2] + struct.pack(">HHBBB", 0, 3, 1, 0x83, 99))
    with pytest.raises(DeviceError, match=r"exception 99 \(unknown cause\)"):
        host.open()


def test_a_late_answer_is_never_taken_for_a_later_one(scripted):
    seen = []

    def late(request):
        """Answer reads of the status only from the second connection on."""
        seen.append(request)
        return (
            b"" if len(seen) == 1 else b"".join((request[:2], bytes.fromhex("0000000501030200ff")))
        )

    _, host = scripted(late, answers=False)
    with pytest.raises(DeviceError, match="no valid answer"):
        host.open()
    host._client._config = host._config.model_copy(update={"timeout_s": PATIENCE_S})
    host.open()
    assert len(seen) == 2


def test_a_serial_port_that_is_missing_is_named(tmp_path, not_tried_again):
    table = ModbusConfig(transport="rtu", serial_port=str(tmp_path / "ttyX"))
    with pytest.raises(DeviceError, match=r"ttyX unit 1: cannot open it: there is no such port; "):
        ModbusDevice("drive", table, -1.0, 1.0).open()


def test_a_silent_serial_device_times_out():
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    table = ModbusConfig(transport="rtu", serial_port=os.ttyname(host_fd), timeout_s=0.05)
    host = ModbusDevice("drive", table, -1.0, 1.0)
    with pytest.raises(DeviceError, match="no valid answer within"):
        host.exchange(0.5)
    host.close()
    os.close(device_fd)
    os.close(host_fd)


def test_brake_and_drive_take_limits_from_the_bench():
    table = {"tcp_port": free_port()}
    config = Config.model_validate(
        {
            "motor": MOTOR,
            "brake": {"driver": "modbus", "modbus": table},
            "drive": {
                "driver": "modbus",
                "modbus": {**table, "watchdog_s": 0.2, "setpoint_kind": "i32"},
                "speed_max_rad_s": 12.0,
            },
        }
    )
    brake, drive = devices.brake(config), devices.drive(config)
    assert (brake._low, brake._high) == (0.0, 1.0)
    assert (drive._low, drive._high) == (-12.0, 12.0)
