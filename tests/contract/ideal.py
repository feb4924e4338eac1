"""A faultless driver of each kind and its other end, in memory and in virtual time.

What keeps the contract in the fewest lines: `mutants` breaks it, one line at a time.
"""

import math
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motord.hal.base import DeviceError, DeviceReading
from motord.schema import BridgeStatus, InverterStatus
from tests.contract.benches import BRIDGE, INVERTER, Bench

PERIOD_NS = 1_000_000
PATIENCE_PERIODS = 100
START_NS = 1_700_000_000_000_000_000
STEP = 0.001
"""What a set-point is rounded to in the slow device."""


class VirtualClock:
    """Time that passes only while somebody waits; `ticks` are called every period."""

    def __init__(self) -> None:
        self.ticks: list[Callable[[int], None]] = []
        self._now_ns = START_NS

    def now_ns(self) -> int:
        return self._now_ns

    def until(self, condition: Callable[[], Any]) -> Any:
        """Let periods pass until `condition` is true; fails after `PATIENCE_PERIODS`."""
        for _ in range(PATIENCE_PERIODS):
            if result := condition():
                return result
            self._now_ns += PERIOD_NS
            for tick in self.ticks:
                tick(self._now_ns)
        raise AssertionError(f"not within {PATIENCE_PERIODS} periods: {condition}")


@dataclass
class Frame:
    """What the other end says once."""

    counter: int
    t_ns: int
    values: dict[str, Any]
    good: bool


@dataclass
class OtherEnd:
    """A device that says `values` every period, and keeps the newest command."""

    values: dict[str, Any]
    silent: bool = False
    corrupt: int = 0
    lose: int = 0
    refusing: bool = False
    off: bool = False
    i_A: tuple[float, ...] = (9.0, 9.0, 9.0)
    enable: bool = True
    commands: int = 0
    on_the_way: list[Frame] = field(default_factory=list)
    _counter: int = 0

    def tick(self, now_ns: int) -> None:
        if self.silent:
            return
        self._counter += 1
        if self.lose:
            self.lose -= 1
            return
        values = dict(self.values)
        if self.corrupt:
            values |= {name: np.asarray(value) + 16 for name, value in values.items()}
        self.on_the_way.append(Frame(self._counter, now_ns, values, not self.corrupt))
        self.corrupt = max(self.corrupt - 1, 0)

    def take(self) -> list[Frame]:
        taken, self.on_the_way = self.on_the_way, []
        return taken

    def obey(self, i_A: tuple[float, ...], enable: bool) -> None:
        if self.refusing:
            raise OSError("the link takes nothing")
        self.i_A, self.enable = i_A, enable
        self.commands += 1

    def close(self) -> None:
        """Nothing is held."""


class Driver:
    """Driver of an inverter or of a bridge, after the `OtherEnd` that it has."""

    FILLS: tuple[str, ...]
    TIME: str

    def __init__(self, end: OtherEnd, clock: VirtualClock) -> None:
        self.end = end
        self.clock = clock
        self.fd: int | None = None
        self.errors = 0
        self.counter: int | None = None
        self.t_ns = 0
        self.values: dict[str, Any] = dict.fromkeys(self.FILLS, 0)

    def open(self) -> None:
        self.fd = os.open("/dev/null", os.O_RDONLY)  # stands for a socket or a port
        self.clock.until(lambda: self.end.on_the_way)
        self.accept(self.end.take()[-1])

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        if self.fd is not None:
            for frame in self.end.take():
                self.accept(frame)
        self.fill(feedback)

    def accept(self, frame: Frame) -> None:
        if self.counter is not None:
            self.errors += frame.counter - self.counter - 1
        self.counter = frame.counter
        if frame.good:
            self.t_ns, self.values = frame.t_ns, frame.values
        else:
            self.errors += 1

    def fill(self, feedback: np.ndarray) -> None:
        feedback[self.TIME] = self.t_ns
        for name, value in self.values.items():
            feedback[name] = value
        if self.end.off and "inverter_status" in self.FILLS:
            feedback["inverter_status"] |= int(InverterStatus.BUS_OFF)
        feedback["link_errors"] += self.errors

    def write(self, command: np.ndarray) -> None:
        self.send(self.finite(tuple(command["i_A"][0].tolist())), bool(command["enable"][0]))

    def finite(self, i_A: tuple[float, ...]) -> tuple[float, ...]:
        return i_A if math.isfinite(sum(i_A)) else (0.0, 0.0, 0.0)

    def send(self, i_A: tuple[float, ...], enable: bool) -> None:
        if self.fd is None:
            return
        try:
            self.end.obey(i_A, enable)
        except OSError:
            self.errors += 1

    def safe_stop(self) -> None:
        self.send((0.0, 0.0, 0.0), False)

    def close(self) -> None:
        if self.fd is not None:
            self.safe_stop()
            os.close(self.fd)
            self.fd = None


class Inverter(Driver):
    FILLS, TIME = INVERTER, "t_inverter_ns"
    SAYS: dict[str, Any] = {
        "i_A": [1.0, -2.5, 1.5],
        "u_V": [3.0, -6.0, 3.0],
        "u_bus_V": 24.0,
        "temperature_C": 41.5,
        "inverter_status": int(InverterStatus.READY),
    }
    SAYS_LATER: dict[str, Any] = {"i_A": [-4.0, 1.0, 3.0], "u_bus_V": 27.5}


class Bridge(Driver):
    FILLS, TIME = BRIDGE, "t_ns"
    SAYS: dict[str, Any] = {
        "encoder_gray": 0x5A5,
        "torque_Nm": 3.0,
        "bridge_status": int(BridgeStatus.ENABLE_LINE),
    }
    SAYS_LATER: dict[str, Any] = {"encoder_gray": 0x3C3, "torque_Nm": -1.4}


def bench(kind: type[Driver]) -> Bench:
    """Return a driver of this class and its other end."""
    clock = VirtualClock()
    inverter = issubclass(kind, Inverter)
    end = OtherEnd(dict(kind.SAYS))
    clock.ticks.append(end.tick)
    return Bench(
        driver=kind(end, clock),
        fills=kind.FILLS,
        peers=(end,),
        received=lambda: (end.i_A if inverter else None, end.enable),
        says=lambda: dict(end.values),
        alter=lambda: end.values.update(kind.SAYS_LATER),
        commands=lambda: end.commands,
        refuse=lambda: setattr(end, "refusing", True),
        bus_off=(lambda: setattr(end, "off", True)) if inverter else None,
        clock=clock,
    )


class SlowEnd:
    """A device with one set-point, rounded to `STEP`, from 0 to 1."""

    def __init__(self) -> None:
        self.setpoint = 0.0
        self.value = 0.0
        self.status = 1
        self.gone = False

    def ask(self, setpoint: float | None = None) -> tuple[float, float, int]:
        """Write a set-point, if there is one; return set-point, value and status."""
        if self.gone:
            raise OSError("nobody there")
        if setpoint is not None:
            self.setpoint = round(setpoint / STEP) * STEP
        return self.setpoint, self.value, self.status

    def measure(self, value: float, status: int) -> None:
        self.value, self.status = value, status


class Slow:
    """A `SetpointDevice` after a `SlowEnd`."""

    def __init__(self, end: SlowEnd) -> None:
        self.end = end
        self.fd: int | None = None

    def open(self) -> None:
        self.ask()
        if self.fd is None:
            self.fd = os.open("/dev/null", os.O_RDONLY)

    def exchange(self, setpoint: float) -> DeviceReading:
        self.ask(self.kept(setpoint))
        actual, value, status = self.ask()
        return DeviceReading(status, actual, value)

    def kept(self, setpoint: float) -> float:
        return min(max(setpoint, 0.0), 1.0) if math.isfinite(setpoint) else 0.0

    def ask(self, setpoint: float | None = None) -> tuple[float, float, int]:
        try:
            return self.end.ask(setpoint)
        except OSError as error:
            raise DeviceError(f"brake: {error}") from error

    def safe_stop(self) -> None:
        with suppress(DeviceError):
            self.ask(0.0)

    def close(self) -> None:
        if self.fd is not None:
            os.close(self.fd)
            self.fd = None
