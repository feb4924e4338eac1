import time
from collections.abc import Iterator
from typing import Any

import can
import pytest

from motord.config import Config
from motord.config.devices import HEARTBEAT_BYTES, SAMPLE_BYTES, classic_bits
from motord.config.timing import CONNECT_MAX_S
from motord.hal.base import DeviceError
from motord.hal.bridge.can import CanBridge
from motord.hal.registry import make_rig
from motord.wire.bridge import frames
from tests.contract.benches import new_command, new_feedback, open_streaming
from tests.contract.peers import (
    CanBoard,
    Drive,
    Identity,
    bench,
    bridge_can_config,
    can_config,
    give_up_once_received,
    never_ask,
    until,
)


def setup(can_: Any, **bridge: Any) -> Config:
    return bench(driver="can", bridge_can=can_, **bridge)


def read(driver: Any) -> Any:
    feedback = new_feedback()
    driver.read(time.time_ns(), feedback)
    return feedback[0]


@pytest.fixture(params=[False, True], ids=["classic", "fd"])
def pair(request: pytest.FixtureRequest) -> Iterator[tuple[CanBridge, CanBoard]]:
    config = bridge_can_config("virtual", fd=request.param)
    board = CanBoard(config)
    driver = CanBridge(setup(config, rate_Hz=1500, heartbeat_timeout_s=0.03))
    open_streaming(driver, board)
    yield driver, board
    driver.close()
    board.close()


def test_the_board_is_asked_configured_and_started(pair: tuple[CanBridge, CanBoard]) -> None:
    _, board = pair
    assert board.configured == frames.Configure(1500, 30_000)
    assert board.streaming


def test_a_board_that_starts_anew_is_set_up_again(pair: tuple[CanBridge, CanBoard]) -> None:
    driver, board = pair
    before = read(driver).link_errors
    board.configured = None
    board.reboot = True
    until(lambda: read(driver) is not None and driver.restarts)  # more if it was asked meanwhile
    until(lambda: board.streaming and board.configured is not None)
    board.line_closed = False

    def enabled_anew() -> bool:
        driver.write(new_command(enable=0))
        recent = abs(time.time_ns() - read(driver).t_ns) < 100e6
        driver.write(new_command(enable=1))
        return board.line_closed and recent

    until(enabled_anew)
    assert read(driver).link_errors == before


def test_other_frames_with_the_boards_identifier_are_counted(
    pair: tuple[CanBridge, CanBoard],
) -> None:
    driver, board = pair
    assert read(driver).link_errors == 0
    board.put(board._config.board_id, b"\xc0\x99")
    board.put(board._config.board_id, b"")
    until(lambda: read(driver).link_errors >= 2)
    board.encoder_gray = 1
    until(lambda: read(driver).encoder_gray == 1)


def error_of(config: Any, **bridge: Any) -> str:
    return error_in_opening(CanBridge(setup(config, **bridge)))


def error_in_opening(driver: CanBridge) -> str:
    with pytest.raises(DeviceError) as caught:
        driver.open()
    driver.close()
    message = str(caught.value)
    assert message.startswith("bridge on virtual test-")
    assert "\n" not in message
    return message


def test_a_board_that_says_nothing() -> None:
    message = error_of(bridge_can_config("virtual"), connect_timeout_s=0.15)
    assert "no Hello within 0.15 s, nothing at all; is the board powered" in message


def test_something_else_with_the_boards_identifier(monkeypatch: pytest.MonkeyPatch) -> None:
    config = bridge_can_config("virtual")
    board = CanBoard(config)
    board._obey = lambda *_: board.put(config.board_id, b"\xc0noise")
    driver = CanBridge(setup(config, connect_timeout_s=CONNECT_MAX_S))
    give_up_once_received(driver, monkeypatch)
    message = error_in_opening(driver)
    assert "CAN frames of something else; are the identifiers in [bridge.can]" in message
    board.close()


def test_a_board_with_other_layouts() -> None:
    config = bridge_can_config("virtual")
    board = CanBoard(config, Identity(layout=0xABCD))
    assert "0000abcd" in error_of(config)
    board.close()


def test_a_bus_that_is_not_there() -> None:
    config = bridge_can_config("virtual").model_copy(update={"interface": "nosuch"})
    with pytest.raises(DeviceError, match=r"bridge on nosuch test-.*: cannot open the bus"):
        CanBridge(setup(config)).open()


def test_without_a_table() -> None:
    with pytest.raises(ValueError, match=r'driver = "can" needs a table \[bridge\.can\]'):
        bench(driver="can")


def test_inverter_and_bridge_share_a_channel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each receives its own frames; neither counts the other's as errors.

    Drive and board speak once for each command: at a pace of their own, a reader that is kept
    waiting for 0.1 s finds that the kernel had no room for all, which rightly counts.
    """
    inverter = can_config("udp_multicast")
    shared = bridge_can_config().model_copy(
        update={"channel": inverter.channel, "options": inverter.options, "fd": True}
    )
    drive, board = Drive(inverter), CanBoard(shared)
    board.put = _only_own(board)
    rig = make_rig(bench(inverter, driver="can", bridge_can=shared))
    never_ask(rig, monkeypatch)
    rig.open()
    drive.stop()
    board.stop()
    board.encoder_gray = 0

    def came() -> bool:
        """What was sent while nobody read may have left no room for the first of it."""
        drive.receive()
        board.receive()
        _speak(drive, board)
        return bool(read(rig).encoder_gray == 0)

    until(came)
    errors = read(rig).link_errors
    for number in range(1, 51):
        commands, heartbeats = drive.commands, board.heartbeats
        rig.write(new_command((1.0, 0.0, -1.0), 1))
        until(lambda n=commands: drive.receive() or drive.commands > n)
        until(lambda n=heartbeats: board.receive() or board.heartbeats > n)
        board.encoder_gray, drive.values["u_bus_V"] = number, 20.0 + number / 10
        _speak(drive, board)
        until(lambda n=number: read(rig).encoder_gray == n)
        until(lambda: abs(read(rig).u_bus_V - drive.values["u_bus_V"]) < 0.05)
    assert drive.enable
    assert board.line_closed
    assert read(rig).link_errors == errors
    rig.close()
    drive.release()
    board.release()


def _speak(drive: Drive, board: CanBoard) -> None:
    drive.speak()
    board.speak()


def _only_own(board: CanBoard) -> Any:
    """Leave out the frames that the board puts under the inverter's identifier."""
    put = board.put
    return lambda identifier, data: identifier == 0x180 or put(identifier, data)


def test_identifiers_must_differ() -> None:
    with pytest.raises(ValueError, match="host_id and board_id must differ"):
        bridge_can_config("virtual", host_id=5, board_id=5)


def test_sizes_that_the_load_is_computed_from() -> None:
    assert len(frames.pack(frames.Sample(0, 0, 0, 0), 0)) == SAMPLE_BYTES
    assert len(frames.pack(frames.Heartbeat(0), 0)) == HEARTBEAT_BYTES


def test_bits_of_a_frame_as_published() -> None:
    """The longest classical frames: 135 bits with 8 bytes of data, 55 with none."""
    assert classic_bits(8) == 135
    assert classic_bits(0) == 55


@pytest.mark.parametrize(
    ("rate_Hz", "changes", "fits"),
    [
        (1000, {}, True),
        (1700, {}, True),
        (1800, {}, False),
        (1000, {"bitrate": 500_000}, False),
        (5000, {"fd": True, "bitrate": 1_000_000, "data_bitrate": 5_000_000}, True),
        (8000, {"fd": True, "bitrate": 1_000_000, "data_bitrate": 5_000_000}, False),
    ],
)
def test_a_rate_that_the_bus_cannot_carry_is_refused(
    rate_Hz: int, changes: dict[str, Any], fits: bool
) -> None:
    tables = setup(bridge_can_config("virtual", **changes), rate_Hz=100).model_dump()
    tables["loop"]["rate_Hz"] = rate_Hz
    tables["bridge"]["rate_Hz"] = None
    if fits:
        Config.model_validate(tables)
        return
    with pytest.raises(ValueError, match=r"\[bridge\.can\] samples at .* of the bus; lower"):
        Config.model_validate(tables)


def test_can_message_of_another_kind_is_passed_over(pair: tuple[CanBridge, CanBoard]) -> None:
    driver, board = pair
    assert read(driver).link_errors == 0
    extended = can.Message(arbitration_id=board._config.board_id, is_extended_id=True, data=b"\xc0")
    board._bus.send(extended)
    board.encoder_gray = 3
    until(lambda: read(driver).encoder_gray == 3)
    assert read(driver).link_errors == 0
