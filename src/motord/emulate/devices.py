"""What the emulated devices do, without I/O: commands, timeouts, registers.

All times are monotonic nanoseconds, handed in; nothing here reads a clock.
"""

import math

from motord.config import ModbusConfig
from motord.wire.registers import DeviceStatus, Register, layout


class RegisterDevice:
    """The registers of a brake or a drive: one set-point in, status and one value out.

    The Modbus server's thread writes, the emulator's loop reads `setpoint` and sets `value` and
    `status`; each is a single attribute, so neither has to wait for the other.
    """

    def __init__(self, config: ModbusConfig, low: float, high: float) -> None:
        self.layout = layout(config)
        self.setpoint = 0.0
        self.value = 0.0
        self.status = DeviceStatus.READY
        self.watchdog_drops = 0
        self._limits = (low, high)
        self._read_table = config.read_table
        self._watchdog_ns = round(config.watchdog_s * 1e9)
        self._heard_ns: int | None = None
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

    def write(self, address: int, values: list[int], now_ns: int) -> bool:
        """Take registers written by the host; False if the set-point would be out of range."""
        words = dict(self._words)
        words.update(zip(range(address, address + len(values)), values, strict=True))
        target = self.layout.setpoint
        setpoint = target.decode([words[at] for at in _span(target)])
        tolerance = target.scale / 2
        if not self._limits[0] - tolerance <= setpoint <= self._limits[1] + tolerance:
            return False
        self._words = words
        self._heard_ns = now_ns
        self.setpoint = setpoint
        return True

    def expire(self, now_ns: int) -> None:
        """Drop the set-point to zero if the watchdog is on and the host has been silent."""
        heard_ns = self._heard_ns
        if not self._watchdog_ns or heard_ns is None or now_ns - heard_ns < self._watchdog_ns:
            return
        self._heard_ns = None
        self._words = dict.fromkeys(self._words, 0)
        self.watchdog_drops += self.setpoint != 0.0
        self.setpoint = 0.0

    def measure(self, value: float, status: DeviceStatus = DeviceStatus.READY) -> None:
        """Set what the device reads back."""
        self.value = value if math.isfinite(value) else 0.0
        self.status = status


def _span(register: Register) -> range:
    return range(register.address, register.address + register.words)
