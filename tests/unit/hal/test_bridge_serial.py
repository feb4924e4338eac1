import os
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.config.timing import CONNECT_MAX_S
from motord.hal.base import DeviceError
from motord.hal.bridge.serial import SerialBridge
from motord.schema import INT32_MAX, BridgeStatus
from motord.wire.bridge import frames
from tests.contract.benches import new_command, new_feedback, open_streaming
from tests.contract.peers import (
    Board,
    Identity,
    bench,
    give_up_once,
    give_up_once_received,
    until,
)
from tests.support.patience import PATIENCE_S


def read(driver: SerialBridge) -> np.ndarray:
    feedback = new_feedback()
    driver.read(time.time_ns(), feedback)
    return feedback[0]


def enabled_anew(driver: SerialBridge, board: Board) -> bool:
    """Command an open line, then a closed one; return whether it is closed."""
    driver.write(new_command(enable=0))
    read(driver)
    driver.write(new_command(enable=1))
    return board.line_closed


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board()
    yield board
    board.close()


@pytest.fixture
def pair(board: Board) -> Iterator[tuple[SerialBridge, Board]]:
    driver = SerialBridge(bench(port=board.port, rate_Hz=2000, heartbeat_timeout_s=0.03))
    open_streaming(driver, board)
    yield driver, board
    driver.close()


def error_of(**settings: Any) -> str:
    return error_in_opening(SerialBridge(bench(**settings)))


def error_in_opening(driver: SerialBridge) -> str:
    with pytest.raises(DeviceError) as caught:
        driver.open()
    message = str(caught.value)
    assert message.startswith("bridge")
    assert "\n" not in message
    driver.close()
    return message


def test_the_board_is_asked_configured_and_started(pair: tuple[SerialBridge, Board]) -> None:
    _, board = pair
    assert board.configured == frames.Configure(2000, 30_000)
    assert board.streaming


def test_a_first_read_that_comes_late_starts_the_samples_and_asks_nothing(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when an inverter takes seconds to open: longer than a board may be silent."""
    silence_ns = round(PATIENCE_S * 1e9)
    late_ns = 2 * silence_ns
    driver = SerialBridge(bench(port=board.port))
    monkeypatch.setattr(driver, "_silence_ns", silence_ns)
    driver.open()
    until(lambda: not board.streaming)
    opened_ns = time.time_ns()  # a sample of the opening may wait, which the first read takes
    feedback = new_feedback()
    driver.read(opened_ns + late_ns, feedback)
    driver.write(new_command())
    until(lambda: board.heartbeats)  # and whatever was sent before it
    assert board.streaming

    def sampled() -> bool:
        driver.read(time.time_ns() + late_ns, feedback)
        return bool(feedback["t_ns"][0] > opened_ns + late_ns // 2)

    until(sampled)
    assert driver.restarts == 0
    driver.close()


def test_a_bridge_that_is_opened_again_streams_again(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    driver.close()
    until(lambda: not board.streaming)
    open_streaming(driver, board)
    assert read(driver).link_errors == 0


def test_torque_from_counts(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    board.torque_counts = -750  # 1 mV a count, 2 Nm a volt
    until(lambda: read(driver).torque_Nm == pytest.approx(-1.5))


def test_encoder_and_status_as_sent(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    board.encoder_gray = 0xFFF
    board.status = int(BridgeStatus.TORQUE_INVALID)
    sent = (0xFFF, BridgeStatus.TORQUE_INVALID)

    def shown(row: Any) -> tuple[int, int]:
        return row.encoder_gray, row.bridge_status & BridgeStatus.TORQUE_INVALID

    until(lambda: shown(read(driver)) == sent)


def test_the_enable_line_follows_the_command(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    for enable in (1, 0, 1):
        driver.write(new_command(enable=enable))
        until(lambda enable=enable: board.line_closed == enable)
    until(lambda: read(driver).bridge_status & BridgeStatus.ENABLE_LINE)


def test_a_board_that_receives_no_heartbeats_is_said_to(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair

    def lost() -> bool:
        driver.write(new_command(enable=0))
        return bool(read(driver).bridge_status & BridgeStatus.HEARTBEAT_LOST)

    board.deaf = True  # as one that starts, or that takes them for old ones: its status is 0
    until(lost)
    board.deaf = False
    until(lambda: not lost())


def test_closing_opens_the_line_and_stops_the_samples(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    driver.write(new_command(enable=1))
    until(lambda: board.line_closed)
    driver.close()
    until(lambda: not board.line_closed and not board.streaming)


def test_what_the_board_lost_counts_too(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    assert read(driver).link_errors == 0
    board.errors += 3
    board.dropped += 4
    until(lambda: read(driver).link_errors == 7)


def test_counts_that_the_board_makes_up_end_no_loop(
    pair: tuple[SerialBridge, Board],
) -> None:
    """Two of 32 bits, and their sum would be no number of a tick."""
    driver, board = pair
    assert read(driver).link_errors == 0
    board.errors = board.dropped = 0xFFFFFFFF
    until(lambda: read(driver).link_errors == INT32_MAX)


def test_a_host_that_does_not_read_for_a_while_misses_nothing(
    pair: tuple[SerialBridge, Board],
) -> None:
    driver, board = pair
    until(lambda: bool(board._unsent))  # nobody reads: the line is full
    first_ns = read(driver).t_ns
    until(lambda: read(driver).t_ns > first_ns + 100_000_000)
    assert read(driver).link_errors == 0


def test_noise_is_passed_over(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    assert read(driver).link_errors == 0
    board.raw = b"\0noise\0more noise\0"
    until(lambda: read(driver).link_errors == 2)
    board.encoder_gray = 1
    until(lambda: read(driver).encoder_gray == 1)


def test_a_board_that_starts_anew_is_set_up_again(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    before = read(driver).link_errors
    board.configured = None
    board.reboot = True
    until(lambda: read(driver) is not None and driver.restarts)  # more if it was asked meanwhile
    until(lambda: board.streaming and board.configured == frames.Configure(2000, 30_000))
    board.line_closed = False
    until(lambda: enabled_anew(driver, board) and abs(time.time_ns() - read(driver).t_ns) < 100e6)
    assert read(driver).link_errors == before


def test_a_board_that_fell_silent_is_asked_and_set_up_again(
    pair: tuple[SerialBridge, Board], monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, board = pair
    monkeypatch.setattr("motord.hal.bridge.board.SILENCE_NS", 20_000_000)
    board.configured = None
    board.streaming = False  # as after a reset whose Hello was lost
    until(lambda: read(driver) is not None and driver.restarts >= 1)
    until(lambda: board.streaming and board.configured == frames.Configure(2000, 30_000))
    until(lambda: abs(time.time_ns() - read(driver).t_ns) < 15e6)


def test_a_board_that_missed_its_configuration_is_asked_for_no_closed_line(
    pair: tuple[SerialBridge, Board], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes Start, at its own rate, and its own heartbeat timeout would be in force."""
    driver, board = pair
    monkeypatch.setattr(driver, "_silence_ns", 20_000_000)
    board.configured = None
    board.lose_configure, board.reboot = 1, True
    until(lambda: read(driver) is not None and driver.restarts)  # more if it was asked meanwhile
    board.line_closed = False
    closed_by = []

    def configured() -> bool:
        if enabled_anew(driver, board):
            closed_by.append(board.configured)
        return bool(closed_by)

    until(configured)
    assert closed_by == [frames.Configure(2000, 30_000)]


def test_a_board_that_streamed_before_is_configured_all_the_same(board: Board) -> None:
    """As after a daemon that was killed: its Status is of the old configuration, not an answer."""
    board.streaming = True
    board.lose_configure = 1
    driver = SerialBridge(bench(port=board.port, rate_Hz=1000, heartbeat_timeout_s=0.03))
    driver.open()
    assert board.configured == frames.Configure(1000, 30_000)
    driver.close()


def test_a_status_on_its_way_is_no_refusal(board: Board) -> None:
    board.streaming = True
    board.lose_configure = 1
    driver = SerialBridge(bench(port=board.port, rate_Hz=2000))
    driver.open()
    assert board.configured == frames.Configure(2000, 50_000)
    driver.close()


def test_another_board_in_its_place_is_not_taken(pair: tuple[SerialBridge, Board]) -> None:
    driver, board = pair
    board.identity = Identity(counts=1000)
    board.reboot = True
    t_ns = read(driver).t_ns
    until(lambda: not board.streaming and not board.reboot)
    for _ in range(100):
        board.heartbeats = 0
        driver.write(new_command(enable=0))
        until(lambda: board.heartbeats)
        t_ns = read(driver).t_ns
    assert (driver.restarts, board.streaming) == (0, False)
    assert read(driver).t_ns == t_ns


@pytest.mark.parametrize("serial", [7, 8], ids=["same", "another"])
def test_a_board_behind_a_port_that_was_away_says_who_it_is_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, serial: int
) -> None:
    """As when two adapters change places: another bench's board, which streams as this one's."""
    monkeypatch.setattr("motord.hal.bridge.serial_port.LOOK_AGAIN_S", 0.0)
    path = tmp_path / "port"
    before, after = Board(), Board(Identity(serial=serial))
    path.symlink_to(before.port)
    driver = SerialBridge(bench(port=str(path)))
    open_streaming(driver, before)
    monkeypatch.setattr(driver, "_silence_ns", 20_000_000)
    after.line_closed, after.encoder_gray, after.streaming = False, 0x123, True
    path.unlink()
    path.symlink_to(after.port)
    before.close()

    def enabled() -> bool:
        taken = read(driver).encoder_gray == 0x123
        closed = enabled_anew(driver, after)
        assert driver.restarts or not (taken or closed)
        return taken and closed

    def tried() -> bool:
        return enabled() or after.hellos > 2

    until(tried if serial == 8 else enabled)
    until(lambda: after.line_closed == (serial == 7))  # with the last command of those under way
    assert driver.restarts >= 1 if serial == 7 else driver.restarts == 0
    driver.close()
    after.close()


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    message = error_of(port=str(tmp_path / "nothing"))
    assert "there is no such port" in message
    assert str(tmp_path / "nothing") in message


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for port in (tmp_path / "file", tmp_path):
        assert f"open {port}: it is no serial port; is port right?" in error_of(port=str(port))


def test_a_port_in_use(pair: tuple[SerialBridge, Board]) -> None:
    _, board = pair
    assert "in use by another program" in error_of(port=board.port)


def test_a_port_without_permission(monkeypatch: pytest.MonkeyPatch, board: Board) -> None:
    def refuse(*_: Any, **__: Any) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", refuse)
    assert "dialout" in error_of(port=board.port)


def test_a_board_that_says_nothing() -> None:
    device_fd, host_fd = os.openpty()
    try:
        tty.setraw(host_fd)
        message = error_of(port=os.ttyname(host_fd), connect_timeout_s=0.15)
        assert "no Hello within 0.15 s, nothing at all; is the board powered" in message
    finally:
        os.close(device_fd)
        os.close(host_fd)


def test_something_else_on_the_port(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    board._obey = lambda *_: setattr(board, "raw", b"login: ")
    driver = SerialBridge(bench(port=board.port, connect_timeout_s=CONNECT_MAX_S))
    give_up_once_received(driver, monkeypatch)
    assert "bytes of something else" in error_in_opening(driver)


@pytest.mark.parametrize(
    ("identity", "expected"),
    [
        (Identity(protocol=1), ["fake (firmware 1.2.3) speaks protocol 1, motord speaks 2"]),
        (Identity(layout=0xABCD), ["0000abcd", f"{frames.LAYOUT_HASH:08x}"]),
        (Identity(counts=1024), ["encoder of 1024 counts", "[motor] counts = 4096"]),
        pytest.param(
            Identity(rates_Hz=[500]),
            ["cannot sample at 1000 Hz", "set rate_Hz in [bridge]"],
            marks=pytest.mark.slow,  # it may follow the next Configure: all are waited for
        ),
    ],
)
def test_a_board_that_does_not_fit(board: Board, identity: Identity, expected: list[str]) -> None:
    board.identity = identity
    message = error_of(port=board.port)
    for part in expected:
        assert part in message


def test_a_board_that_does_not_know_its_encoder(board: Board) -> None:
    board.identity = Identity(counts=0)
    driver = SerialBridge(bench(port=board.port))
    driver.open()
    assert board.configured is not None
    driver.close()


def test_samples_that_never_come(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    board.silent = True
    give_up_once(lambda: board.starts > 0, monkeypatch)
    message = error_of(port=board.port, connect_timeout_s=CONNECT_MAX_S)
    assert f"no Sample within {CONNECT_MAX_S:g} s" in message


def test_a_plug_that_is_pulled() -> None:
    """Reads and writes go on without an exception, as errors; the time stands still."""
    board = Board()
    driver = SerialBridge(bench(port=board.port))
    driver.open()
    before = read(driver)
    board.close()
    until(lambda: driver.write(new_command()) or read(driver).link_errors > before.link_errors)
    last = read(driver)
    assert read(driver).t_ns == last.t_ns
    driver.safe_stop()
    driver.close()
