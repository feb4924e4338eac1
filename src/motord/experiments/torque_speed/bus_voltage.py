"""The bus voltage of the ticks at readings of the DC current, and its ripple between them.

Where readings are means, mean(u i) = mean(u) mean(i) + the mean product of their ripples, which is
at most that of their RMS values. Of the voltage's variance within readings, white noise of its
sensor is no ripple: its density is the median of the periodogram, over ln 2.
"""

from math import log

import numpy as np

from motord.experiments.torque_speed.power_series import PowerSeries
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.identification import IdentifyError


def bus_voltage(
    turns: CapturedTurns, ticks: np.ndarray, at_s: np.ndarray, means: bool
) -> tuple[np.ndarray, float]:
    """Return the voltage (m,) at readings (m,), V, and the RMS of its ripple, V.

    means: the voltage is the mean since the reading before; else it is that of an instant, and no
    ripple is lost. Raises IdentifyError where the drive does not report it.
    """
    names = ticks.dtype.names or ()
    voltage_V = ticks["u_bus_V"].astype(float) if "u_bus_V" in names else np.zeros(0)
    if not voltage_V.size or not np.isfinite(voltage_V).all() or not voltage_V.any():
        raise IdentifyError("the ticks have no bus voltage (u_bus_V) to multiply the current with")
    tick_s = (ticks["t_ns"].astype(np.int64) - turns.t0_ns) * 1e-9
    if not means or at_s.size < 2:
        return np.interp(at_s, tick_s, voltage_V), 0.0
    between_V = PowerSeries(tick_s, voltage_V, means=False).means_W(at_s)
    place = np.searchsorted(at_s, tick_s)
    inside = (place > 0) & (place < at_s.size)
    apart_V = voltage_V[inside] - between_V[place[inside] - 1]
    square_V2 = float(np.mean(apart_V**2)) - white_noise_V2(voltage_V)
    return np.concatenate([between_V[:1], between_V]), max(square_V2, 0.0) ** 0.5


def white_noise_V2(voltage_V: np.ndarray) -> float:
    """Return the variance of the white noise in a voltage (n,), evenly sampled."""
    if voltage_V.size < 4:
        return 0.0
    density = np.abs(np.fft.rfft(voltage_V - voltage_V.mean())[1:]) ** 2
    return float(np.median(density)) / log(2) / voltage_V.size
