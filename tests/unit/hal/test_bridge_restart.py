"""A board that starts anew in mid-run, without threads: its line stays open."""

import time

import pytest

from motord.emulate.board import Board
from motord.hal.bridge.board import Bridge
from motord.wire.bridge import frames
from tests.contract.benches import new_command, new_feedback
from tests.unit.control.bench import make_config


class Link:
    """A `BridgeLink` that takes no time: what is sent is obeyed at once."""

    stamp_ns = errors = 0
    received = ""

    def __init__(self, board: Board) -> None:
        self.board, self.openings, self.sequence = board, 1, 0
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
        self.arrive(*self.board.receive(time.monotonic_ns(), frames.Numbered(number, frame)))

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
