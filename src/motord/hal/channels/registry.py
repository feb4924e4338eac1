"""Which source a channel's `driver` stands for; imported only when it is used."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import Any, cast

import numpy as np

from motord.config import ChannelConfig, Config, ConfigError
from motord.config.channel_sources import OWN, OtherSource
from motord.config.driver_names import CHANNELS
from motord.hal.base import DeviceError
from motord.hal.channel_source import ChannelSource, RawSample
from motord.schema import TICK_DTYPE

Ticks = Callable[[], np.ndarray]
Sources = list[tuple[ChannelConfig, ChannelSource]]


class BrokenSource:
    """Stands for a source that cannot be made; says why whenever it is opened."""

    def __init__(self, error: str) -> None:
        self._error = error

    def open(self) -> None:
        """Raise DeviceError."""
        raise DeviceError(self._error)

    def read(self) -> RawSample | None:
        """Return nothing."""
        return None

    def close(self) -> None:
        """Do nothing."""


def check_drivers(channels: Sequence[ChannelConfig]) -> None:
    """Raise DeviceError if no package brings the driver of a channel."""
    for number, channel in enumerate(channels):
        name = channel.source.driver
        if isinstance(channel.source, OtherSource) and not entry_points(group=CHANNELS, name=name):
            others = sorted(entry.name for entry in entry_points(group=CHANNELS))
            raise DeviceError(
                f'{channel.place(number)}: driver = "{name}" is not known; known: '
                f"{', '.join([*OWN, *others])}"
            )


def no_ticks() -> np.ndarray:
    """Return no ticks, where no loop runs."""
    return np.empty(0, TICK_DTYPE)


def make_lines(config: Config, ticks: Ticks = no_ticks) -> list[Sources]:
    """Return all channels with their sources, not yet open; those of a list share a line.

    `ticks` returns those since its last call, TICK_DTYPE (n,): they heat a simulated motor.
    """
    lines: dict[tuple[str, ...], list[ChannelConfig]] = defaultdict(list)
    for channel in config.channels:
        lines[channel.source.line or ("", channel.name)].append(channel)
    return [_sources(channels, config, ticks) for channels in lines.values()]


def _sources(channels: list[ChannelConfig], config: Config, ticks: Ticks) -> Sources:
    """Return the sources of a line; one that cannot be made is a BrokenSource."""
    try:
        makers = _makers(channels, config, ticks)
    except ConfigError as error:
        return [(channel, BrokenSource(str(error))) for channel in channels]
    return [(channel, _made(make)) for channel, make in zip(channels, makers, strict=True)]


def _made(make: Callable[[], ChannelSource]) -> ChannelSource:
    try:
        return make()
    except (ConfigError, DeviceError) as error:
        return BrokenSource(str(error))
    except Exception as error:  # of a driver: the other channels must still be read
        return BrokenSource(f"its driver cannot be made: {type(error).__name__}: {error}")


def _makers(
    channels: list[ChannelConfig], config: Config, ticks: Ticks
) -> list[Callable[[], ChannelSource]]:
    """Return what makes the source of each channel of a line. Raises ConfigError."""
    settings: list[Any] = [channel.source for channel in channels]
    match settings[0].driver:
        case "modbus":
            from motord.hal.channels.modbus import ModbusChannel
            from motord.hal.modbus.client import ModbusClient

            client = ModbusClient(settings[0], "")
            return [partial(ModbusChannel, source, client) for source in settings]
        case "can":
            from motord.hal.channels.can import CanChannel, ListeningPort

            bus = settings[0].bus or config.inverter.can
            assert bus is not None  # a rule of the bench file
            listening = ListeningPort(bus)
            return [partial(CanChannel, one, listening) for one in channels]
        case "serial":
            from motord.hal.channels.text import TextChannel, TextPort

            port = TextPort(settings[0])
            return [partial(TextChannel, source, port) for source in settings]
        case "simulated":
            from motord.hal.sim.thermal import HeatedMotor, SimulatedChannel

            motor = HeatedMotor(config, ticks)
            return [partial(SimulatedChannel, source, motor) for source in settings]
    return [partial(_of_another_package, channel) for channel in channels]


def _of_another_package(channel: ChannelConfig) -> ChannelSource:
    check_drivers([channel])
    entry = next(iter(entry_points(group=CHANNELS, name=channel.source.driver)))
    return cast("ChannelSource", resolve_name(entry.value)(channel))
