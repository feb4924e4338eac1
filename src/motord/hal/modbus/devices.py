"""The slow devices over Modbus, TCP or RTU: eddy-current brake and external drive.

One exchange is a write of the set-point and a read of set-point, status and value. A device that
does not answer costs one `timeout_s` and raises. An answer that comes late is never taken for the
answer to a later question: over TCP the connection is dropped and made anew by the next exchange;
on a serial line, whose frames have no numbers, each exchange begins with a write, whose answer no
read can have, and what arrives before that is passed over.
"""

import math
import time
from contextlib import suppress

from motord.config import Config, ModbusConfig
from motord.hal.base import DeviceError, DeviceNotReadyError, DeviceReading
from motord.hal.countdown import countdown_s
from motord.hal.modbus.client import ModbusClient
from motord.wire.modbus.pdu import read, write
from motord.wire.modbus.registers import Register, layout

_RETRY_S = 0.1
"""Pause between attempts to reach a device that does not answer yet."""


class ModbusDevice:
    """A `SetpointDevice` whose set-point, within `low` to `high`, lies in a holding register.

    A set-point that is not finite is written as zero.
    """

    def __init__(self, name: str, config: ModbusConfig, low: float, high: float) -> None:
        self._config = config
        self._low = low
        self._high = high
        self._layout = layout(config)
        self._client = ModbusClient(config, f"[{name}.modbus] ")

    def open(self) -> None:
        """Connect and read the device once. Raises DeviceError.

        One that is not ready has `connect_timeout_s` to become so.
        """
        for left_s in countdown_s(self._config.connect_timeout_s):
            try:
                self._read(self._layout.status, self._config.read_table)
            except DeviceNotReadyError:
                if not left_s:
                    raise
                time.sleep(min(_RETRY_S, left_s))
            else:
                return

    def exchange(self, setpoint: float) -> DeviceReading:
        """Write the set-point, read the device back. Raises DeviceError.

        Each request waits at most `timeout_s`; the first that fails ends the exchange.
        """
        table, parts = self._config.read_table, self._layout
        self._write(setpoint)
        actual = parts.setpoint.decode(self._read(parts.setpoint, "holding"))
        word = self._read(parts.status, table)[0]
        value = parts.value.decode(self._read(parts.value, table))
        return DeviceReading(int(parts.decode_status(word)), actual, value)

    def safe_stop(self) -> None:
        """Write a set-point of zero, if the device can be reached; over a new link if need be."""
        for _ in range(2):
            with suppress(DeviceError):
                self._write(0.0)
                return

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._client.close()

    def _write(self, setpoint: float) -> None:
        limited = min(max(setpoint, self._low), self._high) if math.isfinite(setpoint) else 0.0
        target = self._layout.setpoint
        self._client.exchange(
            f"write of register {target.address}", write(target.address, target.encode(limited))
        )

    def _read(self, register: Register, table: str) -> list[int]:
        request = read(table, register.address, register.words)
        return self._client.exchange(f"read of {table} register {register.address}", request)


def brake(config: Config) -> ModbusDevice:
    """Return the brake of a bench, excitation 0 to 1."""
    assert config.brake.modbus is not None  # a rule of the bench file
    return ModbusDevice("brake", config.brake.modbus, 0.0, 1.0)


def drive(config: Config) -> ModbusDevice:
    """Return the external drive of a bench, rad/s."""
    assert config.drive.modbus is not None  # a rule of the bench file
    least_rad_s, most_rad_s = config.drive.speed_min_rad_s, config.drive.speed_max_rad_s
    return ModbusDevice("drive", config.drive.modbus, least_rad_s, most_rad_s)
