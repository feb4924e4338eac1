"""The inverter over CAN: current references out, currents, voltages and status in."""

import math

import numpy as np

from motord.hal.inverter.can_drive import CanDrive


class CanInverter(CanDrive):
    """An `InverterDriver` for a drive that takes phase currents."""

    NO_CURRENT_A = (0.0, 0.0, 0.0)

    def write(self, command: np.ndarray) -> None:
        """Send current references and the enable bit; a current that is not finite makes all 0."""
        i_a_A, i_b_A, i_c_A = command["i_A"][0].tolist()
        if math.isfinite(i_a_A + i_b_A + i_c_A):
            self._send((i_a_A, i_b_A, i_c_A), bool(command["enable"][0]))
        else:
            self._send(self.NO_CURRENT_A, bool(command["enable"][0]))
