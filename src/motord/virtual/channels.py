"""Readings of the simulated slow channels, from the truth of ticks in virtual time."""

from collections.abc import Iterator, Sequence

import numpy as np

from motord.config import ChannelConfig
from motord.config.channel_sources import SimulatedSource
from motord.sequencing.observation import ChannelValue

Reading = tuple[int, ChannelConfig, float]
"""Time (Unix ns), channel, value."""


def channel_readings(channels: Sequence[ChannelConfig], truth: np.ndarray) -> Iterator[Reading]:
    """Yield what simulated channels read over `truth` (TRUTH_DTYPE), each in order of time.

    They read at whole multiples of their period: a temperature of the rig, or the mean of its DC
    power since the reading before, of which what begins with the block has none.
    """
    for channel in channels:
        if isinstance(channel.source, SimulatedSource):
            readings = _powers if channel.source.quantity == "dc_power_W" else _temperatures
            for t_ns, raw in zip(*readings(channel, channel.source.quantity, truth), strict=True):
                yield int(t_ns), channel, float(raw) * channel.scale + channel.offset


def newest(
    channels: Sequence[ChannelConfig], truth: np.ndarray, *, at_once: bool = False
) -> dict[str, ChannelValue]:
    """Return the newest temperatures that were read over `truth`, by the channel's name.

    at_once: those of its first tick, as of a bench whose channels have been read before.
    """
    thermometers = [
        (one, one.source.quantity)
        for one in channels
        if isinstance(one.source, SimulatedSource) and one.source.quantity != "dc_power_W"
    ]
    first = [
        (int(truth["t_ns"][0]), one, one.scale * float(truth[quantity][0]) + one.offset)
        for one, quantity in thermometers
    ]
    readings = first if at_once else channel_readings([one for one, _ in thermometers], truth)
    return {
        channel.name: ChannelValue(t_ns * 1e-9, value, of_motor=channel.role is not None)
        for t_ns, channel, value in readings
    }


def _powers(channel: ChannelConfig, _: str, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t_ns, energy_J = truth["t_ns"], truth["energy_dc_J"]
    at_ns = _reading_times(channel, int(t_ns[0]), int(t_ns[-1]))
    at_J = np.interp((at_ns - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, energy_J)
    return at_ns[1:], np.diff(at_J) / (round(channel.period_s * 1e9) * 1e-9)


def _temperatures(
    channel: ChannelConfig, quantity: str, truth: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    t_ns = truth["t_ns"]
    tick_ns = int(t_ns[1] - t_ns[0]) if t_ns.size > 1 else 1
    at_ns = _reading_times(channel, int(t_ns[0]) - tick_ns + 1, int(t_ns[-1]))
    return at_ns, np.interp((at_ns - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, truth[quantity])


def _reading_times(channel: ChannelConfig, from_ns: int, to_ns: int) -> np.ndarray:
    """Return the times within both ends at which a channel is read (n,), Unix ns."""
    period_ns = round(channel.period_s * 1e9)
    return np.arange(-(-from_ns // period_ns) * period_ns, to_ns + 1, period_ns)
