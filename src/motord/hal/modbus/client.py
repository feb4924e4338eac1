"""Requests to Modbus devices over one link, made when it is needed, and anew after a fault.

What goes wrong is a `DeviceError` that names place, unit, request and what to do.
"""

import errno
import socket
import termios
import time

from motord.config import ModbusLinkConfig
from motord.hal.base import DeviceError, DeviceNotReadyError
from motord.hal.modbus.link import ModbusLink, connect
from motord.hal.port_obstacle import port_obstacle
from motord.wire.modbus.pdu import ModbusException, ModbusRequest

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
BUSY = frozenset({5, 6, 10, 11})
"""Exceptions that a device, or the gateway before it, may answer with while it starts."""
ABSENT = frozenset(
    {
        *(errno.EHOSTUNREACH, errno.EHOSTDOWN, errno.ENETUNREACH, errno.ENETDOWN),
        *(errno.ECONNRESET, errno.ECONNABORTED, socket.EAI_AGAIN),
    }
)
"""Why there is no connection to a device that may still come: of the network, of name servers."""


class ModbusClient:
    """A link to the device of `config`, or to the units behind it; `label` begins its errors."""

    def __init__(self, config: ModbusLinkConfig, label: str) -> None:
        self._config = config
        self._label = label
        self._link: ModbusLink | None = None
        self._host = ""  # once it is reached: a name server may take longer than timeout_s

    def exchange(self, what: str, request: ModbusRequest, unit: int | None = None) -> list[int]:
        """Return the registers that were read; waits at most `timeout_s`. Raises DeviceError.

        `what` names the request; `unit`: by default that of the settings. Nothing is sent if a name
        server took longer: a set-point would be an old one by then. The error is a
        DeviceNotReadyError if the device may still be starting.
        """
        unit = self._config.unit if unit is None else unit
        if self._link is None:
            self._link = self._connect(unit)
        try:
            response = self._link.exchange(unit, request)
        except TimeoutError as error:
            self.close()
            received = f", only {error}" if str(error) else ""
            raise self._not_ready(
                unit,
                f"{what}: no valid answer within {self._config.timeout_s:g} s{received}; "
                "is the device on, and is unit right?",
            ) from None
        except ValueError as error:
            self.close()
            raise self._error(unit, f"{what}: {error}") from None
        except OSError as error:
            self.close()
            raise self._not_ready(unit, f"{what}: connection lost") from error
        if isinstance(response, ModbusException):
            name = EXCEPTION_NAMES.get(response.code, "unknown cause")
            failure = self._not_ready if response.code in BUSY else self._error
            raise failure(unit, f"{what}: device answers exception {response.code} ({name})")
        return response

    def close(self) -> None:
        """Disconnect; may be called twice."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _connect(self, unit: int) -> ModbusLink:
        config, begun_s = self._config, time.monotonic()
        host, self._host = self._host, ""  # not reached: the name may stand for another one now
        try:
            link = connect(config, host)
        except ConnectionRefusedError:
            why = "refused: nothing listens there; is the device on?"
            raise self._not_ready(unit, why) from None
        except TimeoutError:
            raise self._late(unit) from None
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            if config.transport == "rtu":
                why = port_obstacle(error, "device", "serial_port")
                raise self._error(unit, f"cannot open it: {why}") from error
            absent = getattr(error, "errno", None) in ABSENT
            failure = self._not_ready if absent else self._error
            reason = getattr(error, "strerror", None) or str(error)
            raise failure(unit, f"cannot connect: {reason}") from error
        self._host = link.host
        looked_up = link.host not in (host, config.host)
        if looked_up and time.monotonic() - begun_s > config.timeout_s:
            link.close()
            raise self._late(unit)
        return link

    def _late(self, unit: int) -> DeviceNotReadyError:
        return self._not_ready(unit, f"no connection within {self._config.timeout_s:g} s")

    def _error(self, unit: int, what: str) -> DeviceError:
        return DeviceError(self._message(unit, what))

    def _not_ready(self, unit: int, what: str) -> DeviceNotReadyError:
        return DeviceNotReadyError(self._message(unit, what))

    def _message(self, unit: int, what: str) -> str:
        return f"{self._label}{self._config.place} unit {unit}: {what}"
