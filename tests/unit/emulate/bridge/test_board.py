import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config import load
from motord.emulate.board import (
    CLOCK_DRIFT,
    CLOCK_OFFSET_US,
    RESET_RATE_HZ,
    RESET_TIMEOUT_US,
    STATUS_PERIOD_NS,
    Board,
)
from motord.emulate.devices import NEVER_NS
from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from tests.unit.emulate.benches import EMULATED, beat

MS = 1_000_000
CONFIG = load(EMULATED)
TIMEOUT_MS = RESET_TIMEOUT_US // 1000


def board() -> Board:
    return Board(CONFIG, reset_ns=0)


def close_line(target: Board, now_ns: int = 0) -> None:
    """Ask for an open and then for a closed line, as a host does that starts."""
    target.receive(now_ns, beat(0))
    target.receive(now_ns, beat(1))


def ask(target: Board, frame: frames.Frame, now_ns: int = 0) -> list[frames.Frame]:
    return target.receive(now_ns, beat(0)._replace(frame=frame))


def test_it_says_who_it_is():
    (hello,) = ask(board(), frames.HelloRequest(frames.PROTOCOL))
    assert hello.protocol == frames.PROTOCOL
    assert hello.layout == frames.LAYOUT_HASH
    assert hello.counts == CONFIG.motor.counts
    assert hello.rate_Hz == RESET_RATE_HZ
    assert hello.board_name == "motord-emulate"


def test_start_and_stop_are_answered_with_what_it_does_now():
    ours = board()
    assert ask(ours, frames.Start())[0].streaming == 1
    close_line(ours)
    assert ours.line_closed
    (status,) = ask(ours, frames.Stop())
    assert (status.streaming, ours.line_closed, ours.deadline_ns) == (0, False, NEVER_NS)


def test_configure_sets_rate_and_timeout():
    ours = board()
    (status,) = ask(ours, frames.Configure(500, 20_000))
    assert status.rate_Hz == ours.rate_Hz == 500
    close_line(ours)
    ours.expire(20 * MS - 1)
    assert ours.line_closed
    ours.expire(20 * MS)
    assert not ours.line_closed


@pytest.mark.parametrize(
    ("rate_Hz", "timeout_us", "taken"),
    [
        (99, 20_000, False), (100, 20_000, True), (20_000, 20_000, True),
        (20_001, 20_000, False), (500, 999, False), (500, 1000, True),
        (500, 1_000_000, True), (500, 1_000_001, False), (0, 0, False),
    ],
)  # fmt: skip
def test_configure_takes_all_or_nothing(rate_Hz, timeout_us, taken):
    ours = board()
    ask(ours, frames.Configure(250, 30_000))
    (status,) = ask(ours, frames.Configure(rate_Hz, timeout_us))
    close_line(ours)
    assert (status.rate_Hz, ours.deadline_ns) == (
        (rate_Hz, timeout_us * 1000) if taken else (250, 30 * MS)
    )


@pytest.mark.parametrize(("silent_ms", "lost"), [(49, False), (50, True)])
def test_configure_opens_the_line_and_prolongs_nothing(silent_ms, lost):
    ours = board()
    ask(ours, frames.Configure(500, 50_000))
    ours.sample(0, 0, 0, False)
    close_line(ours)
    (status,) = ask(ours, frames.Configure(500, 500_000), silent_ms * MS)
    assert (ours.line_closed, ours.deadline_ns) == (False, NEVER_NS)
    assert status.status == (BridgeStatus.HEARTBEAT_LOST if lost else 0)
    ours.receive(51 * MS, beat(1))
    assert not ours.line_closed
    close_line(ours, 52 * MS)
    assert ours.deadline_ns == 552 * MS


def test_frames_of_a_board_are_not_for_it():
    ours = board()
    assert ask(ours, ours.hello()) == []


def test_the_line_opens_when_heartbeats_stop_and_stays_open_until_asked_open():
    ours = board()
    close_line(ours)
    ours.expire(TIMEOUT_MS * MS - 1)
    assert ours.line_closed
    ours.expire(TIMEOUT_MS * MS)
    assert (ours.line_closed, ours.heartbeat_drops) == (False, 1)
    assert ours.sample(0, 0, 0, False).status == BridgeStatus.HEARTBEAT_LOST
    ours.receive(200 * MS, beat(1))
    assert not ours.line_closed
    ours.receive(201 * MS, beat(0))
    ours.receive(202 * MS, beat(1))
    assert ours.sample(0, 0, 0, False).status == BridgeStatus.ENABLE_LINE


def test_the_line_stays_open_until_a_first_heartbeat_asks_for_that():
    ours = board()
    for ms in range(3 * TIMEOUT_MS):
        ours.expire(ms * MS)
        ours.receive(ms * MS, beat(1))
        assert (ours.line_closed, ours.deadline_ns) == (False, NEVER_NS)
        assert ours.sample(0, 0, 0, False).status == 0
    close_line(ours)
    assert ours.line_closed


@pytest.mark.parametrize("silent", [False, True])
def test_after_stop_the_line_stays_open_until_asked_open(silent):
    ours = board()
    close_line(ours)
    if silent:
        ours.expire(TIMEOUT_MS * MS)
    ask(ours, frames.Stop())
    ours.receive(0, beat(1))
    assert not ours.line_closed
    lost = BridgeStatus.HEARTBEAT_LOST if silent else 0
    assert ours.sample(0, 0, 0, False).status == lost
    close_line(ours)
    assert ours.sample(0, 0, 0, False).status == BridgeStatus.ENABLE_LINE


def test_silence_with_the_line_open_is_no_drop():
    ours = board()
    ours.receive(0, beat(0))
    ours.expire(10 * TIMEOUT_MS * MS)
    assert ours.heartbeat_drops == 0


@given(st.lists(st.tuples(st.integers(0, 2 * TIMEOUT_MS), st.sampled_from((None, 0, 1)))))
def test_the_line_is_only_closed_within_the_timeout_of_an_enabling_heartbeat(steps):
    ours = board()
    now_ms, last_ms = 0, -10 * TIMEOUT_MS
    close_line(ours, -10 * TIMEOUT_MS * MS)
    for wait_ms, enable in steps:
        now_ms += wait_ms
        ours.expire(now_ms * MS)
        if enable is not None:
            ours.receive(now_ms * MS, beat(enable))
            last_ms = now_ms if enable else -10 * TIMEOUT_MS
        assert not ours.line_closed or now_ms - last_ms < TIMEOUT_MS


def test_a_clipped_torque_is_marked():
    sample = board().sample(5 * MS, 77, -3, True)
    assert (sample.encoder_gray, sample.torque_counts) == (77, -3)
    assert sample.status == BridgeStatus.TORQUE_INVALID


def test_its_clock_has_an_offset_drifts_and_wraps():
    ours = board()
    assert ours.clock_us(0) == CLOCK_OFFSET_US
    second = ours.clock_us(1_000_000_000) - ours.clock_us(0)
    assert second == pytest.approx(1e6 * (1 + CLOCK_DRIFT), abs=1)
    wraps_ns = (frames.CLOCK_MODULUS_US - CLOCK_OFFSET_US) * 1000
    assert ours.clock_us(wraps_ns) < 1_000_000


def test_status_has_the_newest_heartbeat():
    ours = board()
    ours.receive(3 * MS, frames.Numbered(41, frames.Heartbeat(1)))
    ours.receive(4 * MS, frames.Numbered(42, frames.Heartbeat(1)))
    ours.dropped = 6
    for _ in range(5):
        ours.check.corrupt()
    status = ours.status(9 * MS)
    assert (status.heartbeats, status.heartbeat_sequence) == (2, 42)
    assert status.heartbeat_t_us == ours.clock_us(4 * MS)
    assert (status.errors, status.dropped) == (5, 6)


def test_status_comes_unasked_while_it_streams_and_a_period_after_any_other():
    ours = board()
    assert not ours.status_is_due(10 * STATUS_PERIOD_NS)
    ask(ours, frames.Start(), 3 * MS)
    ask(ours, frames.Configure(500, 20_000), 7 * MS)
    due_ns = 7 * MS + STATUS_PERIOD_NS
    assert [ours.status_is_due(due_ns - 1), ours.status_is_due(due_ns)] == [False, True]
    ours.status(due_ns)
    assert not ours.status_is_due(due_ns + STATUS_PERIOD_NS - 1)
    ask(ours, frames.Stop(), due_ns + 1)
    assert not ours.status_is_due(10 * due_ns)
