"""The slow devices over Modbus, TCP or RTU: eddy-current brake and external drive.

One exchange is a write of the set-point and a read of set-point, status and value. A device that
does not answer costs one `timeout_s` and raises; the connection is then dropped and made anew by
the next exchange, so that no late answer is ever taken for the answer to a later question.
"""

import logging
import math
import socket
import termios
from collections.abc import Callable, Sequence
from contextlib import suppress

import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException, ModbusIOException
from pymodbus.pdu import ModbusPDU

from motord.config import Config, ModbusConfig
from motord.hal.base import DeviceError, DeviceReading
from motord.wire.registers import Register, layout

# pymodbus tells its own log of every error that it also raises; here they become DeviceError
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

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


_Client = ModbusTcpClient | ModbusSerialClient


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
        self._client: _Client | None = None

    def open(self) -> None:
        """Connect and read the device once. Raises DeviceError."""
        self._read(self._connected(), self._layout.status, self._config.read_table)

    def exchange(self, setpoint: float) -> DeviceReading:
        """Write the set-point, read the device back. Raises DeviceError.

        Each request waits at most `timeout_s`; the first that fails ends the exchange.
        """
        client, table, parts = self._connected(), self._config.read_table, self._layout
        self._write(client, setpoint)
        actual = parts.setpoint.decode(self._read(client, parts.setpoint, "holding"))
        word = self._read(client, parts.status, table)[0]
        value = parts.value.decode(self._read(client, parts.value, table))
        return DeviceReading(int(parts.understand(word)), actual, value)

    def safe_stop(self) -> None:
        """Write a set-point of zero, if the device can be reached."""
        with suppress(DeviceError):
            self._write(self._connected(), 0.0)

    def close(self) -> None:
        """Disconnect; may be called twice."""
        client, self._client = self._client, None
        if client is not None:
            client.close()  # type: ignore[no-untyped-call]

    def _connected(self) -> _Client:
        if self._client is None:
            tcp = self._config.transport == "tcp"
            self._client = self._tcp_client() if tcp else self._rtu_client()
        return self._client

    def _tcp_client(self) -> ModbusTcpClient:
        config = self._config
        client = ModbusTcpClient(
            config.host, port=config.tcp_port, timeout=config.timeout_s, retries=0
        )
        try:
            client.socket = socket.create_connection(
                (config.host, config.tcp_port), timeout=config.timeout_s
            )
        except ConnectionRefusedError:
            raise self._error("refused: nothing listens there; is the device on?") from None
        except TimeoutError:
            raise self._error(f"no connection within {config.timeout_s:g} s") from None
        except OSError as error:
            raise self._error(f"cannot connect: {error.strerror or error}") from error
        client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return client

    def _rtu_client(self) -> ModbusSerialClient:
        config = self._config
        client = ModbusSerialClient(
            config.serial_port,
            baudrate=config.baud,
            parity=config.parity,
            stopbits=config.stop_bits,
            timeout=config.timeout_s,
            retries=0,
        )
        try:
            client.socket = serial.Serial(
                config.serial_port,
                baudrate=config.baud,
                parity=config.parity,
                stopbits=config.stop_bits,
                timeout=config.timeout_s,
                write_timeout=config.timeout_s,
                exclusive=True,
            )
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            reason = getattr(error, "strerror", None) or str(error)
            raise self._error(f"cannot open it: {reason}") from error
        return client

    def _write(self, client: _Client, setpoint: float) -> None:
        limited = min(max(setpoint, self._low), self._high) if math.isfinite(setpoint) else 0.0
        target, unit = self._layout.setpoint, self._config.unit
        words = target.encode(limited)
        if len(words) == 1:
            self._ask(
                f"write of register {target.address}",
                lambda: client.write_register(target.address, words[0], device_id=unit),
            )
        else:
            self._ask(
                f"write of register {target.address}",
                lambda: client.write_registers(target.address, words, device_id=unit),
            )

    def _read(self, client: _Client, register: Register, table: str) -> Sequence[int]:
        address, words, unit = register.address, register.words, self._config.unit
        if table == "holding":
            answer = self._ask(
                f"read of holding register {address}",
                lambda: client.read_holding_registers(address, count=words, device_id=unit),
            )
        else:
            answer = self._ask(
                f"read of input register {address}",
                lambda: client.read_input_registers(address, count=words, device_id=unit),
            )
        if len(answer.registers) != words:
            self.close()
            raise self._error(f"read of register {address}: answer of a wrong length")
        return answer.registers

    def _ask(self, what: str, request: Callable[[], ModbusPDU]) -> ModbusPDU:
        try:
            answer = request()
        except ModbusIOException:
            self.close()
            raise self._error(
                f"{what}: no valid answer within {self._config.timeout_s:g} s; "
                "is the device on, and is unit right?"
            ) from None
        except (ModbusException, OSError) as error:
            self.close()
            raise self._error(f"{what}: connection lost") from error
        if answer.isError():
            name = EXCEPTION_NAMES.get(answer.exception_code, "unknown cause")
            raise self._error(f"{what}: device answers exception {answer.exception_code} ({name})")
        return answer

    def _error(self, what: str) -> DeviceError:
        config = self._config
        place = (
            f"{config.host}:{config.tcp_port}" if config.transport == "tcp" else config.serial_port
        )
        return DeviceError(f"[{self._name}.modbus] {place} unit {config.unit}: {what}")


def brake(config: Config) -> ModbusDevice:
    """Return the brake of a bench, excitation 0 to 1. Raises DeviceError without a Modbus table."""
    return ModbusDevice("brake", _table("brake", config.brake.modbus), 0.0, 1.0)


def drive(config: Config) -> ModbusDevice:
    """Return the external drive of a bench, rad/s. Raises DeviceError without a Modbus table."""
    fastest = config.drive.speed_max_rad_s
    return ModbusDevice("drive", _table("drive", config.drive.modbus), -fastest, fastest)


def _table(name: str, table: ModbusConfig | None) -> ModbusConfig:
    if table is None:
        raise DeviceError(f"[{name}]: its Modbus driver needs a table [{name}.modbus]")
    return table
