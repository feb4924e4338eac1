"""What the emulated inverter, brake and drive do, without I/O: commands, timeouts, registers.

All times are nanoseconds, arguments; nothing here reads a clock.
"""

import math
from collections.abc import Callable, Mapping, Sequence

from motord.config import ChannelConfig, ModbusConfig
from motord.config.channel_sources import ModbusSource
from motord.wire.modbus.registers import DeviceStatus, Register, layout

Currents = tuple[float, float, float]
ZERO_A: Currents = (0.0, 0.0, 0.0)
NEVER_NS = 1 << 62


class Inverter:
    """A drive that follows current commands while they come.

    After `timeout_s` without a command its currents are zero and its power stage is off; it stays
    off until a command to be off has come, so that a host that comes back does not find it running.
    One that is `always_on` has no such command: it follows the next command.
    """

    def __init__(self, timeout_s: float, always_on: bool = False) -> None:
        self._always_on = always_on
        self.i_A = ZERO_A
        self.enabled = False
        self.timed_out = False
        self.timeouts = 0
        self.commanded_ns = 0
        self.deadline_ns = NEVER_NS
        self._timeout_ns = round(timeout_s * 1e9)

    def command(self, now_ns: int, i_A: Currents, enable: bool) -> None:
        """Take a command; currents that are not finite are refused as zero."""
        self.commanded_ns = now_ns
        self.deadline_ns = now_ns + self._timeout_ns
        self.timed_out = self.timed_out and enable and not self._always_on
        self.enabled = enable and not self.timed_out
        self.i_A = i_A if self.enabled and all(map(math.isfinite, i_A)) else ZERO_A

    def expire(self, now_ns: int) -> None:
        """Let time pass: zero the currents if the last command is too old."""
        if now_ns < self.deadline_ns:
            return
        self.deadline_ns = NEVER_NS
        self.timeouts += 1
        self.timed_out = True
        self.enabled = False
        self.i_A = ZERO_A


class RegisterDevice:
    """The registers of a brake or a drive: one set-point in, status and one value out.

    The Modbus server's thread writes, the emulator's loop reads `setpoint` and sets `value` and
    `status`; each is a single attribute, so neither has to wait for the other. Its watchdog counts
    the rig's time.
    """

    def __init__(self, config: ModbusConfig, low: float, high: float) -> None:
        self.layout = layout(config)
        self.setpoint = 0.0
        self.value = 0.0
        self.status = DeviceStatus.READY
        self.silent = False  # a fault: requests get no answer
        self._limits = (low, high)
        self._read_table = config.read_table
        self._watchdog_ns = round(config.watchdog_s * 1e9)
        self._writes = 0
        self._writes_seen = 0
        self._silent_ns: int | None = None  # since it was written; None before, and once dropped
        self._words: dict[int, int] = dict.fromkeys(_span(self.layout.setpoint), 0)

    @property
    def setpoint_addresses(self) -> range:
        """Return the holding registers that the host may write."""
        return _span(self.layout.setpoint)

    def words(self, table: str) -> dict[int, int]:
        """Return what every register of `table` ("holding", "input") reads now, by address."""
        parts = self.layout
        words = dict(self._words) if table == "holding" else {}
        if table != self._read_table:
            return words
        words[parts.status.address] = parts.status_word(self.status)
        words.update(zip(_span(parts.value), parts.value.encode(self.value), strict=True))
        return words

    def write(self, address: int, values: list[int]) -> bool:
        """Take registers written by the host; False if the set-point would be out of range."""
        words = dict(self._words)
        words.update(zip(range(address, address + len(values)), values, strict=True))
        target = self.layout.setpoint
        setpoint = target.decode([words[at] for at in _span(target)])
        tolerance = target.scale / 2
        if not self._limits[0] - tolerance <= setpoint <= self._limits[1] + tolerance:
            return False
        self._words = words
        self._writes += 1
        self.setpoint = setpoint
        return True

    def elapse(self, time_ns: int) -> None:
        """Let time pass; a set-point not written for the watchdog's time drops to 0."""
        if self._writes != self._writes_seen:
            self._writes_seen, self._silent_ns = self._writes, 0
        if not self._watchdog_ns or self._silent_ns is None:
            return
        self._silent_ns += time_ns
        if self._silent_ns < self._watchdog_ns:
            return
        self._silent_ns = None
        self._words = dict.fromkeys(self._words, 0)
        self.setpoint = 0.0

    def measure(self, value: float, status: DeviceStatus = DeviceStatus.READY) -> None:
        """Set what the device reads back."""
        self.value = value if math.isfinite(value) else 0.0
        self.status = status


class ReadOnlyRegisters:
    """Registers of one unit with temperatures and DC power of the rig, for slow channels.

    `quantities` returns them by name; a channel's value is offset + scale times its register.
    """

    silent = False
    setpoint_addresses = range(0)

    def __init__(
        self, channels: Sequence[ChannelConfig], quantities: Callable[[], Mapping[str, float]]
    ) -> None:
        self._quantities = quantities
        self._cells: list[tuple[str, str, Register, float]] = []
        for channel in channels:
            source = channel.source
            if isinstance(source, ModbusSource) and source.emulated is not None:
                register = Register(source.address, source.kind, channel.scale, source.word_order)
                self._cells.append((source.table, source.emulated, register, channel.offset))

    def words(self, table: str) -> dict[int, int]:
        """Return what every register of `table` reads now, by address."""
        values = self._quantities()
        words: dict[int, int] = {}
        for where, quantity, register, offset in self._cells:
            if where == table:
                encoded = register.encode(values[quantity] - offset)
                words.update(zip(_span(register), encoded, strict=True))
        return words

    def write(self, address: int, values: list[int]) -> bool:
        """Refuse."""
        return False


def _span(register: Register) -> range:
    return range(register.address, register.address + register.words)
