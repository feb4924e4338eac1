"""Channels of the simulated bench: the rig's thermal network, heated by the currents of the ticks.

The rig is simulated in the loop; here its temperatures follow from the currents that it reports.
"""

from collections.abc import Callable, Sequence

import numpy as np

from motord.config import Config
from motord.config.channel_sources import SimulatedSource
from motord.hal.channels.base import Sample
from motord.rig.thermal import ThermalNetwork
from motord.rig.truth import load

Ticks = Callable[[], np.ndarray]
"""Returns the ticks since its last call, TICK_DTYPE (n,)."""


class _HeatedMotor:
    """The motor that all simulated channels look at."""

    def __init__(self, config: Config, ticks: Ticks) -> None:
        self.network = ThermalNetwork(load(config.bench.rig))
        self._period_s = 1.0 / config.loop.rate_Hz
        self._ticks = ticks

    def follow(self) -> None:
        """Let the time of the ticks pass that have come."""
        while len(block := self._ticks()):
            squares_A2 = sum(
                float(np.square(block[f"i_{phase}_A"], dtype=float).mean()) for phase in "abc"
            )
            if np.isfinite(squares_A2):
                self.network.advance(squares_A2, len(block) * self._period_s)


class SimulatedChannel:
    """A temperature of the simulated rig."""

    def __init__(self, source: SimulatedSource, motor: _HeatedMotor) -> None:
        self._quantity = source.quantity
        self._motor = motor

    def open(self) -> None:
        """Do nothing."""

    def read(self) -> Sample:
        """Return the temperature now, degC."""
        self._motor.follow()
        return Sample(self._motor.network.named_C[self._quantity])

    def close(self) -> None:
        """Do nothing."""


def simulated_channels(
    sources: Sequence[SimulatedSource], config: Config, ticks: Ticks
) -> list[SimulatedChannel]:
    """Return the channels of a simulated bench. Raises ConfigError for a rig file that is wrong."""
    motor = _HeatedMotor(config, ticks)
    return [SimulatedChannel(source, motor) for source in sources]
