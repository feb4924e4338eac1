"""Opening a CAN bus: SocketCAN by a socket of our own, any other interface by python-can."""

from motord.can_interface import opening_hint
from motord.config import CanBusConfig
from motord.hal.base import DeviceError
from motord.hal.can.base import CanBus
from motord.hal.can.python_can import open_python_can
from motord.hal.can.socketcan import open_socketcan
from motord.hal.port_obstacle import port_obstacle


def open_bus(config: CanBusConfig, device: str) -> CanBus:
    """Open a channel; `device` is whom errors name. Raises DeviceError.

    Each call opens it anew: on SocketCAN, and on interfaces of python-can that allow it, several
    drivers share a channel so.
    """
    try:
        if config.interface != "socketcan":
            return open_python_can(config)
        if config.options:
            known = ", ".join(config.options)
            raise DeviceError(f"{device}: the interface socketcan has no options, not {known}")
        return open_socketcan(config.channel, config.fd)
    except OSError as error:
        raise DeviceError(f"{device}: cannot open the bus: {_obstacle(config, error)}") from error


def _obstacle(config: CanBusConfig, error: OSError) -> str:
    """Return why a channel cannot be opened, and what to do; slcan's is a serial port, of which
    pyserial's error is the cause of python-can's, and that of `error`."""
    cause = error.__cause__ and error.__cause__.__cause__
    if config.interface == "slcan" and isinstance(cause, Exception):
        return port_obstacle(cause, "adapter", "channel")
    return f"{error.strerror or error}; {opening_hint(config)}"
