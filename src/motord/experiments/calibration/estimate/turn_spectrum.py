"""The model's columns by order of the turn, of groups of turns of an operating point.

What the fit leaves at an order is linear in the parameters, so it can be had for any of them after
the samples are gone. Noise is what differs between the groups.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from motord.config import TorqueSensorConfig
from motord.identification.basis import Basis, cell_gain
from motord.identification.harmonics import lines_of_sums
from motord.identification.operating_points import Samples
from motord.identification.orders import resolved_order
from motord.identification.torque.torque_sensor import order_below_resonance

ANGLE_BINS = 4096
"""Parts of the turn in which samples are summed; fewer where the encoder has fewer counts."""

TURN_GROUPS = 4
"""Groups in which the turns of a point are summed, in rotation; of fewer turns, each by itself."""

BEYOND = 1.25
"""Orders are looked at so far beyond the highest of the model."""

SMOOTHED_ORDERS = 15
"""Neighbouring orders over which the noise is averaged; fewer towards order 1, where it rises."""


def orders_averaged(highest: int) -> np.ndarray:
    """Return over how many orders the noise is averaged, around each of orders 1 to `highest`.

    A sensor that drifts has noise that rises steeply towards order 1.
    """
    half = min(SMOOTHED_ORDERS, highest) // 2
    return np.asarray(2 * np.minimum(half - (2 * half + 1 > highest), np.arange(highest) // 2) + 1)


@dataclass(frozen=True)
class TurnSpectrum:
    """Spectra of an operating point; orders 1 to h, w columns, the last the torque.

    visits (groups, 2 h + 1): transform of the samples in each bin, its order 0 first. sums
    (groups, h + 1, w): transform of the columns' sums, free of their means where the sensor
    passes these. command_A (bins, 3), velocity_rad_s (bins,): commanded currents and velocity over
    the turn. highpass (h,): complex gain of the torque sensor's amplifier. velocity_Hz: mean speed,
    negative backwards.
    """

    velocity_Hz: float
    visits: np.ndarray
    sums: np.ndarray
    command_A: np.ndarray
    velocity_rad_s: np.ndarray
    highpass: np.ndarray

    @classmethod
    def of(
        cls,
        samples: Samples,
        binned: np.ndarray,
        command_A: np.ndarray,
        velocity_rad_s: np.ndarray,
        basis: Basis,
        sensor: TorqueSensorConfig,
    ) -> "TurnSpectrum":
        """Return the spectra of sums in bins (groups, bins, w + 1), the last those of samples."""
        bins, counts = binned.shape[1], command_A.shape[0]
        fewest = min(end - first for first, end in samples.turns)
        wanted = round(BEYOND * max(basis.orders, default=1))
        highest = resolved_order(fewest, bins, wanted)
        highest = max(order_below_resonance(sensor, highest, samples.speed_Hz), 1)
        tau = 2j * np.pi * samples.velocity_Hz * sensor.highpass_time_constant_s
        turned = tau * np.arange(1, highest + 1)
        visits = np.fft.fft(binned[:, :, -1], axis=1)[:, np.arange(2 * highest + 1) % bins]
        sums = np.fft.rfft(binned[:, :, :-1], axis=1)[:, : highest + 1].copy()
        if sensor.passes_mean:  # it is no order, and would decide how well gaps are solved
            means = sums[:, :1] / visits[:, :1, None]
            sums -= means * visits[:, : highest + 1, None]
        return cls(
            velocity_Hz=samples.velocity_Hz,
            visits=visits,
            sums=sums,
            command_A=command_A[np.arange(bins) * counts // bins],
            velocity_rad_s=velocity_rad_s[np.arange(bins) * counts // bins],
            highpass=turned / (1 + turned) if tau else np.ones(highest, complex),
        )

    @property
    def direction(self) -> int:
        """1 forwards, -1 backwards."""
        return 1 if self.velocity_Hz > 0 else -1

    @property
    def highest(self) -> int:
        """The highest order."""
        return int(self.sums.shape[1]) - 1

    def waves(self, counts: int) -> np.ndarray:
        """Return the lines (h,) that cos(h theta), as the sensor sees it, has at its own order.

        Of an encoder of so many counts: where bins are several of these, they begin with the first.
        """
        order, bins = np.arange(1, self.highest + 1), self.command_A.shape[0]
        inside = 2j * np.pi * np.outer(order, np.arange(counts // bins)) / counts
        return np.asarray(self.highpass * cell_gain(order, counts) * np.exp(inside).mean(axis=1))

    def residual(self, coefficients: np.ndarray) -> np.ndarray:
        """Return what the columns with these coefficients (w - 1,) leave of the torque.

        Lines (groups, h) of orders 1 to h, complex: order h is Re(line exp(j h theta)).
        """
        sums = self.sums[:, :, -1] - self.sums[:, :, :-1] @ coefficients
        return lines_of_sums(self.visits, sums)[:, 1:]


def lines_of(visits: np.ndarray, sums: np.ndarray, rounds: int = 6) -> np.ndarray:
    """Return lines (h, q) of orders 1 to h of q columns' sums (h + 1, q), complex.

    visits (2 h + 1,): transform of the number of samples. Where these are spread evenly, up to a
    few percent, the normal equations are nearly diagonal: each round leaves so much of the error
    (Landweber's iteration, with a step at which it converges where some angle has many samples).
    """
    highest, samples = len(sums) - 1, visits[0].real
    grid = 1 << (4 * highest + 2).bit_length()
    weight = np.fft.irfft(visits[: grid // 2 + 1], grid) / samples * grid
    step = min(1.0, 1.9 / float(weight.max()))
    lines = sums / samples
    for _ in range(ceil(rounds / step)):
        seen = np.fft.rfft(weight[:, None] * np.fft.irfft(lines, grid, axis=0), axis=0)
        lines = lines + step * (sums / samples - seen[: highest + 1])
    return np.asarray(2 * lines[1:])


def smooth_noise(squares: np.ndarray) -> np.ndarray:
    """Return the noise (points, orders) whose variance `squares` (points, orders) are samples of.

    Its level is that of neighbouring orders at each point; how it rises towards order 1 is
    taken to be alike at all points.
    """
    orders = squares.shape[1]
    shape = _means(squares.mean(axis=0, keepdims=True), orders_averaged(orders))
    shape = np.maximum(shape, 1e-24 * max(float(shape.max()), 1e-300))
    wide = np.full(orders, min(SMOOTHED_ORDERS, 2 * ((orders - 1) // 2) + 1))
    return np.asarray(np.sqrt(shape * _means(squares / shape, wide)))


def _means(values: np.ndarray, averaged: np.ndarray) -> np.ndarray:
    """Return means of values (n, orders) over `averaged` (orders,) neighbouring orders, odd."""
    orders = values.shape[1]
    before = np.pad(np.cumsum(values, axis=1), ((0, 0), (1, 0)))
    first = np.clip(np.arange(orders) - averaged // 2, 0, orders - averaged)
    return np.asarray((before[:, first + averaged] - before[:, first]) / averaged)
