"""Broken drivers, each with the tests of the contract that have to find it.

A mutant replaces methods of a driver of `ideal`. One that no test finds is a hole in the contract;
a driver's author may meet it on a bench.
"""

import math
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from motord.hal.base import DeviceError, DeviceReading
from tests.contract.benches import BRIDGE, INVERTER
from tests.contract.ideal import Bridge, Driver, Frame, Inverter, Slow

BOTH = (Inverter, Bridge)


@dataclass(frozen=True)
class Mutant:
    """What it does wrong, the classes it is made of, its methods, and the tests that find it."""

    what: str
    kinds: tuple[type, ...]
    methods: dict[str, Callable[..., Any]]
    found_by: tuple[str, ...]

    def classes(self) -> list[type]:
        return [type(f"Broken{kind.__name__}", (kind,), dict(self.methods)) for kind in self.kinds]


def after_fill(change: Callable[[Driver, np.ndarray], object]) -> dict[str, Callable[..., Any]]:
    """Return a `fill` that spoils what was filled in."""

    def fill(self: Driver, feedback: np.ndarray) -> None:
        Driver.fill(self, feedback)
        change(self, feedback)

    return {"fill": fill}


def after_accept(change: Callable[[Driver, Frame], object]) -> dict[str, Callable[..., Any]]:
    """Return an `accept` that spoils what was taken."""

    def accept(self: Driver, frame: Frame) -> None:
        Driver.accept(self, frame)
        change(self, frame)

    return {"accept": accept}


def sending(
    change: Callable[[tuple[float, ...], bool], tuple[tuple[float, ...], bool]],
) -> dict[str, Callable[..., Any]]:
    """Return a `send` that sends something else."""
    return {"send": lambda self, i_A, enable: Driver.send(self, *change(i_A, enable))}


def leaves_out(name: str) -> dict[str, Callable[..., Any]]:
    def fill(self: Driver, feedback: np.ndarray) -> None:
        before = feedback[name].copy()
        Driver.fill(self, feedback)
        feedback[name] = before

    return {"fill": fill}


def put(name: str, value: object) -> dict[str, Callable[..., Any]]:
    return after_fill(lambda self, feedback: feedback.__setitem__(name, value))


def _first_values(self: Driver, frame: Frame) -> None:
    self.first = getattr(self, "first", frame.values)
    self.values = self.first


def _first_time(self: Driver, frame: Frame) -> None:
    self.first = getattr(self, "first", frame.t_ns)
    self.t_ns = self.first


def _waits(self: Driver, now_ns: int, feedback: np.ndarray) -> None:
    if not self.end.on_the_way:
        time.sleep(1e-4)
    Driver.read(self, now_ns, feedback)


def _deaf_after_silence(self: Driver, now_ns: int, feedback: np.ndarray) -> None:
    self.empty = 0 if self.end.on_the_way else getattr(self, "empty", 0) + 1
    if self.empty > 50:
        self.end.lose = 1 << 30
    Driver.read(self, now_ns, feedback)


def _commands_by_itself(self: Driver, now_ns: int, feedback: np.ndarray) -> None:
    Driver.read(self, now_ns, feedback)
    self.send(self.end.i_A, self.end.enable)


def _no_send(self: Driver, i_A: tuple[float, ...], enable: bool) -> None:
    """Say nothing of an error."""
    if self.fd is not None and not self.end.refusing:
        self.end.obey(i_A, enable)


def _raises_send(self: Driver, i_A: tuple[float, ...], enable: bool) -> None:
    if self.fd is not None:
        self.end.obey(i_A, enable)


def _sends_always(self: Driver, i_A: tuple[float, ...], enable: bool) -> None:
    self.end.obey(i_A, enable)


def _counts_one_send(self: Driver, i_A: tuple[float, ...], enable: bool) -> None:
    errors = self.errors
    Driver.send(self, i_A, enable)
    if self.errors > errors and getattr(self, "refused_before", False):
        self.errors = errors
    self.refused_before = self.end.refusing


def _leaks(self: Driver) -> None:
    if self.fd is not None:
        self.safe_stop()
        self.fd = os.dup(self.fd) and None


def _leaves_a_thread(self: Driver) -> None:
    threading.Thread(target=time.sleep, args=(0.2,), daemon=True).start()
    Driver.close(self)


def _closes_without_stopping(self: Driver) -> None:
    if self.fd is not None:
        os.close(self.fd)
        self.fd = None


def _closes_once(self: Driver) -> None:
    assert self.fd is not None
    Driver.close(self)


def _accepts_corrupt(self: Driver, frame: Frame) -> None:
    Driver.accept(self, frame)
    self.t_ns, self.values = frame.t_ns, frame.values


def _counts_no_corrupt(self: Driver, frame: Frame) -> None:
    errors = self.errors
    Driver.accept(self, frame)
    self.errors -= 0 if frame.good else min(self.errors - errors, 1)


def _counts_no_lost(self: Driver, frame: Frame) -> None:
    self.counter = None
    Driver.accept(self, frame)


def _keeps_last(self: Driver, command: np.ndarray) -> None:
    i_A = tuple(command["i_A"][0].tolist())
    if math.isfinite(sum(i_A)):
        Driver.write(self, command)
    else:
        self.send(self.end.i_A, bool(command["enable"][0]))


def _shows_the_command(self: Driver, command: np.ndarray) -> None:
    Driver.write(self, command)
    self.values = self.values | {"i_A": command["i_A"][0].tolist()}


def _each_phase(self: Driver, i_A: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(i if math.isfinite(i) else 0.0 for i in i_A)


FILLED = "test_fills_in_all_that_it_measures_and_nothing_else"
SHOWN = "test_shows_what_the_other_end_says"
ARRIVE = "test_commands_arrive"
WILD = "test_a_current_that_is_no_number_is_zero"
FAST = (
    Mutant("fills in nothing", BOTH, {"read": lambda *_: None}, (FILLED, SHOWN)),
    *(
        Mutant(f"leaves out {name}", (kind,), leaves_out(name), (FILLED,))
        for kind, names in ((Inverter, INVERTER), (Bridge, BRIDGE))
        for name in names
    ),
    Mutant("fills in another's field", BOTH, put("now_ns", 1), (FILLED,)),
    Mutant("sets the link errors", BOTH, put("link_errors", 0), (FILLED,)),
    Mutant(
        "says nan", (Inverter,), put("u_bus_V", math.nan), ("test_all_that_it_measures_is_finite",)
    ),
    Mutant("freezes time", BOTH, after_accept(_first_time), ("test_time_goes_on",)),
    Mutant(
        "time in us",
        BOTH,
        after_fill(lambda self, f: f.__setitem__(self.TIME, self.t_ns // 1000)),
        ("test_samples_are_of_now",),
    ),
    Mutant(
        "time of reading",
        BOTH,
        {
            "fill": lambda self, f: (
                setattr(self, "t_ns", self.clock.now_ns() + getattr(self, "reads", 0)),
                setattr(self, "reads", getattr(self, "reads", 0) + 1),
                Driver.fill(self, f),
            )
        },
        ("test_silence_shows_as_time_that_stands_still",),
    ),
    Mutant("says the first for ever", BOTH, after_accept(_first_values), (SHOWN,)),
    Mutant(
        "swaps phases said",
        (Inverter,),
        after_fill(lambda self, f: f.__setitem__("i_A", f["i_A"][:, [1, 0, 2]])),
        (SHOWN,),
    ),
    Mutant(
        "wrong sign said",
        (Inverter,),
        after_fill(lambda self, f: f.__setitem__("i_A", -f["i_A"])),
        (SHOWN,),
    ),
    Mutant(
        "wrong sign said",
        (Bridge,),
        after_fill(lambda self, f: f.__setitem__("torque_Nm", -f["torque_Nm"])),
        (SHOWN,),
    ),
    Mutant(
        "status inverted",
        (Bridge,),
        after_fill(lambda self, f: f.__setitem__("bridge_status", ~f["bridge_status"])),
        (SHOWN,),
    ),
    Mutant(
        "waits for a sample",
        BOTH,
        {"read": _waits},
        ("test_reading_does_not_wait_for_a_silent_device",),
    ),
    Mutant(
        "deaf after a silence",
        BOTH,
        {"read": _deaf_after_silence},
        ("test_silence_shows_as_time_that_stands_still",),
    ),
    Mutant(
        "ignores enable = 0",
        BOTH,
        sending(lambda i_A, enable: (i_A, True)),
        (ARRIVE, "test_stopped_safely", "test_closing_stops_safely"),
    ),
    Mutant("ignores enable = 1", BOTH, sending(lambda i_A, enable: (i_A, False)), (ARRIVE,)),
    Mutant(
        "swaps phases commanded",
        (Inverter,),
        sending(lambda i_A, enable: ((i_A[1], i_A[0], i_A[2]), enable)),
        (ARRIVE,),
    ),
    Mutant(
        "wrong sign commanded",
        (Inverter,),
        sending(lambda i_A, enable: (tuple(-i for i in i_A), enable)),
        (ARRIVE,),
    ),
    Mutant(
        "commands mA",
        (Inverter,),
        sending(lambda i_A, enable: (tuple(1000 * i for i in i_A), enable)),
        (ARRIVE,),
    ),
    Mutant(
        "commands by itself",
        BOTH,
        {"read": _commands_by_itself},
        ("test_reading_commands_nothing",),
    ),
    Mutant("sends what is no number", (Inverter,), {"finite": lambda self, i_A: i_A}, (WILD,)),
    Mutant("keeps the last for what is no number", (Inverter,), {"write": _keeps_last}, (WILD,)),
    Mutant("zeroes one phase alone", (Inverter,), {"finite": _each_phase}, (WILD,)),
    Mutant(
        "says what it was asked",
        (Inverter,),
        {"write": _shows_the_command},
        ("test_measurements_stay_finite_whatever_is_commanded",),
    ),
    Mutant(
        "does not stop",
        BOTH,
        {"safe_stop": lambda self: None},
        ("test_stopped_safely", "test_closing_stops_safely"),
    ),
    Mutant(
        "stops with currents",
        (Inverter,),
        {"safe_stop": lambda self: self.send((1.0, 0.0, 0.0), False)},
        ("test_stopped_safely",),
    ),
    Mutant(
        "closes without stopping",
        BOTH,
        {"close": _closes_without_stopping},
        ("test_closing_stops_safely",),
    ),
    Mutant("closes once only", BOTH, {"close": _closes_once}, ("test_any_call_at_any_time",)),
    Mutant("sends though closed", BOTH, {"send": _sends_always}, ("test_any_call_at_any_time",)),
    Mutant("leaks", BOTH, {"close": _leaks}, ("test_closing_leaves_nothing_open",)),
    Mutant(
        "leaves a thread", BOTH, {"close": _leaves_a_thread}, ("test_closing_leaves_nothing_open",)
    ),
    Mutant(
        "believes what is corrupt",
        BOTH,
        {"accept": _accepts_corrupt},
        ("test_corrupt_frames_count_and_are_not_believed",),
    ),
    Mutant(
        "counts nothing corrupt",
        BOTH,
        {"accept": _counts_no_corrupt},
        ("test_corrupt_frames_count_and_are_not_believed", "test_errors_never_fall"),
    ),
    Mutant("counts nothing lost", BOTH, {"accept": _counts_no_lost}, ("test_lost_frames_count",)),
    Mutant(
        "counts what is right",
        BOTH,
        after_accept(lambda self, _: setattr(self, "errors", self.errors + 1)),
        ("test_a_perfect_link_has_no_errors",),
    ),
    Mutant(
        "counts since the last read",
        BOTH,
        after_fill(lambda self, _: setattr(self, "errors", 0)),
        ("test_errors_never_fall",),
    ),
    Mutant("drops write errors", BOTH, {"send": _no_send}, ("test_a_send_that_fails_shows",)),
    Mutant("raises write errors", BOTH, {"send": _raises_send}, ("test_a_send_that_fails_shows",)),
    Mutant(
        "counts the first write error",
        BOTH,
        {"send": _counts_one_send},
        ("test_a_send_that_fails_shows",),
    ),
    Mutant(
        "never says bus-off",
        (Inverter,),
        put("inverter_status", 1),
        ("test_a_bus_that_is_off_shows",),
    ),
)


def _reads_back_the_request(self: Slow, setpoint: float) -> DeviceReading:
    reading = Slow.exchange(self, setpoint)
    return DeviceReading(reading.status, self.kept(setpoint), reading.value)


def _without(
    status: int | None = None, value: float | None = None
) -> dict[str, Callable[..., Any]]:
    def exchange(self: Slow, setpoint: float) -> DeviceReading:
        reading = Slow.exchange(self, setpoint)
        return DeviceReading(
            reading.status if status is None else status,
            reading.setpoint,
            reading.value if value is None else value,
        )

    return {"exchange": exchange}


def _old_readings(self: Slow, setpoint: float) -> DeviceReading:
    try:
        self.last = Slow.exchange(self, setpoint)
    except DeviceError:
        return self.last
    return self.last


def _raises_as(error: type[Exception], text: str) -> dict[str, Callable[..., Any]]:
    def ask(self: Slow, setpoint: float | None = None) -> tuple[float, float, int]:
        try:
            return self.end.ask(setpoint)
        except OSError:
            raise error(text) from None

    return {"ask": ask}


def _keeps_the_last(self: Slow, setpoint: float) -> float:
    return Slow.kept(self, setpoint) if math.isfinite(setpoint) else self.end.setpoint


def _opens_with_zero(self: Slow) -> None:
    Slow.open(self)
    self.ask(0.0)


def _slow_closes_once(self: Slow) -> None:
    assert self.fd is not None
    Slow.close(self)


READ_BACK = "test_exchange_writes_and_reads_back"
SAYS = "test_shows_what_the_device_says"
GONE = "test_a_device_that_is_gone_is_one_clear_line"
NO_NUMBER = "test_a_setpoint_that_is_no_number_is_zero"
CLOSES = "test_closes_twice_and_leaves_nothing_open"
SLOW = tuple(
    Mutant(what, (Slow,), methods, found_by)
    for what, methods, found_by in (
        ("writes nothing", {"kept": lambda self, setpoint: None}, (READ_BACK,)),
        ("writes percent", {"kept": lambda self, s: 100 * Slow.kept(self, s)}, (READ_BACK,)),
        ("wrong sign", {"kept": lambda self, s: -Slow.kept(self, s)}, (READ_BACK,)),
        ("reads back the request", {"exchange": _reads_back_the_request}, (READ_BACK,)),
        ("value is never read", _without(value=0.0), (SAYS,)),
        ("always ready", _without(status=1), (SAYS,)),
        ("keeps the last for what is no number", {"kept": _keeps_the_last}, (NO_NUMBER,)),
        (
            "full for what is no number",
            {"kept": lambda self, s: min(max(s, 0.0), 1.0)},
            (NO_NUMBER,),
        ),
        (
            "no range",
            {"kept": lambda self, s: s if math.isfinite(s) else 0.0},
            ("test_a_setpoint_is_kept_in_its_range",),
        ),
        ("opens with zero", {"open": _opens_with_zero}, ("test_opening_asks_for_nothing",)),
        ("does not stop", {"safe_stop": lambda self: None}, ("test_safe_stop_at_any_time",)),
        ("raises when stopped and gone", {"safe_stop": lambda self: self.ask(0.0)}, (GONE,)),
        ("leaks", {"close": lambda self: setattr(self, "fd", None)}, (CLOSES,)),
        ("closes once only", {"close": _slow_closes_once}, (CLOSES,)),
        ("old readings as new", {"exchange": _old_readings}, (GONE,)),
        ("raises an OSError", _raises_as(OSError, "brake: gone"), (GONE,)),
        ("does not say which", _raises_as(DeviceError, "gone"), (GONE,)),
        ("a traceback for a message", _raises_as(DeviceError, "brake:\n  at 1\n"), (GONE,)),
    )
)
