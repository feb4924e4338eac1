"""A channel of any interface of python-can, opened: for drivers and for emulated devices."""

import logging
import os
import socket
from contextlib import suppress

from motord.config import CanBusConfig
from motord.python_can import can
from motord.wire.can.frame_format import EXTENDED

# python-can writes errors to its own log that it also raises
logging.getLogger("can").addHandler(logging.NullHandler())

RECEIVE_BUFFER_BYTES = 1 << 20
"""Asked of the kernel, so that a process that was kept waiting loses no frames; it grants at most
net.core.rmem_max."""


def interface_options(config: CanBusConfig) -> dict[str, object]:
    """Return what python-can's interface is opened with."""
    rates = {"bitrate": config.bitrate, "data_bitrate": config.data_bitrate}
    given = {name: rate for name, rate in rates.items() if rate is not None}
    return {"fd": config.fd, **config.options, **given}


def open_interface(config: CanBusConfig) -> can.BusABC:
    """Open the channel with a large receive buffer. Raises OSError, the reason in `strerror`."""
    try:
        bus = can.Bus(
            config.channel,
            config.interface,
            ignore_config=True,
            **interface_options(config),  # type: ignore[arg-type]
        )
    except (
        can.CanError,
        OSError,
        ValueError,
        TypeError,
        ImportError,
        RuntimeError,  # NotImplementedError: an interface that python-can does not know
    ) as error:
        cause = error.__cause__ or error
        reason = getattr(cause, "strerror", None) or str(cause)
        raise OSError(getattr(cause, "errno", None) or 0, reason) from error
    widen_receive_buffer(bus)
    return bus


def opening_hint(config: CanBusConfig) -> str:
    """Return what to do about a channel that cannot be opened."""
    if config.interface == "socketcan":
        rates = "bitrate ... dbitrate ... fd on" if config.fd else "bitrate ..."
        return f"bring it up: ip link set {config.channel} up type can {rates}"
    if config.interface == "udp_multicast":
        return "a multicast group needs a route: ip route add 224.0.0.0/4 dev lo"
    return "are its interface, channel and options right?"


def widen_receive_buffer(bus: can.BusABC) -> None:
    """Ask for RECEIVE_BUFFER_BYTES, if the bus is a socket."""
    try:
        descriptor = os.dup(bus.fileno())
    except (NotImplementedError, OSError):
        return
    try:
        end = socket.socket(fileno=descriptor)
    except OSError:  # a descriptor, but no socket: a serial adapter
        os.close(descriptor)
        return
    with end, suppress(OSError):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


def new_message(key: int, *, fd: bool, data: bytes = b"") -> can.Message:
    """Return a frame to be sent; of CAN FD with the higher bit rate for its data."""
    return can.Message(
        arbitration_id=key & ~EXTENDED,
        is_extended_id=key >= EXTENDED,
        is_fd=fd,
        bitrate_switch=fd,
        data=data,
    )
