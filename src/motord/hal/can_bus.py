"""Opening a CAN bus with any interface of python-can."""

import logging

import can

from motord.config import CanConfig
from motord.hal.base import DeviceError

# python-can tells its own log of errors that it also raises
logging.getLogger("can").addHandler(logging.NullHandler())


def open_bus(config: CanConfig, device: str) -> can.BusABC:
    """Open the bus of `[inverter.can]`; `device` is whom errors name. Raises DeviceError."""
    settings: dict[str, object] = {"fd": config.fd, **config.options}
    if config.bitrate is not None:
        settings["bitrate"] = config.bitrate
    if config.data_bitrate is not None:
        settings["data_bitrate"] = config.data_bitrate
    try:
        return can.Bus(
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


def _hint(config: CanConfig) -> str:
    if config.interface == "socketcan":
        return f"bring it up: ip link set {config.channel} up type can bitrate ..."
    if config.interface == "udp_multicast":
        return "a multicast group needs a route: ip route add 224.0.0.0/4 dev lo"
    return "are interface, channel and options in [inverter.can] right?"
