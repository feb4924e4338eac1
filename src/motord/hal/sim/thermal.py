"""Channels of the simulated bench: temperatures and DC power, from the currents of the ticks.

The rig is simulated in the loop; here its thermal network is heated by the currents that it
reports, and its power follows from these and the voltages.
"""

from collections.abc import Callable

import numpy as np

from motord.config import Config
from motord.config.channel_sources import SimulatedSource
from motord.hal.channel_source import RawSample
from motord.rig.energy.thermal import ThermalNetwork
from motord.rig.truth import RigTruth, load
from motord.schema import InverterStatus

Ticks = Callable[[], np.ndarray]
"""Returns the ticks since its last call, TICK_DTYPE (n,)."""


def dc_power_W(
    truth: RigTruth, u_V: np.ndarray, sensed_A: np.ndarray, inverter_on: np.ndarray
) -> np.ndarray:
    """Return the power (n,) of voltages and sensed currents (n, 3); inverter_on (n,): bool.

    What flows follows from the gains and offsets of the current sensors, as they are when cold.
    """
    inverter = truth.inverter
    i_A = sensed_A * np.asarray(inverter.alpha) * inverter.epsilon + np.asarray(inverter.beta_A)
    loss_W = inverter.fixed_loss_W + (
        inverter.loss_V * np.abs(i_A) + inverter.loss_ohm * i_A**2
    ).sum(axis=1)
    return np.asarray(np.where(inverter_on, (u_V * i_A).sum(axis=1) + loss_W, 0.0))


class HeatedMotor:
    """The motor that all simulated channels look at."""

    def __init__(self, config: Config, ticks: Ticks) -> None:
        self.truth = load(config.bench.rig)
        self.network = ThermalNetwork(self.truth)
        self.energy_J = self.seconds_s = 0.0
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
                self.energy_J += float(self._powers_W(block).sum()) * self._period_s
                self.seconds_s += len(block) * self._period_s

    def _powers_W(self, block: np.ndarray) -> np.ndarray:
        """Return the DC power (n,) of ticks."""
        u_V, i_A = (
            np.stack([block[f"{name}_{phase}_{unit}"].astype(float) for phase in "abc"], axis=1)
            for name, unit in (("u", "V"), ("i", "A"))
        )
        on = (block["inverter_status"] & InverterStatus.READY) != 0
        return dc_power_W(self.truth, u_V, i_A, on)


class SimulatedChannel:
    """A temperature of the simulated rig, or the mean of its DC power since the reading before."""

    def __init__(self, source: SimulatedSource, motor: HeatedMotor) -> None:
        self._quantity = source.quantity
        self._motor = motor
        self._before = (0.0, 0.0)

    def open(self) -> None:
        """Do nothing."""

    def read(self) -> RawSample | None:
        """Return the temperature now, degC, or the power, W; None without new ticks.

        Before the first tick nothing flows: 0 W.
        """
        self._motor.follow()
        if self._quantity == "dc_power_W":
            return self._power()
        return RawSample(self._motor.network.named_C[self._quantity])

    def _power(self) -> RawSample | None:
        before_J, before_s = self._before
        seconds_s = self._motor.seconds_s - before_s
        if not seconds_s > 0:
            return RawSample(0.0) if self._motor.seconds_s == 0.0 else None
        self._before = (self._motor.energy_J, self._motor.seconds_s)
        return RawSample((self._motor.energy_J - before_J) / seconds_s)

    def close(self) -> None:
        """Do nothing."""
