"""How long a board that answers late is waited for, on a clock of the test's own."""

import time
from types import SimpleNamespace

import pytest

from motord.emulate.board import Board
from motord.hal import countdown
from motord.hal.base import DeviceError
from motord.hal.bridge.board import Bridge
from motord.wire.bridge import frames
from tests.unit.control.bench import make_config
from tests.unit.hal.test_bridge_restart import Link

TIMEOUT_S = 2.0
ONCE_MORE_S = 0.5
"""Each of three requests is sent once, whatever time is left, and each wait has a last look."""


class LateLink(Link):
    """A board that obeys a kind of request `late_s` after the first of them; waits take `now_s`."""

    def __init__(self, board: Board, late_s: float) -> None:
        super().__init__(board)
        self.late_s, self.now_s = late_s, 0.0
        self._first_s: dict[type[frames.Frame], float] = {}

    def send(self, frame: frames.Frame, number: int) -> None:
        first_s = self._first_s.setdefault(type(frame), self.now_s)
        if self.now_s - first_s >= self.late_s:
            super().send(frame, number)

    def wait(self, timeout_s: float) -> None:
        self.now_s += timeout_s


def opening(late_s: float, patch: pytest.MonkeyPatch) -> tuple[LateLink, Bridge]:
    config = make_config(bridge={"connect_timeout_s": TIMEOUT_S})
    link = LateLink(Board(config, time.monotonic_ns()), late_s)
    patch.setattr(countdown, "time", SimpleNamespace(monotonic=lambda: link.now_s))
    return link, Bridge(config, "bridge", "", lambda: link)


@pytest.mark.parametrize("late_s", [0.0, TIMEOUT_S / 4])
def test_a_board_that_answers_all_in_time_is_opened(
    late_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, driver = opening(late_s, monkeypatch)
    driver.open()
    assert link.now_s <= TIMEOUT_S


@pytest.mark.parametrize(
    ("late_s", "why"),
    [
        (TIMEOUT_S * 0.4, "no Sample within 2 s, although motord-emulate has said who it is"),
        (TIMEOUT_S * 0.75, "no Status within 2 s, although motord-emulate has said who it is"),
        (TIMEOUT_S * 10, "no Hello within 2 s, nothing at all"),
    ],
)
def test_all_answers_together_have_the_timeout(
    late_s: float, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, driver = opening(late_s, monkeypatch)
    with pytest.raises(DeviceError, match=why):
        driver.open()
    assert TIMEOUT_S <= link.now_s <= TIMEOUT_S + ONCE_MORE_S
