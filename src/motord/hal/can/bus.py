"""Opening a CAN bus: SocketCAN by a socket of our own, any other interface by python-can."""

from motord.can_interface import opening_hint
from motord.config import CanBusConfig
from motord.hal.base import DeviceError
from motord.hal.can.base import CanBus
from motord.hal.can.python_can import open_python_can
from motord.hal.can.socketcan import open_socketcan


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
        reason = error.strerror or str(error)
        raise DeviceError(
            f"{device}: cannot open the bus: {reason}; {opening_hint(config)}"
        ) from error
