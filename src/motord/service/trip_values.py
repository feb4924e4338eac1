"""What was measured at a trip, beside the limit that it went beyond."""

from collections.abc import Callable

import numpy as np

from motord.config import LimitsConfig
from motord.schema import Trip


def _largest_A(tick: np.void) -> float:
    return max(abs(float(tick[f"i_{phase}_A"])) for phase in "abc")


def _bus_limit_V(tick: np.void, limits: LimitsConfig) -> float:
    return limits.bus_V_min if float(tick["u_bus_V"]) < limits.bus_V_min else limits.bus_V_max


_VALUES: dict[
    Trip, tuple[str, Callable[[np.void], float], Callable[[np.void, LimitsConfig], float]]
] = {
    Trip.OVER_CURRENT: (
        "largest phase current, A",
        _largest_A,
        lambda tick, limits: limits.trip_current_A,
    ),
    Trip.OVER_SPEED: (
        "speed, rad/s",
        lambda tick: abs(float(tick["speed_rad_s"])),
        lambda tick, limits: limits.trip_speed_rad_s,
    ),
    Trip.OVER_TORQUE: (
        "torque, Nm",
        lambda tick: abs(float(tick["torque_Nm"])),
        lambda tick, limits: limits.trip_torque_Nm,
    ),
    Trip.I2T: (
        "largest phase current now, for the continuous one, A",
        _largest_A,
        lambda tick, limits: limits.i2t_current_A,
    ),
    Trip.TEMPERATURE: (
        "inverter temperature, degC",
        lambda tick: float(tick["temperature_C"]),
        lambda tick, limits: limits.trip_temperature_C,
    ),
    Trip.BUS_VOLTAGE: ("bus voltage, V", lambda tick: float(tick["u_bus_V"]), _bus_limit_V),
}


def trip_values(bits: int, tick: np.void, limits: LimitsConfig) -> dict[str, dict[str, float]]:
    """Return value and limit for each cause in `bits` that has a limit, as `tick` shows them."""
    return {
        what: {"value": value(tick), "limit": limit(tick, limits)}
        for trip, (what, value, limit) in _VALUES.items()
        if bits & trip
    }
