"""What the loop and the supervisor ask of a device.

The loop talks to one `Rig`: it reads everything into one feedback record and writes one command
record, without blocking and without allocating. `WireRig` makes one of an `InverterDriver` and a
`BridgeDriver`; `hal.sim.SimRig` is the simulated bench. The brake and the external drive are slow
`SetpointDevice`s that the supervisor's Modbus thread owns.
"""

from typing import Protocol

import numpy as np

from motord.schema import BridgeStatus, InverterStatus

__all__ = [
    "BridgeDriver",
    "BridgeStatus",
    "DeviceError",
    "DeviceReading",
    "InverterDriver",
    "InverterStatus",
    "Rig",
    "SetpointDevice",
]


class DeviceError(Exception):
    """A device that cannot be opened or used; the message says which, what and what to do."""


class Rig(Protocol):
    """All devices of the fast loop. Times are Unix ns; records are those of `control.types`; status
    words are in motord's own bits whatever the device's are."""

    def open(self) -> None:
        """Open the devices and wait for their first samples. Raises DeviceError."""

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill `feedback` (shape (1,)) with the newest samples; never blocks."""

    def write(self, command: np.ndarray) -> None:
        """Send `command` (shape (1,)); never blocks. A failed send shows in the feedback."""

    def safe_stop(self) -> None:
        """Command zero current and open the enable line; may be called at any time."""

    def close(self) -> None:
        """Stop safely and release the devices; may be called twice."""


class InverterDriver(Protocol):
    """A drive that takes phase-current references."""

    def open(self) -> None:
        """Open the bus. Raises DeviceError."""

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill t_inverter_ns, i_A, u_V, u_bus_V, temperature_C, inverter_status; add errors."""

    def write(self, command: np.ndarray) -> None:
        """Send current references and the enable bit; not finite ones are all sent as 0."""

    def safe_stop(self) -> None:
        """Send zero current and disable."""

    def close(self) -> None:
        """Release the bus; may be called twice."""


class BridgeDriver(Protocol):
    """The board that samples encoder and torque at one instant and holds the enable line."""

    def open(self) -> None:
        """Open the link, check the board's identity, start the stream. Raises DeviceError."""

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill t_ns, encoder_gray, torque_Nm, bridge_status; add link_errors.

        bridge_status has ENABLE_LINE while the line is closed: without it the bench is not enabled,
        and one that is enabled trips.
        """

    def write(self, command: np.ndarray) -> None:
        """Send heartbeat and enable-line request."""

    def safe_stop(self) -> None:
        """Open the enable line."""

    def close(self) -> None:
        """Release the link; may be called twice."""


class SetpointDevice(Protocol):
    """A slow device with one set-point: brake (excitation 0 to 1) or external drive (rad/s)."""

    def open(self) -> None:
        """Connect. Raises DeviceError."""

    def exchange(self, setpoint: float) -> "DeviceReading":
        """Write the set-point, read the device back; blocks at most its timeout. DeviceError."""

    def safe_stop(self) -> None:
        """Write a set-point of zero, if the device can be reached."""

    def close(self) -> None:
        """Disconnect; may be called twice."""


class DeviceReading:
    """What a slow device says: status word, actual set-point, one measured value."""

    __slots__ = ("setpoint", "status", "value")

    def __init__(self, status: int, setpoint: float, value: float) -> None:
        self.status = status
        self.setpoint = setpoint
        self.value = value
