"""Torque ripple: RMS error, spectrum over the orders of a turn."""

import numpy as np


def rms_error_percent(
    torque_Nm: np.ndarray, rated_torque_Nm: float, weights: np.ndarray | None = None
) -> float:
    """Return || tau - mean(tau) ||_2 / (sqrt(N) tau_rated) in percent, Poels 2008, eq. (4.16).

    torque_Nm (n,): one value an encoder point; or one value a tick with the angle that each tick
    covers (its speed) as `weights`, because the error is over angle, not over time.
    """
    mean = np.average(torque_Nm, weights=weights)
    square = np.average((torque_Nm - mean) ** 2, weights=weights)
    return float(100 * np.sqrt(square) / rated_torque_Nm)


def spectrum(table: np.ndarray, highest: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (amplitude, phase) of orders 1 to `highest` of values over one turn (counts,).

    Order h is amplitude sin(h theta + phase).
    """
    lines = np.fft.rfft(table)[1 : highest + 1] * 2 / table.size
    return np.abs(lines), np.angle(lines * 1j)


def harmonics_table(
    orders: np.ndarray, amplitude: np.ndarray, phase_rad: np.ndarray, counts: int
) -> np.ndarray:
    """Return sum of amplitude sin(order theta + phase) at theta = 2 pi n / counts (counts,)."""
    angle_rad = 2 * np.pi * np.arange(counts) / counts
    table = np.zeros(counts)
    for order, a, phase in zip(orders, amplitude, phase_rad, strict=True):
        table += a * np.sin(order * angle_rad + phase)
    return table
