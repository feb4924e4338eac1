"""Readings of the channel with the DC power, from the truth of ticks in virtual time."""

from collections.abc import Iterator, Sequence

import numpy as np

from motord.config import ChannelConfig
from motord.config.channel_sources import SimulatedSource

Reading = tuple[int, ChannelConfig, float]
"""Time (Unix ns), channel, value."""


def power_readings(channels: Sequence[ChannelConfig], truth: np.ndarray) -> Iterator[Reading]:
    """Yield what channels with the simulated DC power read over `truth` (TRUTH_DTYPE), in order.

    Each is the mean since the reading before, at whole multiples of the period; what begins with
    the block has none.
    """
    t_ns, energy_J = truth["t_ns"], truth["energy_dc_J"]
    for channel in channels:
        source = channel.source
        if not isinstance(source, SimulatedSource) or source.quantity != "dc_power_W":
            continue
        period_ns = round(channel.period_s * 1e9)
        at_ns = np.arange(-(-t_ns[0] // period_ns) * period_ns, t_ns[-1] + 1, period_ns)
        at_J = np.interp((at_ns - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, energy_J)
        powers_W = np.diff(at_J) / (period_ns * 1e-9)
        for one_ns, power_W in zip(at_ns[1:], powers_W, strict=True):
            yield int(one_ns), channel, float(power_W) * channel.scale + channel.offset
