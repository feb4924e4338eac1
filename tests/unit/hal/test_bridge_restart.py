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


@pytest.mark.parametrize("away", [False, True], ids=["reset", "reset-while-away"])
def test_the_line_of_a_board_that_starts_anew_stays_open_until_the_command_was_open(
    away: bool,
) -> None:
    """As the kernel has to see it open for 5 ms, or a reset in mid-run would be no trip."""
    config = make_config()
    board = Board(config, time.monotonic_ns())
    link = Link(board)
    driver, feedback = Bridge(config, "bridge", "", lambda: link), new_feedback()
    driver.open()

    def tick(enable: int) -> bool:
        driver.read(time.time_ns(), feedback)
        driver.write(new_command(enable=enable))
        return board.line_closed

    assert [tick(enable) for enable in (0, 1, 1)][-1]
    board.restart(time.monotonic_ns())
    link.sequence, link.openings = 0, 1 + away
    link.arrive(board.hello())
    assert not any(tick(1) for _ in range(20))
    assert driver.restarts == 1
    assert [tick(enable) for enable in (0, 1, 1)][-1]
