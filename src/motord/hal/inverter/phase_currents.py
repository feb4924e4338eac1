"""The inverter over CAN: current references out, currents, voltages and status in.

The messages come from the bench's DBC, the bus is any that `motord.hal.can.bus` opens.
"""

import math

import numpy as np

from motord.config import Config
from motord.hal.base import DeviceError
from motord.hal.inverter.can_drive import CanDrive
from motord.hal.inverter.feedback import CanFeedback
from motord.schema import InverterStatus
from motord.wire.can import dbc


class CanInverter:
    """An `InverterDriver` for a drive whose messages a DBC describes."""

    NO_CURRENT_A: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __init__(self, config: Config) -> None:
        """Compile the drive's messages; nothing is opened. Raises ConfigError, DeviceError."""
        can = config.inverter.can
        if can is None:
            raise DeviceError("inverter: the CAN driver needs a table [inverter.can]")
        self._codec = dbc.load(can)
        self._feedback = CanFeedback(self._codec, round(config.inverter.feedback_age_s * 1e9))
        self._drive = CanDrive(can, self._feedback, self._codec.command.key)
        self._counter = 0

    def open(self) -> None:
        """Open the bus and wait until every feedback message has come. Raises DeviceError."""
        self._drive.open(lambda: self._send(self.NO_CURRENT_A, False))

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill t_inverter_ns, i_A, u_V, u_bus_V, temperature_C, inverter_status; add errors."""
        errors = self._drive.read(now_ns)
        self._feedback.fill(feedback)
        feedback["link_errors"] += errors
        if self._drive.off:
            feedback["inverter_status"] |= int(InverterStatus.BUS_OFF)

    def write(self, command: np.ndarray) -> None:
        """Send current references and the enable bit; a current that is not finite makes all 0."""
        i_a_A, i_b_A, i_c_A = command["i_A"][0].tolist()
        if math.isfinite(i_a_A + i_b_A + i_c_A):
            self._send((i_a_A, i_b_A, i_c_A), bool(command["enable"][0]))
        else:
            self._send(self.NO_CURRENT_A, bool(command["enable"][0]))

    def safe_stop(self) -> None:
        """Send zero current and disable; twice, in case a frame is lost."""
        self._send(self.NO_CURRENT_A, False)
        self._send(self.NO_CURRENT_A, False)

    def close(self) -> None:
        """Stop safely and release the bus; may be called twice."""
        self.safe_stop()
        self._drive.close()

    def _send(self, i_A: tuple[float, ...], enable: bool) -> None:
        self._drive.send(self._codec.encode_command(i_A, enable, self._counter))
        self._counter += 1
