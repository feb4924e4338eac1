"""The emulated Modbus devices, asked by a host that libmodbus makes, over TCP and RTU."""

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from motord.config import ModbusConfig
from motord.emulate.devices import RegisterDevice
from motord.emulate.modbus import ModbusServers
from motord.wire.modbus.pdu import crc16_modbus
from motord.wire.modbus.registers import DeviceStatus
from tests.modbus.peers import BAUD, Peer
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port

PATIENT_MS, SHORT_MS = 5000, 200


@dataclass
class Bench:
    """Two emulated devices in one place, units 1 and 2, and the libmodbus host."""

    transport: str
    where: str | int
    devices: dict[int, RegisterDevice]
    servers: ModbusServers
    hosts: list[Peer] = field(default_factory=list)

    def host(self) -> Peer:
        place = (self.where,) if self.transport == "tcp" else (self.where, BAUD)
        host = Peer("client", self.transport, *place)
        self.hosts.append(host)
        host("timeout", PATIENT_MS)
        return host

    def close(self) -> None:
        for host in self.hosts:
            host.close()
        self.servers.close()


def make(transport: str, folder: Path, **changes: object) -> Bench:
    port = free_port()
    where: str | int = port if transport == "tcp" else str(folder / "port")
    place = {"tcp_port": port} if transport == "tcp" else {"transport": "rtu", "serial_port": where}
    tables = {
        unit: ModbusConfig.model_validate({"unit": unit, **place, **changes}) for unit in (1, 2)
    }
    devices = {unit: RegisterDevice(table, -1.0, 1.0) for unit, table in tables.items()}
    servers = ModbusServers({str(unit): (tables[unit], devices[unit]) for unit in tables})
    servers.start()
    return Bench(transport, where, devices, servers)


@pytest.fixture(params=["tcp", "rtu"])
def transport(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def bench(transport: str, tmp_path: Path) -> Iterator[Bench]:
    bench = make(transport, tmp_path)
    yield bench
    bench.close()


def soon(host: Peer, *arguments: object) -> str:
    """Ask until there is an answer, three times at most: a computer may stall."""
    answers = (host(*arguments) for _ in range(3))
    return next((answer for answer in answers if not answer.startswith("error")), "error")


def test_a_set_point_is_taken_and_read_back(bench: Bench) -> None:
    host = bench.host()
    assert host("write", 0, 2500) == "ok"
    assert host("read", 0, 1) == "ok 2500"
    assert bench.devices[1].setpoint == pytest.approx(0.25)
    assert host("writes", 0, 7500) == "ok"
    assert host("read", 0, 1) == "ok 7500"
    assert bench.devices[1].setpoint == pytest.approx(0.75)


def test_units_of_one_place_are_apart(bench: Bench) -> None:
    host = bench.host()
    for unit in (1, 2, 1):
        host("unit", unit)
        assert host("write", 0, 1000 * unit) == "ok"
    assert [bench.devices[unit].setpoint for unit in (1, 2)] == pytest.approx([0.1, 0.2])


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        ("u16", 0.5, [32_768]),
        ("i16", -0.25, [0xFFFF - 16_383]),
        ("u32", 1.0, [1, 0]),
        ("i32", -0.5, [0xFFFF, 0x8000]),
    ],
)
def test_every_kind_and_word_order(
    transport: str, tmp_path: Path, kind: str, order: str, value: float, words: list[int]
) -> None:
    bench = make(
        transport, tmp_path, setpoint_kind=kind, value_kind=kind, word_order=order,
        setpoint_scale=1 / 65_536, value_scale=1 / 65_536, value_register=30, read_table="input",
    )  # fmt: skip
    there = words if order == "big" else words[::-1]
    host = bench.host()
    assert host("writes", 0, *there) == "ok"
    assert bench.devices[1].setpoint == value
    bench.devices[1].measure(value, DeviceStatus.FAULT)
    assert host.numbers("input", 30, len(words)) == there
    assert host.numbers("input", 16, 1) == [2]
    bench.close()


def test_half_of_a_number_may_be_written_at_a_time(transport: str, tmp_path: Path) -> None:
    bench = make(transport, tmp_path, setpoint_kind="i32", setpoint_scale=1e-6)
    host = bench.host()
    assert host("write", 1, 500) == "ok"
    assert bench.devices[1].setpoint == pytest.approx(500e-6)
    assert host("write", 0, 1) == "ok"
    assert bench.devices[1].setpoint == pytest.approx(66_036e-6)
    bench.close()


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (("read", 400, 1), 2),
        (("read", 16, 3), 2),
        (("input", 0, 1), 2),
        (("write", 16, 1), 2),
        (("writes", 0, 1, 2), 2),
        (("write", 0, 10_001), 3),
        (("writes", 0, 60_000), 3),
        (("bits", 0, 1), 1),
    ],
)
def test_what_cannot_be_is_refused(bench: Bench, asked: tuple[object, ...], code: int) -> None:
    host = bench.host()
    assert host("write", 0, 1234) == "ok"
    assert host(*asked) == f"exception {code}"
    assert host("read", 0, 1) == "ok 1234"
    assert bench.devices[1].setpoint == pytest.approx(0.1234)


@pytest.mark.parametrize("count", ["0000", "007e"])
def test_a_wrong_number_of_registers(bench: Bench, count: str) -> None:
    assert bench.host()("raw", "01030000" + count).startswith("exception")


def test_an_unknown_function(bench: Bench) -> None:
    """Reported over TCP; on a line it is unknown where such a request ends."""
    host = bench.host()
    if bench.transport == "rtu":
        host("timeout", SHORT_MS)
    answer = host("raw", "014100")
    assert answer == ("exception 1" if bench.transport == "tcp" else "error Connection timed out")
    host("timeout", PATIENT_MS)
    assert soon(host, "read", 16, 1) == "ok 1"


def test_mask_and_combined_functions(bench: Bench) -> None:
    host = bench.host()
    assert host("both", 0, 1000, 16, 2) == "ok 1 0"
    assert bench.devices[1].setpoint == pytest.approx(0.1)
    assert host("mask", 0, 0x00FF, 0x0100) == "ok"
    assert host("read", 0, 1) == f"ok {1000 & 0xFF | 0x100}"
    assert bench.devices[1].setpoint == pytest.approx((1000 & 0xFF | 0x100) * 1e-4)


def test_a_unit_that_is_not_there(bench: Bench) -> None:
    host = bench.host()
    host("unit", 9)
    if bench.transport == "tcp":
        assert host("read", 0, 1) == "exception 11"
    else:
        host("timeout", SHORT_MS)
        assert host("read", 0, 1) == "error Connection timed out"
        host("timeout", PATIENT_MS)
    host("unit", 1)
    assert host("read", 0, 1) == "ok 0"


class Silence:
    """What makes a device silent, and knows when a request has met it."""

    def __init__(self) -> None:
        self.met = threading.Event()

    def __bool__(self) -> bool:
        self.met.set()
        return True


def test_a_silent_device_answers_again(bench: Bench) -> None:
    host = bench.host()
    host("timeout", SHORT_MS)
    bench.devices[1].silent = silence = Silence()
    assert host("read", 0, 1) == "error Connection timed out"
    assert silence.met.wait(PATIENCE_S)
    bench.devices[1].silent = False
    host("timeout", PATIENT_MS)
    host("reconnect")
    assert host("read", 16, 1) == "ok 1"


def test_several_hosts_over_tcp(tmp_path: Path) -> None:
    bench = make("tcp", tmp_path)
    first, second = bench.host(), bench.host()
    first("write", 0, 100)
    assert second("read", 0, 1) == "ok 100"
    first.close()
    assert second("write", 0, 200) == "ok"
    assert bench.devices[1].setpoint == pytest.approx(0.02)
    bench.close()


def frame(*body: int) -> str:
    return (bytes(body) + crc16_modbus(bytes(body)).to_bytes(2, "little")).hex()


@pytest.mark.parametrize(
    "noise",
    [
        "00",
        "ff00ff",
        frame(1, 6, 0, 0, 3, 232)[:-4],  # a write without its checksum
        frame(1, 6, 0, 0, 3, 232)[:-1] + "0",  # or with a wrong one
        frame(1, 16, 0, 0, 0, 1, 2, 3, 232)[:10],
        frame(9, 6, 0, 0, 3, 232),  # another unit's
        bytes(range(200)).hex(),
    ],
)
def test_noise_on_the_line_is_never_a_command(tmp_path: Path, noise: str) -> None:
    """What was garbled changes nothing, and after a pause the next request is answered."""
    bench = make("rtu", tmp_path)
    host = bench.host()
    assert host("write", 0, 500) == "ok"
    host("bytes", noise)
    host("timeout", SHORT_MS)
    for _ in range(20):
        if host("read", 0, 1) == "ok 500":
            break
    else:
        pytest.fail("no answer any more")
    assert bench.devices[1].setpoint == pytest.approx(0.05)
    bench.close()


def test_a_request_right_after_noise_is_answered_soon(tmp_path: Path) -> None:
    """What was on the line before it is not taken for its beginning for long."""
    bench = make("rtu", tmp_path)
    host = bench.host()
    host("timeout", SHORT_MS)
    for noise in ("01", "0106", frame(1, 3, 0, 0, 0, 1)[:6], "00" * 3):
        host("bytes", noise)
        host("read", 0, 1)
        host("timeout", PATIENT_MS)
        assert soon(host, "read", 0, 1) == "ok 0", noise
        host("timeout", SHORT_MS)
    bench.close()
