"""What the loop and the supervisor ask of a device.

The loop talks to one `Rig`: it reads everything into one feedback record and writes one command
record, without blocking and without allocating. `WireRig` makes one of an `InverterDriver` and a
`BridgeDriver`; `hal.sim.rig.SimRig` is the simulated bench. The brake and the external drive are
slow `SetpointDevice`s that the supervisor's Modbus thread owns.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from motord.schema import BridgeStatus as BridgeStatus  # drivers of other packages take it here
from motord.schema import InverterStatus as InverterStatus


class DeviceError(Exception):
    """A device that cannot be opened or used; the message says which, what and what to do."""


class DeviceNotReadyError(DeviceError):
    """A device that does not answer, or says that it is busy: it may still be starting."""


class Device(Protocol):
    """What every device can do."""

    def open(self) -> None:
        """Connect, check who answers, wait for its first samples if it sends any.

        Raises DeviceError.
        """

    def safe_stop(self) -> None:
        """Command zero current, open the enable line, write a set-point of zero: what it has.

        May be called at any time.
        """

    def close(self) -> None:
        """Stop safely and release the device; may be called twice."""


class FastDevice(Device, Protocol):
    """A device that is read and commanded in every tick. Times are Unix ns; records are those of
    `control.types`; status words are in motord's own bits whatever the device's are."""

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill `feedback` (shape (1,)) with the newest samples; never blocks.

        link_errors counts from the first read on: what is lost while nobody reads is none.
        """

    def write(self, command: np.ndarray) -> None:
        """Send `command` (shape (1,)); never blocks. A failed send shows in the feedback."""


@runtime_checkable
class DeviceClock(Protocol):
    """What is known of a device's own clock: its drift against the loop's, its samples' jitter."""

    jitter_ns: float

    @property
    def drift_ppm(self) -> float:
        """Return how much faster than the loop's clock it runs."""


class Rig(FastDevice, Protocol):
    """All devices of the fast loop."""

    @property
    def refused(self) -> str:
        """Return which device cannot be taken, and what to do, for the loop to end with; or ""."""

    @property
    def clock(self) -> DeviceClock | None:
        """Return what is known of the bridge board's clock; None if it has none of its own."""


class InverterDriver(FastDevice, Protocol):
    """A drive that takes phase-current references.

    `read` fills t_inverter_ns, i_A, u_V, u_bus_V, temperature_C, inverter_status and adds to
    link_errors; and t_status_ns, if the drive states its status apart from its currents. `write`
    sends current references, all as 0 if one is not finite, and the enable bit; `safe_stop` zero
    current and disable.
    """


class BridgeDriver(FastDevice, Protocol):
    """The board that samples encoder and torque at one instant and holds the enable line.

    `read` fills t_ns, encoder_gray, torque_Nm, bridge_status and adds to link_errors. bridge_status
    has ENABLE_LINE while the line is closed as it was asked to be: without it the bench is not
    enabled, and one that is enabled trips. `write` sends heartbeat and enable-line request;
    `safe_stop` opens the line. A driver may have `refused` and `clock` as `Rig` does.
    """


class SetpointDevice(Device, Protocol):
    """A slow device with one set-point: brake (excitation 0 to 1) or external drive (rad/s)."""

    def exchange(self, setpoint: float) -> "DeviceReading":
        """Write the set-point, read the device back; blocks at most its timeout. DeviceError."""


class DeviceReading(NamedTuple):
    """What a slow device says: status word, actual set-point, one measured value."""

    status: int
    setpoint: float
    value: float
