"""The driver of the slow devices against a device that libmodbus makes, over TCP and RTU."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from motord.config import ModbusConfig
from motord.hal.base import DeviceError
from motord.hal.modbus.devices import ModbusDevice
from motord.wire.modbus.registers import DeviceStatus, layout
from tests.modbus.peers import BAUD, Peer, SerialLine
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port

UNIT = 7
SETPOINT, STATUS, VALUE = 4, 16, 20
SHORT_S = 0.15
"""For answers that never come. Those that do come may take long on a busy computer."""
LONG_S = PATIENCE_S
"""Longer than a bench file may say."""


@dataclass
class Bench:
    """The libmodbus device, and where it is."""

    table: ModbusConfig
    peer: Peer
    line: SerialLine | None = None

    def host(self, **changes: object) -> ModbusDevice:
        """Return a driver for it, its table changed; it waits for `LONG_S` unless that is."""
        timeout = {"timeout_s": changes.pop("timeout_s", LONG_S)}
        table = ModbusConfig.model_validate(self.table.model_dump() | changes)
        return ModbusDevice("brake", table.model_copy(update=timeout), -1.0, 1.0)

    def restart(self) -> None:
        """Switch the device off and on: all registers are zero again."""
        self.peer.close()
        self.peer = start(self.table, self.line)
        self.peer("holding", STATUS, 1)

    def close(self) -> None:
        self.peer.close()
        if self.line:
            self.line.close()


def start(table: ModbusConfig, line: SerialLine | None) -> Peer:
    if line is None:
        return Peer("server", "tcp", table.tcp_port, UNIT)
    return Peer("server", "rtu", line.device, BAUD, UNIT)


def make(transport: str) -> Bench:
    common = {
        "unit": UNIT,
        "setpoint_register": SETPOINT,
        "setpoint_kind": "i16",
        "status_register": STATUS,
        "value_register": VALUE,
    }
    line = SerialLine() if transport == "rtu" else None
    place = (
        {"transport": "rtu", "serial_port": line.host, "baud": BAUD}
        if line
        else {"tcp_port": free_port()}
    )
    table = ModbusConfig.model_validate(common | place)
    try:
        bench = Bench(table, start(table, line), line)
    except BaseException:
        if line:
            line.close()
        raise
    bench.peer("holding", STATUS, 1)
    return bench


@pytest.fixture(params=["tcp", "rtu"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = make(request.param)
    yield bench
    bench.close()


@pytest.fixture
def serial() -> Iterator[Bench]:
    bench = make("rtu")
    yield bench
    bench.close()


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize("kind", ["u16", "i16", "u32", "i32"])
def test_every_kind_and_word_order_reads_back(bench: Bench, kind: str, order: str) -> None:
    host = bench.host(
        setpoint_kind=kind, value_kind=kind, word_order=order, read_table="input",
        setpoint_scale=1 / 30_000, value_scale=0.25,
    )  # fmt: skip
    parts = layout(host._config)
    bench.peer("input", STATUS, 3)
    low = 0.0 if kind.startswith("u") else -1.0
    for asked, measured in ((1.0, 12.5), (0.125, 7.25), (low, low * 3000.25)):
        for at, word in enumerate(parts.value.encode(measured)):
            bench.peer("input", VALUE + at, word)
        reading = host.exchange(asked)
        assert reading.setpoint == pytest.approx(asked, abs=1 / 60_000)
        assert reading.value == measured
        assert reading.status == DeviceStatus.READY | DeviceStatus.FAULT
        stored = [
            bench.peer.numbers("read", SETPOINT + at)[0] for at in range(parts.setpoint.words)
        ]
        assert stored == parts.setpoint.encode(asked)
    host.close()


def test_words_are_where_the_order_says(bench: Bench) -> None:
    """65537 counts are the words 1 and 1; 65538 distinguish the two."""
    for order, words in (("big", [1, 2]), ("little", [2, 1])):
        host = bench.host(setpoint_kind="u32", setpoint_scale=1 / 65_538, word_order=order)
        host.exchange(1.0)
        assert [bench.peer.numbers("read", SETPOINT + at)[0] for at in range(2)] == words
        host.close()


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (1, "illegal function"),
        (2, "no such register"),
        (3, "value not accepted"),
        (4, "device failure"),
        (5, "accepted, but still busy"),
        (6, "busy"),
        (10, "no path to the unit"),
        (11, "no such unit"),
    ],
)
def test_exceptions_are_reported_and_keep_the_connection(
    bench: Bench, code: int, expected: str
) -> None:
    host = bench.host()
    for register, what in ((SETPOINT, "write"), (STATUS, "read")):
        bench.peer("exception", register, code)
        with pytest.raises(DeviceError, match=rf"{what} of .*exception {code} \({expected}\)"):
            host.exchange(0.5)
        bench.peer("exception", register, 0)
        assert host.exchange(0.25).setpoint == pytest.approx(0.25)
    if bench.line is None:
        assert bench.peer.numbers("counts")[0] == 1
    host.close()


def test_a_register_that_is_not_there(bench: Bench) -> None:
    host = bench.host(value_register=900)
    with pytest.raises(DeviceError, match=r"register 900: .*exception 2 \(no such register\)"):
        host.exchange(0.5)
    host.close()


def test_a_wrong_unit(bench: Bench) -> None:
    timeout_s = SHORT_S if bench.line else LONG_S
    host = bench.host(unit=9, timeout_s=timeout_s, connect_timeout_s=SHORT_S)
    expected = "no valid answer within" if bench.line else r"exception 11 \(no such unit\)"
    with pytest.raises(DeviceError, match=rf"unit 9: .*{expected}"):
        host.open()
    host.close()
    assert bench.peer.numbers("read", SETPOINT) == [0]


def test_silence_is_reported_and_the_next_exchange_works(bench: Bench) -> None:
    host = bench.host(timeout_s=SHORT_S)
    for lost in range(4):  # one of each request of an exchange
        answered(host, 0.5)
        bench.peer("silent", 0)
        times_out(bench, host, 0.5, lost, "silent")
        answered(host, 0.25)
    host.close()


@pytest.mark.parametrize("lost", range(4))
@pytest.mark.parametrize("setpoint", [0.5, -0.75])
def test_a_late_answer_is_never_taken_for_a_later_one(
    bench: Bench, lost: int, setpoint: float
) -> None:
    """It comes when the next question has been asked, just before the answer to that."""
    bench.peer("holding", VALUE, 321)
    bench.peer("pause", 20)
    host = bench.host(timeout_s=SHORT_S)
    answered(host, 0.5)
    times_out(bench, host, 0.5, lost, "late")
    for _ in range(6):
        reading = attempt(host, setpoint)
        if reading is not None:
            assert reading == (pytest.approx(setpoint), 1, pytest.approx(32.1))
    answered(host, setpoint)
    host.close()


def times_out(bench: Bench, host: ModbusDevice, setpoint: float, lost: int, how: str) -> None:
    """Let the device not answer the request `lost` of an exchange: one timeout is reported."""
    # exceptions cannot be counted down, so the exchange is led to the request step by step
    with pytest.raises(DeviceError, match=r"no valid answer within 0\.15 s"):
        ask(bench, host, setpoint, lost, how)


def ask(bench: Bench, host: ModbusDevice, setpoint: float, lost: int, how: str) -> None:
    """Exchange; the device spoils the request `lost`."""
    parts, table = host._layout, host._config.read_table
    steps = (
        lambda: host._write(setpoint),
        lambda: host._read(parts.setpoint, "holding"),
        lambda: host._read(parts.status, table),
        lambda: host._read(parts.value, table),
    )
    for place, step in enumerate(steps):
        if place == lost:
            bench.peer(how, 1)
        step()


def attempt(host: ModbusDevice, setpoint: float) -> tuple[float, int, float] | None:
    try:
        reading = host.exchange(setpoint)
    except DeviceError:
        return None
    return reading.setpoint, reading.status, reading.value


def answered(host: ModbusDevice, setpoint: float) -> None:
    """Exchange until it works: a computer that stalls may take longer than the timeout."""
    deadline_s = time.monotonic() + PATIENCE_S
    while (reading := attempt(host, setpoint)) is None:
        assert time.monotonic() < deadline_s
    assert reading[0] == pytest.approx(setpoint)


def test_answers_late_by_one_for_ever_are_never_believed(serial: Bench) -> None:
    """A device slower than the timeout: each answer comes when the next question was asked."""
    serial.peer("holding", VALUE, 321)
    serial.peer("pause", 20)
    host = serial.host(timeout_s=SHORT_S)
    answered(host, 0.5)
    for round_ in range(6):
        serial.peer("late", 1)
        reading = attempt(host, 0.125 * round_)
        assert reading is None or reading == (
            pytest.approx(0.125 * round_), 1, pytest.approx(32.1)
        )  # fmt: skip
    answered(host, -0.5)
    host.close()


def test_a_dead_device_comes_back(bench: Bench) -> None:
    host = bench.host(timeout_s=SHORT_S)
    answered(host, 0.5)
    bench.peer.close()
    for _ in range(3):
        assert attempt(host, 0.5) is None
    bench.restart()
    answered(host, 0.75)
    assert bench.peer.numbers("read", SETPOINT) == [7500]
    host.close()


def test_a_reset_connection_is_made_anew() -> None:
    bench = make("tcp")
    host = bench.host()
    host.exchange(0.5)
    bench.peer("hangup")
    with pytest.raises(DeviceError, match="connection lost"):
        host.exchange(0.5)
    assert host.exchange(0.25).setpoint == pytest.approx(0.25)
    assert bench.peer.numbers("counts")[0] == 2
    host.close()
    bench.close()


@pytest.mark.parametrize("restart", [False, True])
def test_safe_stop_gets_through_a_connection_that_was_reset(restart: bool) -> None:
    bench = make("tcp")
    host = bench.host()
    host.exchange(0.5)
    if restart:
        bench.restart()
        bench.peer("holding", SETPOINT, 77)
    else:
        bench.peer("hangup")
    host.safe_stop()
    assert bench.peer.numbers("read", SETPOINT) == [0]
    host.close()
    bench.close()


def test_noise_before_an_answer_is_passed_over(serial: Bench) -> None:
    assert serial.line is not None
    host = serial.host()
    for noise in (b"\x00", b"\xff\x00\xff", b"\x07", b"\x07\x06", b"\x07\x03\x02\x12"):
        serial.line.before = noise
        assert host.exchange(0.5).setpoint == pytest.approx(0.5), noise
    host.close()


def test_noise_between_two_exchanges_is_passed_over(serial: Bench) -> None:
    assert serial.line is not None
    host = serial.host()
    host.exchange(0.5)
    for noise in (b"\x00", b"\x07\x06\x00\x04\x13\x88\xc5\x2b", bytes(range(256))):
        serial.line.to_host(noise)
        assert host.exchange(0.25).setpoint == pytest.approx(0.25), noise
    host.close()


@pytest.mark.parametrize("cut", [1, 2, 5])
def test_a_cut_off_answer_is_no_answer(serial: Bench, cut: int) -> None:
    assert serial.line is not None
    host = serial.host(timeout_s=SHORT_S)
    answered(host, 0.5)
    serial.line.cut = cut
    with pytest.raises(DeviceError, match="no valid answer"):
        host.exchange(0.25)
    answered(host, 0.25)
    host.close()


@pytest.mark.parametrize(("baud", "pause_s"), [(9600, 3.5 * 11 / 9600), (BAUD, 0.00175)])
def test_a_pause_between_answer_and_next_question(serial: Bench, baud: int, pause_s: float) -> None:
    """Three and a half characters, at least 1.75 ms: without it a device may not see two frames."""
    assert serial.line is not None
    host = serial.host(baud=baud)
    for _ in range(5):
        host.exchange(0.5)
    assert len(serial.line.pauses_s) >= 19
    assert min(serial.line.pauses_s) >= pause_s
    host.close()


def test_two_devices_on_one_line(serial: Bench) -> None:
    """Brake and drive on one cable: two drivers, one serial port."""
    brake, drive = serial.host(), serial.host(setpoint_register=SETPOINT + 1)
    brake.exchange(0.5)
    drive.exchange(0.25)
    brake.exchange(0.75)
    drive.close()
    brake.exchange(1.0)
    assert [serial.peer.numbers("read", SETPOINT + at)[0] for at in range(2)] == [10_000, 2500]
    brake.close()
