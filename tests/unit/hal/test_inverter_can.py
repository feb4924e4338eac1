import time
from collections.abc import Iterator
from functools import cache
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest

from motord.config import CanConfig, ConfigError, packaged
from motord.hal import countdown
from motord.hal.base import DeviceError
from motord.hal.can.base import REFUSED_MAX
from motord.hal.can.python_can import PythonCan
from motord.hal.inverter.can_drive import CanInverter
from motord.hal.inverter.feedback import CanFeedback
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import InverterCodec
from tests.contract.benches import new_command, new_feedback
from tests.contract.peers import SIGNALS, Drive, bench, can_config, encode_feedback, until

NOW_NS = 1_800_000_000_000_000_000
SILENT_AFTER_NS = 500_000_000
ROUNDING_NS = 1000
"""Of a time stamp that is a float of Unix seconds."""
BUS_OFF = InverterStatus.BUS_OFF


def read(driver: CanInverter, now_ns: int = NOW_NS) -> np.ndarray:
    feedback = new_feedback()
    driver.read(now_ns, feedback)
    return feedback[0]


def error_of(driver: CanInverter) -> str:
    with pytest.raises(DeviceError) as caught:
        driver.open()
    message = str(caught.value)
    assert message.startswith("inverter on ")
    assert "\n" not in message
    return message


class SilentBus:
    """A python-can bus on which nothing comes; sends and receives fail while `broken`."""

    def __init__(self) -> None:
        self.broken = False
        self.pending: list[can.Message] = []

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise can.CanOperationError("no buffer space")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.broken:
            raise can.CanOperationError("network is down")
        return self.pending.pop(0) if self.pending else None

    def fileno(self) -> int:
        return -1

    def shutdown(self) -> None:
        pass


def wrapped(bus: SilentBus) -> PythonCan:
    return PythonCan(bus, fd=True, system_stamped=True)


@pytest.fixture
def pair() -> Iterator[tuple[CanInverter, SilentBus]]:
    driver, bus = CanInverter(bench()), SilentBus()
    opened = wrapped(bus)
    driver._bus, driver._state = opened, opened.state
    yield driver, bus
    driver.close()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"interface": "socketcan", "channel": "nocan7"},
            ["cannot open the bus", "ip link set nocan7"],
        ),
        ({"interface": "quantum", "channel": "0"}, ["quantum", "interface, channel and options"]),
        ({"channel": "not an address"}, ["a multicast group needs a route"]),
    ],
)
def test_a_bus_that_cannot_be_opened(changes: dict[str, Any], expected: list[str]) -> None:
    message = error_of(CanInverter(bench(can_config(**changes))))
    for part in expected:
        assert part in message


def test_bit_rates_reach_the_interface() -> None:
    config = can_config("virtual", bitrate=500_000, data_bitrate=2_000_000, connect_timeout_s=0.01)
    assert "nothing at all" in error_of(CanInverter(bench(config)))


def test_a_drive_that_says_nothing() -> None:
    message = error_of(CanInverter(bench(can_config(connect_timeout_s=0.05))))
    assert "no PhaseFeedback (0x180) and InverterStatus (0x181)" in message
    assert "nothing at all; is the drive on" in message


def _with_stranger(identifier: int, data: bytes, patch: pytest.MonkeyPatch) -> str:
    """Return the error of a driver that has received only this frame."""
    bus = SilentBus()
    bus.pending = [
        can.Message(arbitration_id=identifier, data=data, is_fd=True, is_extended_id=False)
    ]
    patch.setattr("motord.hal.inverter.can_drive.open_bus", lambda *_: wrapped(bus))
    return error_of(CanInverter(bench(can_config("virtual", connect_timeout_s=0.01))))


def test_feedback_that_came_while_nobody_looked_came(
    pair: tuple[CanInverter, SilentBus], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, bus = pair
    codec = dbc.load(can_config())
    values = dict.fromkeys((slot for m in codec.feedback for slot in m.slots), 0.0)
    bus.pending = [
        can.Message(arbitration_id=m.identifier, data=data, is_extended_id=False, is_fd=True)
        for m, data in encode_feedback(codec, values, 0)
    ]
    times_s = count(0.0, 100.0)  # kept from running from before each look to long after
    clock = SimpleNamespace(monotonic=lambda: next(times_s))
    monkeypatch.setattr(countdown, "time", clock)
    assert driver._bus is not None
    driver._await_feedback(driver._bus)
    with pytest.raises(DeviceError, match="no PhaseFeedback"):
        CanInverter(bench())._await_feedback(driver._bus)


def test_another_device_on_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    message = _with_stranger(0x123, b"hello", monkeypatch)
    assert "only 0x123" in message
    assert "this drive's DBC?" in message


def test_a_drive_with_another_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    message = _with_stranger(0x180, bytes(16), monkeypatch)
    assert "PhaseFeedback came with a wrong length or CRC" in message


def test_a_bus_that_fails_while_opening(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = SilentBus()
    broken.broken = True
    monkeypatch.setattr("motord.hal.inverter.can_drive.open_bus", lambda *_: wrapped(broken))
    assert "the bus failed: network is down" in error_of(CanInverter(bench()))


def test_a_wrong_dbc_is_found_before_anything_is_opened() -> None:
    signals = SIGNALS | {"command_enable": "CurrentCommand.Enabled"}
    with pytest.raises(ConfigError, match="did you mean Enable"):
        CanInverter(bench(can_config(signals=signals)))


def test_refused_sends_become_bus_off_and_recover(pair: tuple[CanInverter, SilentBus]) -> None:
    driver, bus = pair
    read(driver)
    bus.broken = True
    for _ in range(REFUSED_MAX):
        assert not read(driver).inverter_status & BUS_OFF
        driver.write(new_command())
    feedback = read(driver)
    assert feedback.inverter_status & BUS_OFF
    assert feedback.link_errors == 2 * REFUSED_MAX + 1
    bus.broken = False
    driver.write(new_command())
    assert not read(driver).inverter_status & BUS_OFF


def test_error_frames_report_bus_off(pair: tuple[CanInverter, SilentBus]) -> None:
    driver, bus = pair
    before = read(driver).link_errors
    bus.pending = [can.Message(is_error_frame=True, arbitration_id=0x40)]
    assert read(driver).inverter_status & BUS_OFF
    bus.pending = [can.Message(is_error_frame=True, arbitration_id=0x100)]
    assert not read(driver).inverter_status & BUS_OFF
    assert read(driver).link_errors == before + 2


def test_times_of_another_clock_are_not_used(pair: tuple[CanInverter, SilentBus]) -> None:
    """An interface that stamps with a clock of its own: the time of reading counts instead."""
    driver, bus = pair
    codec = dbc.load(can_config())
    values = dict.fromkeys((slot for m in codec.feedback for slot in m.slots), 0.0)
    bus.pending = [
        can.Message(
            arbitration_id=m.identifier, is_extended_id=False, is_fd=True, data=data, timestamp=12.5
        )
        for m, data in encode_feedback(codec, values, 0)
    ]
    assert read(driver, NOW_NS).t_inverter_ns == NOW_NS


def test_feedback_age_is_taken_off() -> None:
    config = can_config()
    drive = Drive(config)
    setup = bench(config)
    older = setup.inverter.model_copy(update={"feedback_age_s": 100.0})
    driver = CanInverter(setup.model_copy(update={"inverter": older}))
    begun_ns = time.time_ns()
    driver.open()
    try:
        t_ns = int(read(driver, time.time_ns()).t_inverter_ns) + 100_000_000_000
        assert begun_ns <= t_ns <= time.time_ns() + ROUNDING_NS
    finally:
        driver.close()
        drive.close()


@cache
def packaged_codec() -> InverterCodec:
    """Return the codec of the drive that `can_config` describes, compiled once."""
    return dbc.load(can_config())


def feedback_of(values: dict[str, float], counter: int, only: int) -> tuple[int, bytes]:
    message, data = encode_feedback(packaged_codec(), values, counter)[only]
    return message.key, data


VALUES = dict.fromkeys(
    ("i_a_A", "i_b_A", "i_c_A", "u_a_V", "u_b_V", "u_c_V", "u_bus_V", "temperature_C", "status"),
    0.0,
)


def test_a_slow_message_that_stays_away_makes_all_stale() -> None:
    state = CanFeedback(packaged_codec(), 0, SILENT_AFTER_NS)
    assert len(state.missing()) == 2
    state.take(*feedback_of(VALUES, 0, only=1), NOW_NS)
    record = new_feedback()
    for tick in range(3):
        t_ns = NOW_NS + tick * (SILENT_AFTER_NS // 2)
        state.take(*feedback_of(VALUES, tick, only=0), t_ns)
        state.fill(record)
        assert record["t_inverter_ns"][0] == (t_ns if tick < 2 else NOW_NS)
    assert state.missing() == []


def test_how_long_a_slow_message_may_stay_away_is_a_setting() -> None:
    config = can_config("virtual", slow_stale_after_s=0.05)
    driver = CanInverter(bench(config))
    record = new_feedback()
    for t_ms in range(52):
        driver._feedback.take(*feedback_of(VALUES, t_ms, only=0), NOW_NS + t_ms * 1_000_000)
        if t_ms == 0:
            driver._feedback.take(*feedback_of(VALUES, 0, only=1), NOW_NS)
        driver._feedback.fill(record)
        assert (record["t_inverter_ns"][0] == NOW_NS) == (t_ms == 0 or t_ms >= 50)


@pytest.mark.parametrize("stale_after_s", [0.02, 0.05, 0.3, 1.0])
@pytest.mark.parametrize("read_ns", [1, 0, -100_000])
def test_a_slow_message_is_missed_in_its_time_whatever_that_of_the_others(
    stale_after_s: float, read_ns: int
) -> None:
    """Also where currents come with every tick, or after it began: no tick sees older ones."""
    config = bench(can_config("virtual", slow_stale_after_s=0.05))
    inverter = config.inverter.model_copy(update={"stale_after_s": stale_after_s})
    driver = CanInverter(config.model_copy(update={"inverter": inverter}))
    driver._feedback.take(*feedback_of(VALUES, 0, only=1), NOW_NS)
    record = new_feedback()
    for t_ms in range(52):
        now_ns = NOW_NS + t_ms * 1_000_000
        driver._feedback.take(*feedback_of(VALUES, t_ms, only=0), now_ns)
        driver._feedback.fill(record)
        age_s = (now_ns + read_ns - record["t_inverter_ns"][0]) * 1e-9
        assert (age_s > stale_after_s) == (t_ms >= 50)


@pytest.mark.parametrize("silent_ms", [300, 495, 600, 900])
@pytest.mark.parametrize("again_every_ms", [1, 260])
def test_after_a_silence_of_all_messages_the_slow_ones_have_their_time_once_more(
    silent_ms: int, again_every_ms: int
) -> None:
    """A bus that was away, or a computer that stalled; but only once, until one has come."""
    state = CanFeedback(packaged_codec(), 0, SILENT_AFTER_NS, 1_000_000_000)
    record = new_feedback()
    for t_ms in range(20):
        state.take(*feedback_of(VALUES, t_ms, only=0), NOW_NS + t_ms * 1_000_000)
        if t_ms == 0:
            state.take(*feedback_of(VALUES, 0, only=1), NOW_NS)
    again_ms = 19 + silent_ms
    stale_from_ms = again_ms + SILENT_AFTER_NS // 1_000_000
    for number, t_ms in enumerate(range(again_ms, stale_from_ms + 600, again_every_ms), start=20):
        state.take(*feedback_of(VALUES, number, only=0), NOW_NS + t_ms * 1_000_000)
        state.fill(record)
        stale = record["t_inverter_ns"][0] != NOW_NS + t_ms * 1_000_000
        assert stale == (t_ms >= stale_from_ms)


def test_a_status_has_the_time_at_which_it_was_stated() -> None:
    state, record = CanFeedback(packaged_codec(), 1000, SILENT_AFTER_NS), new_feedback()
    state.take(*feedback_of(VALUES, 0, only=1), NOW_NS)
    state.take(*feedback_of(VALUES, 0, only=0), NOW_NS + 70)
    state.fill(record)
    assert record["t_inverter_ns"][0] == NOW_NS + 70 - 1000
    assert record["t_status_ns"][0] == NOW_NS - 1000


@pytest.mark.parametrize("repeated", [[11], [10, 11], [7, 8, 9, 10, 11]])
def test_old_frames_that_are_repeated_are_no_feedback(repeated: list[int]) -> None:
    """Nor do they keep it fresh: a drive that fell silent is stale in its time."""
    state, record = CanFeedback(packaged_codec(), 0, SILENT_AFTER_NS), new_feedback()
    for number in range(12):
        for only in (0, 1):
            state.take(*feedback_of(VALUES | {"i_a_A": number}, number, only), NOW_NS + number)
    for later in range(100):
        number = repeated[later % len(repeated)]
        frame = feedback_of(VALUES | {"i_a_A": number}, number, only=0)
        state.take(*frame, NOW_NS + 20 + later)
    state.fill(record)
    assert record["t_inverter_ns"][0] == NOW_NS + 11
    assert record["i_A"][0, 0] == pytest.approx(11.0)
    assert state.errors == 100


def test_values_that_the_map_lacks_are_not_numbers() -> None:
    signals = SIGNALS | {"feedback_u_V": (), "feedback_temperature_C": ""}
    state = CanFeedback(dbc.load(can_config(signals=signals)), 0, SILENT_AFTER_NS)
    record = new_feedback()
    state.fill(record)
    assert np.isnan(record["u_V"]).all()
    assert np.isnan(record["temperature_C"]).all()


@pytest.mark.parametrize("half", [0x7E00, 0x7C00, 0xFC00], ids=["nan", "inf", "-inf"])
def test_a_value_that_the_drive_sends_as_no_number_is_beyond_every_limit(
    tmp_path: Path, half: int
) -> None:
    """NaN is what the map lacks, and no temperature that the map has may count as that."""
    path = tmp_path / "drive.dbc"
    text = packaged("inverter.dbc").read_text().replace("(0.1,0) [-60|300]", "(1,0) [0|0]")
    path.write_text(text + "\nSIG_VALTYPE_ 385 Temperature : 1;\n")
    signals = SIGNALS | {"feedback_crc": (), "feedback_counter": ()}
    codec = dbc.load(CanConfig(dbc=path, signals=signals))
    state, record = CanFeedback(codec, 0, SILENT_AFTER_NS), new_feedback()
    status = next(message for message in codec.feedback if "temperature_C" in message.slots)
    state.take(status.key, b"\0\0" + half.to_bytes(2, "little") + bytes(4), NOW_NS)
    state.fill(record)
    assert record["temperature_C"][0] == np.inf


def test_a_value_too_large_for_a_tick_is_beyond_every_limit(tmp_path: Path) -> None:
    """Without a warning of numpy, which would be written by the loop."""
    path = tmp_path / "drive.dbc"
    path.write_text(
        packaged("inverter.dbc").read_text().replace("(0.1,0) [-60|300]", "(1e38,0) [0|0]")
    )
    signals = SIGNALS | {"feedback_crc": (), "feedback_counter": ()}
    codec = dbc.load(CanConfig(dbc=path, signals=signals))
    state, record = CanFeedback(codec, 0, SILENT_AFTER_NS), new_feedback()
    status = next(message for message in codec.feedback if "temperature_C" in message.slots)
    for raw, value in ((3, 3e38), (4, np.inf)):
        state.take(status.key, b"\0\0" + raw.to_bytes(2, "little") + bytes(4), NOW_NS)
        state.fill(record)
        assert record["temperature_C"][0] == np.float32(value)


def test_classical_can() -> None:
    """With messages of at most 8 bytes (here the command's own) no CAN FD is needed."""
    signals = SIGNALS | {
        "feedback_i_A": ("CurrentCommand.CurrentA",) * 3,
        "feedback_u_V": (),
        "feedback_counter": (),
        "feedback_crc": (),
    }
    config = can_config("virtual", fd=False, signals=signals, connect_timeout_s=0.02)
    assert config.dbc == packaged("inverter.dbc")
    assert "no CurrentCommand" in error_of(CanInverter(bench(config)))


def test_a_flood_is_taken_in_bounded_bites() -> None:
    config = can_config("virtual")
    drive = Drive(config)
    driver = CanInverter(bench(config))
    driver.open()
    try:
        drive.silent = True
        for _ in range(1000):
            drive.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))
        drive.silent = False
        first = read(driver).t_inverter_ns
        until(lambda: read(driver).t_inverter_ns > first)
    finally:
        driver.close()
        drive.close()
