"""Opening a CAN bus with any interface of python-can."""

import logging
import os
import socket
from contextlib import suppress

import can

from motord.config import CanConfig
from motord.hal.base import DeviceError
from motord.hal.bulk_port import read_in_bulk

# python-can tells its own log of errors that it also raises
logging.getLogger("can").addHandler(logging.NullHandler())

RECEIVE_BUFFER_BYTES = 1 << 20
"""Asked of the kernel, so that a loop that was kept waiting loses no frames; it grants at most
net.core.rmem_max."""


def open_bus(config: CanConfig, device: str) -> can.BusABC:
    """Open the bus of `[inverter.can]`; `device` is whom errors name. Raises DeviceError."""
    settings: dict[str, object] = {"fd": config.fd, **config.options}
    if config.bitrate is not None:
        settings["bitrate"] = config.bitrate
    if config.data_bitrate is not None:
        settings["data_bitrate"] = config.data_bitrate
    try:
        bus = can.Bus(
            config.channel,
            config.interface,
            ignore_config=True,
            **settings,  # type: ignore[arg-type]
        )
    except (
        can.CanError,
        OSError,
        ValueError,
        TypeError,
        ImportError,
        NotImplementedError,  # an interface that python-can does not know
    ) as error:
        cause = error.__cause__ or error
        reason = getattr(cause, "strerror", None) or str(cause)
        raise DeviceError(f"{device}: cannot open the bus: {reason}; {_hint(config)}") from error
    _widen(bus)
    read_in_bulk(bus)
    return bus


def _widen(bus: can.BusABC) -> None:
    """Ask for a large receive buffer, if the bus is a socket."""
    try:
        fd = os.dup(bus.fileno())
    except (NotImplementedError, OSError):
        return
    try:
        end = socket.socket(fileno=fd)
    except OSError:  # a descriptor, but no socket: a serial adapter
        os.close(fd)
        return
    with end, suppress(OSError):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


def _hint(config: CanConfig) -> str:
    if config.interface == "socketcan":
        return f"bring it up: ip link set {config.channel} up type can bitrate ..."
    if config.interface == "udp_multicast":
        return "a multicast group needs a route: ip route add 224.0.0.0/4 dev lo"
    return "are interface, channel and options in [inverter.can] right?"
