"""The torque-speed envelope of a bench: which torques and speeds it can hold.

Current, supply voltage and the machine that takes or gives the power set its limits. The voltage of
a winding is taken as |k_p w + R i_p|, without its inductance; in a star that between two phases.
"""

from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from motord.config import Config
from motord.experiments.torque_speed.settings import TorqueSpeedConfig
from motord.identification.least_loss import currents_per_Nm
from motord.sequencing import PlanError
from motord.sequencing.limits import check_brake, check_drive, check_speed, check_torque

ANGLES = 512
"""Angles of a turn, about, at which the voltage is looked at."""

HALVINGS = 24
"""Steps of the search for the largest torque."""


@dataclass(frozen=True)
class Envelope:
    """What a bench can hold with the settings of `[plans.torque-speed]`."""

    config: Config
    own: TorqueSpeedConfig

    def obstacle(self, torque_Nm: float, speed_Hz: float) -> str:
        """Return why the bench cannot hold a torque at a speed, "" if it can."""
        try:
            check_torque(self.config, torque_Nm)
            check_speed(self.config, speed_Hz)
            if torque_Nm * speed_Hz > 0:
                check_brake(self.config, torque_Nm, speed_Hz)
            else:
                check_drive(self.config, speed_Hz)
        except PlanError as error:
            return str(error)
        return self._beyond_power(torque_Nm, speed_Hz) or self._beyond_supply(torque_Nm, speed_Hz)

    def largest_Nm(self, torque_Nm: float, speed_Hz: float) -> float:
        """Return the largest torque of the sign of `torque_Nm` at a speed; 0 if there is none."""
        sign = 1.0 if torque_Nm > 0 else -1.0
        low_Nm, high_Nm = 0.0, self.config.limits.torque_Nm
        if not self.obstacle(sign * high_Nm, speed_Hz):
            return sign * high_Nm
        for _ in range(HALVINGS):
            middle_Nm = 0.5 * (low_Nm + high_Nm)
            if self.obstacle(sign * middle_Nm, speed_Hz):
                high_Nm = middle_Nm
            else:
                low_Nm = middle_Nm
        return sign * low_Nm

    def _beyond_power(self, torque_Nm: float, speed_Hz: float) -> str:
        if torque_Nm * speed_Hz < 0 and abs(torque_Nm) > self.own.drive_torque_Nm:
            return (
                f"generating {abs(torque_Nm):g} Nm is more than the external drive carries, "
                f"drive_torque_Nm = {self.own.drive_torque_Nm:g}"
            )
        power_W = 2 * pi * abs(torque_Nm * speed_Hz)
        if 0 < self.own.power_max_W < power_W:
            return f"{power_W:.3g} W is above power_max_W = {self.own.power_max_W:g}"
        return ""

    def _beyond_supply(self, torque_Nm: float, speed_Hz: float) -> str:
        limits, peak_A = self.config.limits, float(np.abs(self._per_Nm).max()) * abs(torque_Nm)
        most_A = min(limits.current_A, limits.i2t_current_A)
        if peak_A > most_A:
            return (
                f"{peak_A:.3g} A for {torque_Nm:g} Nm is more than may flow for long, [limits] "
                f"current_A and i2t_current_A: {most_A:g}"
            )
        voltage_V = self._voltage_V(torque_Nm, speed_Hz) if self.own.bus_V else 0.0
        if voltage_V > self.own.bus_V:
            return f"{voltage_V:.3g} V needed, bus_V = {self.own.bus_V:g}"
        return ""

    @cached_property
    def _back_emf(self) -> np.ndarray:
        table = self.config.motor.back_emf_table()
        return table[:: max(table.shape[0] // ANGLES, 1)]

    @cached_property
    def _per_Nm(self) -> np.ndarray:
        table = currents_per_Nm(self.config.motor)
        return table[:: max(table.shape[0] // ANGLES, 1)]

    def _voltage_V(self, torque_Nm: float, speed_Hz: float) -> float:
        across_V = 2 * pi * speed_Hz * self._back_emf
        across_V = across_V + self.own.resistance_ohm * torque_Nm * self._per_Nm
        if self.config.motor.connection == "star":
            return float(np.ptp(across_V, axis=1).max())
        return float(np.abs(across_V).max())
