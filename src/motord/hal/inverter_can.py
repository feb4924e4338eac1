"""The inverter over CAN: current references out, currents, voltages and status in.

Any interface of python-can will do; the messages come from the bench's DBC. Per tick the loop pays
for one send, one receive call for each frame that arrived and one that finds nothing left. The
command's `can.Message` is made once; python-can makes a new one for each frame received.
"""

import math
import time

import can
import numpy as np

from motord.config import CanConfig, Config
from motord.hal.base import DeviceError
from motord.hal.can_bus import open_bus
from motord.hal.can_feedback import CanFeedback
from motord.hal.clock import LoopClock
from motord.schema import InverterStatus
from motord.wire import dbc

FRAMES_AT_ONCE = 1024
"""Frames taken in one read at most; what is left waits for the next tick."""
SEND_FAILURES_MAX = 5
"""Sends refused on end after which the bus counts as off."""
HOST_STAMP_S = 10.0
"""Time stamps further than this from the system's clock are some other clock's: not used."""

_OPEN_ASK_S = 0.02
_NO_CURRENT_A = (0.0, 0.0, 0.0)


class CanInverter:
    """An `InverterDriver` for a drive whose messages a DBC describes."""

    def __init__(self, config: Config) -> None:
        """Compile the drive's messages; nothing is opened. Raises ConfigError, DeviceError."""
        if config.inverter.can is None:
            raise DeviceError("inverter: the CAN driver needs a table [inverter.can]")
        self._config: CanConfig = config.inverter.can
        self._codec = dbc.load(self._config)
        self._feedback = CanFeedback(self._codec, round(config.inverter.feedback_age_s * 1e9))
        self._bus: can.BusABC | None = None
        self._clock = LoopClock()
        self._host_stamps = False
        self._counter = 0
        self._refused = 0  # sends refused on end
        self._failures = 0  # of sends and receives
        self._errors_before: int | None = None  # link errors count from the first read
        command = self._codec.command
        self._message = can.Message(
            arbitration_id=command.identifier,
            is_extended_id=command.extended,
            is_fd=self._config.fd,
            bitrate_switch=self._config.fd,
            data=bytes(command.size_bytes),
        )

    def open(self) -> None:
        """Open the bus and wait until every feedback message has come. Raises DeviceError."""
        bus = open_bus(self._config, self._name())
        self._bus = bus
        try:
            self._await_feedback(bus)
        except BaseException:
            self._bus = None
            bus.shutdown()
            raise

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill i_A, u_V, u_bus_V, temperature_C, t_inverter_ns, inverter_status, link_errors."""
        self._clock.tell(now_ns)
        if self._bus is not None:
            self._drain(self._bus, now_ns)
        self._feedback.fill(feedback)
        if self._refused >= SEND_FAILURES_MAX:
            feedback["inverter_status"] |= int(InverterStatus.BUS_OFF)
        errors = self._failures + self._feedback.errors
        if self._errors_before is None:
            self._errors_before = errors
        feedback["link_errors"] += errors - self._errors_before

    def write(self, command: np.ndarray) -> None:
        """Send current references and the enable bit; a current that is not finite makes all 0."""
        i_a_A, i_b_A, i_c_A = command["i_A"][0].tolist()
        if math.isfinite(i_a_A + i_b_A + i_c_A):
            self._send((i_a_A, i_b_A, i_c_A), bool(command["enable"][0]))
        else:
            self._send(_NO_CURRENT_A, bool(command["enable"][0]))

    def safe_stop(self) -> None:
        """Send zero current and disable; twice, in case a frame is lost."""
        self._send(_NO_CURRENT_A, False)
        self._send(_NO_CURRENT_A, False)

    def close(self) -> None:
        """Stop safely and release the bus; may be called twice."""
        self.safe_stop()
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.shutdown()

    def _send(self, i_A: tuple[float, float, float], enable: bool) -> None:
        if self._bus is None:
            return
        self._message.data[:] = self._codec.encode_command(i_A, enable, self._counter)
        self._counter += 1
        try:
            self._bus.send(self._message, timeout=0)
            self._refused = 0
        except (can.CanError, OSError):
            self._refused += 1
            self._failures += 1

    def _drain(self, bus: can.BusABC, now_ns: int) -> None:
        """Take all frames that have arrived, the oldest first."""
        for _ in range(FRAMES_AT_ONCE):
            try:
                message = bus.recv(0)
            except (can.CanError, OSError):
                self._failures += 1
                return
            if message is None:
                return
            self._take(message, now_ns)

    def _take(self, message: can.Message, now_ns: int) -> None:
        if self._host_stamps:
            now_ns = self._clock.from_system(int(message.timestamp * 1e9))
        self._feedback.take(message, now_ns)

    def _await_feedback(self, bus: can.BusABC) -> None:
        """Wait for each feedback message once, saying zero current meanwhile."""
        deadline_s = time.monotonic() + self._config.connect_timeout_s
        heard: set[int] = set()
        while self._feedback.missing():
            if time.monotonic() >= deadline_s:
                raise self._silence(heard)
            self._send(_NO_CURRENT_A, False)
            try:
                message = bus.recv(_OPEN_ASK_S)
                while message is not None:
                    heard.add(message.arbitration_id)
                    self._host_stamps = abs(message.timestamp - time.time()) < HOST_STAMP_S
                    self._take(message, self._clock.now_ns())
                    message = bus.recv(0)
            except (can.CanError, OSError) as error:
                raise DeviceError(f"{self._name()}: the bus failed: {error}") from error

    def _silence(self, heard: set[int]) -> DeviceError:
        """Return the error for feedback that did not come, with what came instead."""
        dbc_file = self._config.dbc
        corrupt = " and ".join(m.name for m in self._feedback.corrupt())
        if corrupt:
            what = f"{corrupt} came with a wrong length or CRC; is {dbc_file} this drive's DBC?"
            return DeviceError(f"{self._name()}: {what}")
        missing = self._feedback.missing()
        names = " and ".join(f"{m.name} (0x{m.identifier:x})" for m in missing)
        others = sorted(heard - {self._codec.command.identifier})
        what = f"no {names} within {self._config.connect_timeout_s:g} s, "
        if others:
            listed = ", ".join(f"0x{identifier:x}" for identifier in others[:8])
            what += f"only {listed}; is {dbc_file} this drive's DBC?"
        else:
            what += "nothing at all; is the drive on, and is the bit rate right?"
        return DeviceError(f"{self._name()}: {what}")

    def _name(self) -> str:
        return f"inverter on {self._config.interface} {self._config.channel}"
