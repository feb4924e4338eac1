"""One drive on a CAN bus, whatever it takes as its command: opening, reading, sending, errors.

The messages come from the bench's DBC, the bus is any that `motord.hal.can.bus` opens. The loop
pays per tick for one send and one receive, whatever number of frames has arrived.
"""

import math
from typing import ClassVar

import numpy as np

from motord.config import CanopenConfig, Config
from motord.hal.base import DeviceError
from motord.hal.can.base import BusState, CanBus
from motord.hal.can.bus import open_bus
from motord.hal.countdown import countdown_s
from motord.hal.inverter.feedback import CanFeedback
from motord.hal.loop_clock import LoopClock
from motord.schema import INT32_MAX, InverterStatus
from motord.wire.can import dbc, reach
from motord.wire.can.frame_format import EXTENDED, SYNC, heartbeat, nmt_start


class CanopenHost:
    """Sends what `[inverter.can.canopen]` asks for; heartbeats come from the loop's own writes."""

    def __init__(self, config: CanopenConfig) -> None:
        node, host = config.start_node, config.heartbeat_node
        self._start = nmt_start(node) if node is not None else None
        self._sync = SYNC if config.sync else None
        self._heartbeat = heartbeat(host) if host is not None else None
        self._period_ns = round(config.heartbeat_s * 1e9)
        self._sent_ns = 0

    def start(self, bus: CanBus) -> None:
        """Have the node become operational; a node that is so already stays so."""
        if self._start is not None:
            bus.send(*self._start)

    def after_command(self, bus: CanBus, now_ns: int) -> None:
        """Put the command in force, and show that the host is there once in a period."""
        if self._sync is not None:
            bus.send(*self._sync)
        if self._heartbeat is None or 0 <= now_ns - self._sent_ns < self._period_ns:
            return
        bus.send(*self._heartbeat)
        self._sent_ns = now_ns


_OPEN_ASK_S = 0.02


class CanDrive:
    """A drive whose messages a DBC describes: an `InverterDriver` but for `write`."""

    NO_CURRENT_A: ClassVar[tuple[float, ...]]
    """What is sent where no current shall flow."""

    def __init__(self, config: Config) -> None:
        """Compile the drive's messages; nothing is opened. Raises ConfigError."""
        can = config.inverter.can
        assert can is not None  # a rule of the bench file
        self.name = f"inverter on {can.place}"
        self._config = can
        self._codec = dbc.load(can)
        reach.check(self._codec, config)
        limits_s = (can.slow_stale_after_s, config.inverter.stale_after_s)
        ages_s = (config.inverter.feedback_age_s, *limits_s)
        self._feedback = CanFeedback(self._codec, *(round(age_s * 1e9) for age_s in ages_s))
        self._host = CanopenHost(can.canopen)
        self._counter = 0
        self._now_ns = 0
        self._bus: CanBus | None = None
        self._state = BusState()
        self._clock = LoopClock()
        self._errors_before: int | None = None  # link errors count from the first read

    def open(self) -> None:
        """Open the bus and wait until every feedback message has come. Raises DeviceError."""
        bus = open_bus(self._config, self.name)
        self._bus, self._state = bus, bus.state
        try:
            self._await_feedback(bus)
            bus.listen(self._feedback.keys)
        except BaseException:
            self._bus = None
            bus.close()
            raise

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill what an `InverterDriver` fills; add errors."""
        self._now_ns = now_ns
        self._clock.observe(now_ns)
        if self._bus is not None:
            self._take(self._bus, now_ns)
        self._feedback.fill(feedback)
        errors = self._state.errors + self._feedback.errors
        if self._errors_before is None:
            self._errors_before = errors
            self._feedback.restart()  # what overflowed while nobody read is no error of the link
        feedback["link_errors"] += min(errors - self._errors_before, INT32_MAX)
        if self._state.off:
            feedback["inverter_status"] |= int(InverterStatus.BUS_OFF)

    def safe_stop(self) -> None:
        """Send zero current and disable; twice, in case a frame is lost."""
        self._send(self.NO_CURRENT_A, False)
        self._send(self.NO_CURRENT_A, False)

    def close(self) -> None:
        """Stop safely and release the bus; may be called twice."""
        self.safe_stop()
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()

    def _send(self, currents_A: tuple[float, ...], enable: bool) -> None:
        """Send the command, and what goes with it; nothing happens while the bus is closed."""
        payload = self._codec.encode_command(currents_A, enable, self._counter)
        self._counter += 1
        if self._bus is not None:
            self._bus.send(self._codec.command.key, payload)
            self._host.after_command(self._bus, self._now_ns)

    def _take(self, bus: CanBus, now_ns: int, timeout_s: float = 0.0) -> set[int]:
        """Take what has come, at most waiting for the first; returns the keys."""
        frames, stamped = bus.receive(timeout_s), self._clock.from_system
        for key, payload, stamp_ns in frames:
            self._feedback.take(key, payload, stamped(stamp_ns) if stamp_ns else now_ns)
        return {key for key, _, _ in frames} if timeout_s else set()

    def _await_feedback(self, bus: CanBus) -> None:
        received: set[int] = set()
        for _ in countdown_s(self._config.connect_timeout_s):
            self._now_ns = self._clock.now_ns()
            self._host.start(bus)
            self._send(self.NO_CURRENT_A, False)
            received |= self._take(bus, self._now_ns, _OPEN_ASK_S)
            if bus.state.failures:
                raise DeviceError(f"{self.name}: the bus failed: {bus.state.last}")
            if not self._feedback.missing():
                return
        raise self._silence(received)

    def _silence(self, received: set[int]) -> DeviceError:
        """Return the error for feedback that did not come, with what came instead."""
        dbc_file = self._config.dbc
        corrupt = " and ".join(m.name for m in self._feedback.corrupt())
        if corrupt:
            what = f"{corrupt} came with a wrong length or CRC; is {dbc_file} this drive's DBC?"
            return DeviceError(f"{self.name}: {what}")
        missing = self._feedback.missing()
        names = " and ".join(f"{m.name} (0x{m.identifier:x})" for m in missing)
        others = sorted(key & ~EXTENDED for key in received - {self._codec.command.key})
        what = f"no {names} within {self._config.connect_timeout_s:g} s, "
        if others:
            listed = ", ".join(f"0x{identifier:x}" for identifier in others[:8])
            what += f"only {listed}; is {dbc_file} this drive's DBC?"
        else:
            what += "nothing at all; is the drive on, and is the bit rate right?"
        return DeviceError(f"{self.name}: {what}")


class CanInverter(CanDrive):
    """An `InverterDriver` for a drive that takes phase currents."""

    NO_CURRENT_A = (0.0, 0.0, 0.0)

    def write(self, command: np.ndarray) -> None:
        """Send current references and the enable bit; a current that is not finite makes all 0."""
        i_a_A, i_b_A, i_c_A = command["i_A"][0].tolist()
        if math.isfinite(i_a_A + i_b_A + i_c_A):
            self._send((i_a_A, i_b_A, i_c_A), bool(command["enable"][0]))
        else:
            self._send(self.NO_CURRENT_A, bool(command["enable"][0]))
