import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from motord.hal.base import DeviceError
from motord.hal.wire_rig import WireRig
from tests.contract.benches import (
    Bench,
    bridge_can,
    can_dq,
    can_udp,
    new_command,
    new_feedback,
    serial,
    wires,
)
from tests.contract.peers import Board, Drive, never_ask, until


class Recorder:
    """A driver of either kind that notes what it is asked."""

    def __init__(self, name: str, log: list[str], failing: str = "") -> None:
        self._name, self._log, self._failing = name, log, failing
        self.clock: Any = None

    def _note(self, what: str) -> None:
        self._log.append(f"{self._name}.{what}")
        if self._failing == what:
            raise DeviceError(f"{self._name} fails to {what}")

    def open(self) -> None:
        self._note("open")

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        self._note("read")
        feedback["link_errors"] += 7

    def write(self, command: np.ndarray) -> None:
        self._note("write")

    def safe_stop(self) -> None:
        self._note("safe_stop")

    def close(self) -> None:
        self._note("close")


def rig_of(log: list[str], inverter: str = "", bridge: str = "") -> WireRig:
    return WireRig(Recorder("inverter", log, inverter), Recorder("bridge", log, bridge))


def test_link_errors_of_both_are_added_anew_each_time() -> None:
    rig, feedback = rig_of([]), new_feedback()
    for _ in range(2):
        rig.read(123, feedback)
        assert feedback["link_errors"][0] == 14
        assert feedback["now_ns"][0] == 123


def test_the_clock_is_that_of_any_bridge_driver_that_has_one() -> None:
    inverter, bridge = Recorder("inverter", []), Recorder("bridge", [])
    assert WireRig(inverter, bridge).clock is None
    for clock, taken in (
        (time.monotonic_ns, False),
        (SimpleNamespace(drift_ppm=1.0, jitter_ns=2.0), True),
    ):
        bridge.clock = clock
        assert (WireRig(inverter, bridge).clock is clock) is taken


def test_currents_go_out_first() -> None:
    log: list[str] = []
    rig_of(log).write(new_command())
    assert log == ["inverter.write", "bridge.write"]


def test_neither_stays_open_if_one_cannot_be_opened() -> None:
    log: list[str] = []
    with pytest.raises(DeviceError, match="inverter fails"):
        rig_of(log, inverter="open").open()
    assert log == ["bridge.open", "inverter.open", "bridge.close"]


@pytest.mark.parametrize("what", ["safe_stop", "close"])
@pytest.mark.parametrize("victim", ["inverter", "bridge"])
def test_one_that_fails_does_not_keep_the_other_from_stopping(what: str, victim: str) -> None:
    log: list[str] = []
    rig = rig_of(log, **{victim: what})
    with pytest.raises(DeviceError):
        getattr(rig, what)()
    assert log == [f"inverter.{what}", f"bridge.{what}"]


def read_anew(bench: Bench, ends: tuple[Any, ...]) -> int:
    """Let the other ends speak until there is a sample of each; return the link errors."""
    feedback, first = new_feedback(), new_feedback()
    bench.driver.read(bench.clock.now_ns(), first)

    def anew() -> bool:
        for end in ends:
            end.step()
        bench.driver.read(bench.clock.now_ns(), feedback)
        return all(feedback[name][0] > first[name][0] for name in bench.times)

    until(anew)
    return int(feedback["link_errors"][0])


@pytest.mark.parametrize("make", [can_udp, can_dq, wires])
def test_what_overflows_before_the_first_read_is_no_link_error(make: Callable[[], Bench]) -> None:
    """As a drive's frames do while the loop is set up; what is lost later is."""
    bench = make()
    try:
        bench.driver.open()
        for end in bench.peers:
            end.stop()
            if isinstance(end, Drive):
                end.lose = 100  # their numbers show, once it speaks again, that they are missing
                for _ in range(20):
                    end.speak()
                end.lose = 0
        assert read_anew(bench, bench.peers) == 0
        assert read_anew(bench, bench.peers) == 0
        for end in bench.peers:
            end.lose = 2
        until(lambda: read_anew(bench, bench.peers) >= 2 * len(bench.peers))
    finally:
        bench.close()


@pytest.mark.parametrize("make", [serial, bridge_can, wires])
def test_a_board_sends_nothing_until_somebody_reads(
    make: Callable[[], Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that nothing overflows while an inverter takes its time to open, or the loop is set up."""
    bench = make()
    never_ask(bench.driver, monkeypatch)
    (board,) = (end for end in bench.peers if isinstance(end, Board))
    try:
        bench.driver.open()
        until(lambda: not board.streaming)
        starts = board.starts
        feedback = new_feedback()
        bench.driver.read(bench.clock.now_ns(), feedback)
        until(lambda: board.streaming)
        heartbeats = board.heartbeats
        for _ in range(3):
            bench.driver.read(bench.clock.now_ns(), feedback)
            bench.driver.write(new_command())
        until(lambda: board.heartbeats == heartbeats + 3)  # and whatever was sent before them
        assert board.starts == starts + 1
        assert feedback["link_errors"][0] == 0
    finally:
        bench.close()
