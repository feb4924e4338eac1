"""A board that starts anew in mid-run, without threads: its line stays open."""

import time
from itertools import count

import pytest

from motord.emulate.board import Board
from motord.hal.base import DeviceError
from motord.hal.bridge.board import Bridge
from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from tests.contract.benches import new_command, new_feedback
from tests.unit.control.bench import make_config

SECOND_NS = 1_000_000_000
STRANGER = frames.HelloRequest(frames.PROTOCOL + 1)
LOOK_NS = 10_000


@pytest.fixture(autouse=True)
def own_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let time pass only where somebody looks at a clock: no stall makes a board late or silent."""
    looks_ns = count(time.monotonic_ns(), LOOK_NS)
    system_ns = time.time_ns() - time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(looks_ns))
    monkeypatch.setattr(time, "time_ns", lambda: next(looks_ns) + system_ns)


class Link:
    """A `BridgeLink` that takes no time: what is sent is obeyed at once."""

    stamp_ns = errors = 0
    received = ""

    def __init__(self, board: Board) -> None:
        self.board, self.openings, self.sequence = board, 1, 0
        self.sends = True
        self.now_ns = time.monotonic_ns()
        self.arrived: list[frames.Numbered] = []

    def arrive(self, *sent: frames.Frame) -> None:
        for frame in sent:
            self.arrived.append(frames.Numbered(self.sequence, frame))
            self.sequence += 1

    def receive(self) -> list[frames.Numbered]:
        now_ns = time.monotonic_ns()
        self.board.expire(now_ns)
        if self.board.streaming:
            self.arrive(self.board.sample(now_ns, 0, 0, False))
        arrived, self.arrived = self.arrived, []
        return arrived

    def send(self, frame: frames.Frame, number: int) -> None:
        if self.sends:
            self.arrive(*self.board.receive(time.monotonic_ns(), frames.Numbered(number, frame)))

    def status(self, driver: Bridge) -> int:
        """Read at `now_ns`; return the status word."""
        feedback = new_feedback()
        driver.read(self.now_ns, feedback)
        return int(feedback["bridge_status"][0])

    def wait(self, timeout_s: float) -> None:
        pass

    def close(self) -> None:
        pass


def opened() -> tuple[Link, Bridge]:
    config = make_config()
    link = Link(Board(config, time.monotonic_ns()))
    driver = Bridge(config, "bridge", "", lambda: link)
    driver.open()
    return link, driver


def tick(driver: Bridge, link: Link, enable: int) -> bool:
    """Read and command; return whether the line is closed."""
    driver.read(time.time_ns(), new_feedback())
    driver.write(new_command(enable=enable))
    return link.board.line_closed


def start_anew(link: Link, away: bool = False) -> None:
    link.board.restart(time.monotonic_ns())
    link.sequence, link.openings = 0, link.openings + away
    link.arrive(link.board.hello())


@pytest.mark.parametrize("away", [False, True], ids=["reset", "reset-while-away"])
def test_the_line_of_a_board_that_starts_anew_stays_open_until_the_command_was_open(
    away: bool,
) -> None:
    """As the kernel has to see it open for 5 ms, or a reset in mid-run would be no trip."""
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    start_anew(link, away)
    assert not any(tick(driver, link, 1) for _ in range(20))
    assert driver.restarts == 1
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]


@pytest.mark.parametrize("away", [False, True], ids=["reset", "reset-while-away"])
def test_a_command_to_open_before_the_status_of_a_board_that_started_anew_counts(
    away: bool,
) -> None:
    """Or it would be open until enable_timeout_s is over if it is enabled in between."""
    link, driver = opened()
    assert not tick(driver, link, 0)
    start_anew(link, away)
    assert [tick(driver, link, enable) for enable in (0, 1, 1)] == [False, True, True]


def test_a_configuration_that_is_lost_in_mid_run_opens_the_line_until_the_command_was_open() -> (
    None
):
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    now_ns = time.monotonic_ns()
    kept = link.board.status(now_ns)
    link.arrive(kept._replace(rate_Hz=kept.rate_Hz + 1))
    assert not tick(driver, link, 1)
    link.arrive(kept)
    assert not any(tick(driver, link, 1) for _ in range(20))
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]


def status_after(driver: Bridge, later_ns: int) -> int:
    """Read `later_ns` from now; return the status word."""
    feedback = new_feedback()
    driver.read(time.time_ns() + later_ns, feedback)
    return int(feedback["bridge_status"][0])


def test_a_barred_board_says_so_and_is_asked_anew_but_closes_its_line_only_on_command() -> None:
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    link.board.receive(time.monotonic_ns(), frames.Numbered(0, STRANGER))
    assert not tick(driver, link, 1)
    assert status_after(driver, 0) & BridgeStatus.BARRED
    status_after(driver, SECOND_NS)  # nothing for so long: a HelloRequest
    status_after(driver, SECOND_NS)
    assert not status_after(driver, SECOND_NS) & BridgeStatus.BARRED
    assert not any(tick(driver, link, 1) for _ in range(20))
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]


def test_after_the_hello_of_another_board_nothing_counts_until_that_of_the_one_opened() -> None:
    link, driver = opened()
    tick(driver, link, 0)
    link.board.streaming = False
    ours = link.board.hello()
    link.arrive(ours._replace(serial=9), frames.Sample(0, 0x123, 0, 0))
    feedback = new_feedback()
    for _ in range(3):
        driver.read(time.time_ns(), feedback)
        assert feedback["encoder_gray"][0] == 0
        link.arrive(frames.Sample(0, 0x123, 0, 0))
    assert feedback["bridge_status"][0] & BridgeStatus.OTHER_BOARD
    assert not any(tick(driver, link, enable) for enable in (0, 1, 1))


def answers(driver: Bridge, link: Link, serials: list[int], seconds: float) -> list[int]:
    """Let boards with these serials answer every half second; return the status words."""
    words = []
    for _ in range(round(2 * seconds)):
        link.now_ns += SECOND_NS // 2
        link.arrive(*(link.board.hello()._replace(serial=serial) for serial in serials))
        words += [link.status(driver) for _ in range(2)]
    return words


@pytest.fixture
def virtual(monkeypatch: pytest.MonkeyPatch) -> tuple[Link, Bridge]:
    """A board that answers nothing by itself, on a clock that stands still; configured."""
    link, driver = opened()
    monkeypatch.setattr(time, "monotonic_ns", lambda: link.now_ns)
    for _ in range(2):
        link.status(driver)
        driver.write(new_command())
    link.sends = link.board.streaming = False
    return link, driver


def test_the_own_board_counts_again_once_the_other_one_is_silent_for_three_requests(
    virtual: tuple[Link, Bridge],
) -> None:
    link, driver = virtual
    for word in answers(driver, link, [9], 0.5) + answers(driver, link, [1], 1.5):
        assert word & BridgeStatus.OTHER_BOARD
    assert driver.restarts == 0
    assert not answers(driver, link, [1], 0.5)[-1] & BridgeStatus.OTHER_BOARD
    assert driver.restarts == 1
    assert not answers(driver, link, [], 10.0)[-1] & BridgeStatus.OTHER_BOARD
    assert driver.refused == ""


@pytest.mark.parametrize("serials", [[1, 9], [9, 1]])
def test_of_two_boards_that_both_answer_none_counts_and_the_loop_goes_on(
    virtual: tuple[Link, Bridge], serials: list[int]
) -> None:
    """The loop need not end: it is available again as soon as one of them is gone."""
    link, driver = virtual
    assert all(word & BridgeStatus.OTHER_BOARD for word in answers(driver, link, serials, 10.0)[2:])
    assert (driver.restarts, driver.refused) == (serials.index(9), "")


def test_where_only_another_board_answers_for_three_seconds_it_is_said_for_the_loop_to_end(
    virtual: tuple[Link, Bridge],
) -> None:
    link, driver = virtual
    answers(driver, link, [9], 3.0)
    assert driver.refused == ""
    answers(driver, link, [9], 0.5)
    version = link.board.hello().firmware_version
    assert driver.refused == (
        f"bridge: motord-emulate (firmware {version}) has serial number 9, but the "
        "board that was opened has 1; connect that one, or leave this one to be taken; "
        "then `motord reset`"
    )
    answers(driver, link, [], 2.0)
    assert driver.refused == "", "nobody answers: that board is gone"


def test_a_bus_on_which_two_boards_answer_is_not_opened() -> None:
    config = make_config()
    link = Link(Board(config, time.monotonic_ns()))
    link.arrive(link.board.hello()._replace(serial=9))
    with pytest.raises(DeviceError, match=r"serial number 1, but the board that was opened has 9"):
        Bridge(config, "bridge", "", lambda: link).open()


def enabled_and_repeated(link: Link, driver: Bridge) -> tuple[frames.Frame, ...]:
    """Close the line; from then on only what an adapter repeats arrives: Status and Sample."""
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    now_ns = time.monotonic_ns()
    status, closed = link.board.status(now_ns), link.board.sample(now_ns, 0x123, 0, False)
    assert closed.status & BridgeStatus.ENABLE_LINE
    link.sends = link.board.streaming = False
    return status, closed


def count_for_nothing(
    link: Link, driver: Bridge, repeated: tuple[frames.Frame, ...], enables: tuple[int, ...]
) -> None:
    """Check that what comes again in each tick is no new sample and no closed line."""
    feedback, times_ns = new_feedback(), set()
    for enable in enables:
        driver.write(new_command(enable=enable))
        link.arrive(*repeated)
        driver.read(time.time_ns(), feedback)
        times_ns.add(int(feedback["t_ns"][0]))
        assert feedback["encoder_gray"][0] == 0
        assert not feedback["bridge_status"][0] & BridgeStatus.ENABLE_LINE
    assert len(times_ns) == 1, "they grow stale"


def test_a_block_with_a_hello_that_comes_again_and_again_counts_for_nothing() -> None:
    """An adapter that stands still: each Hello makes samples of before look new."""
    link, driver = opened()
    repeated = enabled_and_repeated(link, driver)
    count_for_nothing(link, driver, (link.board.hello(), *repeated), (1, 1, 1))


def test_a_whole_session_that_comes_again_counts_for_nothing() -> None:
    """Its Status is of a board as configured, but acknowledges no heartbeat since the Hello.

    Or the bench could be enabled by it, once an open line has been commanded.
    """
    link, driver = opened()
    repeated = enabled_and_repeated(link, driver)
    link.arrive(link.board.hello())
    driver.read(time.time_ns(), new_feedback())
    count_for_nothing(link, driver, repeated, (0, 1, 1))


def time_and_code(driver: Bridge) -> tuple[int, int]:
    """Read; return the newest sample's time and encoder code, which is 0 of all in order."""
    feedback = new_feedback()
    driver.read(time.time_ns(), feedback)
    return int(feedback["t_ns"][0]), int(feedback["encoder_gray"][0])


def test_a_late_sample_after_a_hello_is_no_new_one() -> None:
    """With its clock anew the age of what was on the way is not known."""
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    before = time_and_code(driver)
    late = link.board.sample(time.monotonic_ns(), 0x123, 0, False)
    start_anew(link)
    link.arrive(late)
    assert time_and_code(driver) == before


def test_a_sample_of_before_without_a_hello_is_no_new_one() -> None:
    """Repeated after more than half a turn of the frames' numbers, which do not show it then."""
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    before = time_and_code(driver)
    link.board.streaming = False
    link.arrive(link.board.sample(time.monotonic_ns() - 40 * SECOND_NS, 0x123, 0, False))
    assert time_and_code(driver) == before


def test_a_board_whose_clock_stepped_back_counts_again_once_it_was_asked() -> None:
    """Its Hello was lost: until it says who it is its samples are old ones."""
    link, driver = opened()
    feedback = new_feedback()
    driver.read(time.time_ns(), feedback)
    before_ns = int(feedback["t_ns"][0])
    link.board.jump(-40 * SECOND_NS)
    driver.read(time.time_ns(), feedback)
    assert (feedback["t_ns"][0], driver.restarts) == (before_ns, 0)
    for _ in range(3):  # its request; its Hello; its answers
        driver.read(time.time_ns() + SECOND_NS, feedback)
    assert feedback["t_ns"][0] > before_ns
    assert driver.restarts == 1


def test_a_board_that_starts_anew_counts_one_round_trip_later() -> None:
    """Or a bench that is READY would trip: until the next Status the samples would be stale."""
    link, driver = opened()
    assert not tick(driver, link, 0)
    start_anew(link)
    before = time_and_code(driver)
    assert time_and_code(driver)[0] > before[0]


def test_a_line_is_not_closed_on_the_word_of_a_board_that_acknowledges_no_heartbeat() -> None:
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    link.sends = False
    assert status_after(driver, SECOND_NS // 3) & BridgeStatus.ENABLE_LINE
    word = status_after(driver, SECOND_NS)
    assert word & BridgeStatus.HEARTBEAT_LOST
    assert not word & BridgeStatus.ENABLE_LINE


@pytest.mark.parametrize("again", [False, True], ids=["started-anew", "opened-again"])
def test_nothing_of_the_session_before_is_left(again: bool) -> None:
    link, driver = opened()
    assert [tick(driver, link, enable) for enable in (0, 1, 1)][-1]
    before = driver._session
    if again:
        driver.close()
        driver.open()
    else:
        start_anew(link)
        driver.read(time.time_ns(), new_feedback())
    assert driver._session is not before
    assert driver._session.may_close is again


def test_a_heartbeat_that_was_acknowledged_once_is_not_again_when_its_number_comes_round() -> None:
    link, driver = opened()
    tick(driver, link, 0)
    assert not status_after(driver, 0) & BridgeStatus.HEARTBEAT_LOST
    standing = link.board.status(time.monotonic_ns())
    link.arrive(standing)
    link.sends = link.board.streaming = False
    assert status_after(driver, SECOND_NS) & BridgeStatus.HEARTBEAT_LOST
    at = (standing.heartbeat_sequence + 1) % frames.SEQUENCE_MODULUS
    while driver._number % frames.SEQUENCE_MODULUS != at:
        driver.write(new_command())
    link.arrive(standing)
    assert status_after(driver, SECOND_NS) & BridgeStatus.HEARTBEAT_LOST
