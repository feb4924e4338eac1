"""The slow devices over Modbus, TCP or RTU: eddy-current brake and external drive.

One exchange is a write of the set-point and a read of set-point, status and value. A device that
does not answer costs one `timeout_s` and raises. An answer that comes late is never taken for the
answer to a later question: over TCP the connection is dropped and made anew by the next exchange;
on a serial line, whose frames have no numbers, each exchange begins with a write, whose answer no
read can have, and what arrives before that is passed over.
"""

import math
import termios
from contextlib import suppress

from motord.config import Config, ModbusConfig
from motord.hal.base import DeviceError, DeviceReading
from motord.hal.modbus.link import ModbusLink, connect
from motord.wire.modbus.pdu import ModbusException, ModbusRequest, read, write
from motord.wire.modbus.registers import Register, layout

EXCEPTION_NAMES = {
    1: "illegal function",
    2: "no such register",
    3: "value not accepted",
    4: "device failure",
    5: "accepted, but still busy",
    6: "busy",
    10: "no path to the unit",
    11: "no such unit",
}


class ModbusDevice:
    """A `SetpointDevice` whose set-point, within `low` to `high`, lies in a holding register.

    A set-point that is not finite is written as zero.
    """

    def __init__(self, name: str, config: ModbusConfig, low: float, high: float) -> None:
        self._name = name
        self._config = config
        self._low = low
        self._high = high
        self._layout = layout(config)
        self._link: ModbusLink | None = None

    def open(self) -> None:
        """Connect and read the device once. Raises DeviceError."""
        self._read(self._layout.status, self._config.read_table)

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
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _write(self, setpoint: float) -> None:
        limited = min(max(setpoint, self._low), self._high) if math.isfinite(setpoint) else 0.0
        target = self._layout.setpoint
        self._exchange(
            f"write of register {target.address}", write(target.address, target.encode(limited))
        )

    def _read(self, register: Register, table: str) -> list[int]:
        request = read(table, register.address, register.words)
        return self._exchange(f"read of {table} register {register.address}", request)

    def _exchange(self, what: str, request: ModbusRequest) -> list[int]:
        if self._link is None:
            self._link = self._connect()
        try:
            response = self._link.exchange(self._config.unit, request)
        except TimeoutError as error:
            self.close()
            received = f", only {error}" if str(error) else ""
            raise self._error(
                f"{what}: no valid answer within {self._config.timeout_s:g} s{received}; "
                "is the device on, and is unit right?"
            ) from None
        except ValueError as error:
            self.close()
            raise self._error(f"{what}: {error}") from None
        except OSError as error:
            self.close()
            raise self._error(f"{what}: connection lost") from error
        if isinstance(response, ModbusException):
            name = EXCEPTION_NAMES.get(response.code, "unknown cause")
            raise self._error(f"{what}: device answers exception {response.code} ({name})")
        return response

    def _connect(self) -> ModbusLink:
        config = self._config
        try:
            return connect(config)
        except ConnectionRefusedError:
            raise self._error("refused: nothing listens there; is the device on?") from None
        except TimeoutError:
            raise self._error(f"no connection within {config.timeout_s:g} s") from None
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            reason = getattr(error, "strerror", None) or str(error)
            how = "connect" if config.transport == "tcp" else "open it"
            raise self._error(f"cannot {how}: {reason}") from error

    def _error(self, what: str) -> DeviceError:
        config = self._config
        return DeviceError(f"[{self._name}.modbus] {config.place} unit {config.unit}: {what}")


def brake(config: Config) -> ModbusDevice:
    """Return the brake of a bench, excitation 0 to 1."""
    assert config.brake.modbus is not None  # a rule of the bench file
    return ModbusDevice("brake", config.brake.modbus, 0.0, 1.0)


def drive(config: Config) -> ModbusDevice:
    """Return the external drive of a bench, rad/s."""
    assert config.drive.modbus is not None  # a rule of the bench file
    fastest_rad_s = config.drive.speed_max_rad_s
    return ModbusDevice("drive", config.drive.modbus, -fastest_rad_s, fastest_rad_s)
