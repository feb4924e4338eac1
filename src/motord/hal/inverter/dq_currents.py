"""A drive over CAN that takes currents along the rotor's axes, d and q, instead of phase currents.

The control kernel's phase currents, compensation and all, are those for the angle at which they
will flow; seen along the drive's axes at that angle they are what the drive is sent. Between
commands the drive holds them there, so they turn with its own angle. What it senses
along its axes becomes phase currents by the angle at which they were sensed.
"""

import math

import numpy as np

from motord.config import Config
from motord.control.park import DqFrame
from motord.hal.inverter.can_drive import CanDrive


class DqInverter(CanDrive):
    """An `InverterDriver` for a drive with `[inverter.dq]` axes."""

    NO_CURRENT_A = (0.0, 0.0)

    def __init__(self, config: Config) -> None:
        """Compile messages and frame; nothing is opened. Raises ConfigError."""
        super().__init__(config)
        self._frame = DqFrame.of(config)
        self._sends_phases = bool(self._codec.signals.feedback_i_A)
        self._angle_rad = 0.0
        self._speed_rad_s = 0.0
        self._angle_ns = 0
        self._frame.to_drive(0.0, 0.0, (0.0, 0.0, 0.0))  # compiled before the loop runs
        self._frame.from_drive(0.0, 0.0, 0.0, 0.0)

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill t_inverter_ns, i_A, u_V, u_bus_V, temperature_C, inverter_status; add errors."""
        super().read(now_ns, feedback)
        if not self._sends_phases:
            i_d_A, i_q_A, u_d_V, u_q_V = self._feedback.along_axes()
            since_s = (int(feedback["t_inverter_ns"][0]) - self._angle_ns) * 1e-9
            angle_rad = self._angle_rad + self._speed_rad_s * since_s
            if math.isnan(i_d_A):  # not in the map
                i_d_A = 0.0
            feedback["i_A"] = self._frame.from_drive(angle_rad, self._speed_rad_s, i_d_A, i_q_A)
            feedback["u_V"] = self._frame.from_drive(angle_rad, self._speed_rad_s, u_d_V, u_q_V)

    def write(self, command: np.ndarray) -> None:
        """Send d and q of the current references, and the enable bit; what is not finite is 0."""
        i_a_A, i_b_A, i_c_A = command["i_A"][0].tolist()
        self._angle_rad = float(command["angle_rad"][0])
        self._speed_rad_s = float(command["speed_rad_s"][0])
        self._angle_ns = int(command["angle_ns"][0])
        currents_A = self._frame.to_drive(self._angle_rad, self._speed_rad_s, (i_a_A, i_b_A, i_c_A))
        if not math.isfinite(currents_A[0] + currents_A[1]):
            currents_A = self.NO_CURRENT_A
        self._send(currents_A, bool(command["enable"][0]))
