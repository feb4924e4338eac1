"""The signals that the page can show: fields of the tick, some in other units."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TURNS_PER_RAD = 1 / (2 * np.pi)
_US_PER_NS = 1e-3


@dataclass(frozen=True)
class Signal:
    """A signal: `scale` times a field of the tick, by default that of its name.

    group: signals that share a plot.
    """

    name: str
    label: str
    unit: str
    group: str
    field: str = ""
    scale: float = 1.0

    def described(self) -> dict[str, str]:
        """Return what the page needs to know of it."""
        return {"name": self.name, "label": self.label, "unit": self.unit, "group": self.group}


SIGNALS = (
    Signal("torque_Nm", "measured", "Nm", "torque"),
    Signal("torque_set_Nm", "set-point", "Nm", "torque"),
    Signal("cogging_comp_Nm", "cogging compensation", "Nm", "torque"),
    Signal("i_a_A", "phase a", "A", "current"),
    Signal("i_b_A", "phase b", "A", "current"),
    Signal("i_c_A", "phase c", "A", "current"),
    Signal("i_cmd_a_A", "phase a, commanded", "A", "current"),
    Signal("i_cmd_b_A", "phase b, commanded", "A", "current"),
    Signal("i_cmd_c_A", "phase c, commanded", "A", "current"),
    Signal("speed_Hz", "measured", "Hz", "speed", "speed_rad_s", _TURNS_PER_RAD),
    Signal("speed_set_Hz", "set-point", "Hz", "speed", "speed_set_rad_s", _TURNS_PER_RAD),
    Signal("angle_rad", "angle", "rad", "angle"),
    Signal("u_bus_V", "bus voltage", "V", "supply"),
    Signal("temperature_C", "inverter", "degC", "temperature"),
    Signal("brake_temperature_C", "brake", "degC", "temperature"),
    Signal("brake_set", "brake excitation", "1", "brake"),
    Signal("wake_late_us", "wake-up lateness", "us", "loop", "wake_late_ns", _US_PER_NS),
    Signal("work_us", "work", "us", "loop", "work_ns", _US_PER_NS),
)
"""In the order in which the page lists them."""

ROW = {signal.name: row for row, signal in enumerate(SIGNALS)}
"""Row of each signal in arrays of all of them."""


def values(block: NDArray[Any]) -> NDArray[np.float32]:
    """Return the signals of ticks (n,), shape (signals, n)."""
    out = np.empty((len(SIGNALS), len(block)), np.float32)
    for row, signal in zip(out, SIGNALS, strict=True):
        np.multiply(block[signal.field or signal.name], signal.scale, out=row, casting="unsafe")
    return out
