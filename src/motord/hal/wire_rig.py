"""Inverter and bridge, each over its own wire, as the one rig that the loop talks to."""

import numpy as np

from motord.hal.base import BridgeDriver, DeviceClock, InverterDriver


class WireRig:
    """A `Rig` of two drivers."""

    def __init__(self, inverter: InverterDriver, bridge: BridgeDriver) -> None:
        self._inverter = inverter
        self._bridge = bridge
        clock = getattr(bridge, "clock", None)
        self.clock: DeviceClock | None = clock if isinstance(clock, DeviceClock) else None
        """What is known of the bridge's clock; None if its driver has none."""

    @property
    def refused(self) -> str:
        """Which other bridge board answers in place of the one opened, and what to do; or ""."""
        return str(getattr(self._bridge, "refused", ""))

    def open(self) -> None:
        """Open both devices; neither stays open if one cannot be. Raises DeviceError."""
        self._bridge.open()
        try:
            self._inverter.open()
        except BaseException:
            self._bridge.close()
            raise

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Fill `feedback` from both; never blocks."""
        feedback["now_ns"] = now_ns
        feedback["link_errors"] = 0
        self._bridge.read(now_ns, feedback)
        self._inverter.read(now_ns, feedback)

    def write(self, command: np.ndarray) -> None:
        """Send the currents first, they are waited for; then the heartbeat."""
        self._inverter.write(command)
        self._bridge.write(command)

    def safe_stop(self) -> None:
        """Command zero current and open the enable line, whichever of the two still works."""
        try:
            self._inverter.safe_stop()
        finally:
            self._bridge.safe_stop()

    def close(self) -> None:
        """Stop safely and release both devices; may be called twice."""
        try:
            self._inverter.close()
        finally:
            self._bridge.close()
