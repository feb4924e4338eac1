"""One drive on a CAN bus, whatever it takes as its command: opening, reading, errors.

The loop pays per tick for one send and one receive, whatever number of frames has arrived.
"""

import time
from collections.abc import Callable, Collection
from typing import Protocol

from motord.config import CanConfig
from motord.hal.base import DeviceError
from motord.hal.bridge.clock import LoopClock
from motord.hal.can.base import BusState, CanBus
from motord.hal.can.bus import open_bus
from motord.wire.can.codec import MessageCodec
from motord.wire.can.frame_format import EXTENDED

_OPEN_ASK_S = 0.02


class Feedback(Protocol):
    """What puts the drive's messages together (`CanFeedback`)."""

    @property
    def keys(self) -> Collection[int]:
        """Return the keys of the messages it takes."""

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or repeated so far."""

    def take(self, key: int, payload: bytes, t_ns: int) -> None:
        """Take a frame that arrived at `t_ns` of the loop's clock."""

    def missing(self) -> list[MessageCodec]:
        """Return the messages of which no good frame has come yet."""

    def corrupt(self) -> list[MessageCodec]:
        """Return the messages of which frames came that were not good."""


class CanDrive:
    """The bus and what comes from the drive on it. `command_key` is what we ourselves send."""

    def __init__(self, config: CanConfig, feedback: Feedback, command_key: int) -> None:
        self.name = f"inverter on {config.interface} {config.channel}"
        self._config = config
        self._feedback = feedback
        self._command_key = command_key
        self._bus: CanBus | None = None
        self._state = BusState()
        self._clock = LoopClock()
        self._errors_before: int | None = None  # link errors count from the first read

    @property
    def off(self) -> bool:
        """Return whether the controller is off the bus, or the bus takes no frames."""
        return self._state.off

    def open(self, ask: Callable[[], None]) -> None:
        """Open the bus and wait until every feedback message has come; `ask` sends the drive a
        command that does no harm. Raises DeviceError."""
        bus = open_bus(self._config, self.name)
        self._bus, self._state = bus, bus.state
        try:
            self._await_feedback(bus, ask)
            bus.listen(self._feedback.keys)
        except BaseException:
            self.close()
            raise

    def read(self, now_ns: int) -> int:
        """Hand the feedback all frames that have arrived; returns the link errors so far."""
        self._clock.observe(now_ns)
        if self._bus is not None:
            self._take(self._bus, now_ns)
        errors = self._state.errors + self._feedback.errors
        if self._errors_before is None:
            self._errors_before = errors
        return errors - self._errors_before

    def send(self, payload: bytes) -> None:
        """Send the command's message; nothing happens while the bus is closed."""
        if self._bus is not None:
            self._bus.send(self._command_key, payload)

    def close(self) -> None:
        """Release the bus; may be called twice."""
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()

    def _take(self, bus: CanBus, now_ns: int, timeout_s: float = 0.0) -> set[int]:
        """Take what has come, at most waiting for the first; returns the keys."""
        frames = bus.receive(timeout_s)
        system_ns = self._clock.from_system(0)
        for key, payload, stamp_ns in frames:
            self._feedback.take(key, payload, stamp_ns + system_ns if stamp_ns else now_ns)
        return {key for key, _, _ in frames} if timeout_s else set()

    def _await_feedback(self, bus: CanBus, ask: Callable[[], None]) -> None:
        deadline_s = time.monotonic() + self._config.connect_timeout_s
        received: set[int] = set()
        while self._feedback.missing():
            if time.monotonic() >= deadline_s:
                raise self._silence(received)
            ask()
            received |= self._take(bus, self._clock.now_ns(), _OPEN_ASK_S)
            if bus.state.failures:
                raise DeviceError(f"{self.name}: the bus failed: {bus.state.last}")

    def _silence(self, received: set[int]) -> DeviceError:
        """Return the error for feedback that did not come, with what came instead."""
        dbc_file = self._config.dbc
        corrupt = " and ".join(m.name for m in self._feedback.corrupt())
        if corrupt:
            what = f"{corrupt} came with a wrong length or CRC; is {dbc_file} this drive's DBC?"
            return DeviceError(f"{self.name}: {what}")
        missing = self._feedback.missing()
        names = " and ".join(f"{m.name} (0x{m.identifier:x})" for m in missing)
        others = sorted(key & ~EXTENDED for key in received - {self._command_key})
        what = f"no {names} within {self._config.connect_timeout_s:g} s, "
        if others:
            listed = ", ".join(f"0x{identifier:x}" for identifier in others[:8])
            what += f"only {listed}; is {dbc_file} this drive's DBC?"
        else:
            what += "nothing at all; is the drive on, and is the bit rate right?"
        return DeviceError(f"{self.name}: {what}")
