"""A window of whole turns as lines over the turn: residual of the calibration, and commands.

An angle that is rounded to counts c is off by a sawtooth of order c - k f_s / f at a loop rate f_s
and a speed f: at 4096 counts, 1 kHz and 0.746 turns/s by order 75 for k = 3. Times the slope of the
cogging torque, of order 48, it leaves several mNm at orders 27 and 123, as long as the speed lasts,
which all windows of a set-point have alike. So the model is taken at a smoothed angle.
"""

from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.experiments.calibration.estimate.turn_products import BAND_MARGIN
from motord.experiments.calibration.estimate.turn_spectrum import ANGLE_BINS, BEYOND
from motord.experiments.check_calibration.shift import without_sensor
from motord.identification.basis import cell_means
from motord.identification.harmonics import lines_at
from motord.identification.operating_points import PointData, prepare
from motord.identification.orders import resolved_order
from motord.identification.point_ripple import without_drift
from motord.identification.torque.torque_sensor import MountInverse, order_below_resonance
from motord.identification.turning import unwrap_counts

SMOOTHING_S = 0.02
"""Standard deviation of the Gaussian that smooths the angle: up to 8 Hz pass; the inertia lets a
compensated rotor ripple little beyond. One that ripples by more is seen by its counts."""


def unrounded(t_s: np.ndarray, count: np.ndarray, counts: int) -> np.ndarray:
    """Return the position (n,) in counts, not wrapped: smoothed, and no further than its count."""
    at = unwrap_counts(count, counts).astype(float)
    course = np.polynomial.Polynomial.fit(t_s, at, 2)(t_s)
    width = SMOOTHING_S / float(np.median(np.diff(t_s)))
    reach = int(np.ceil(4 * width))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.pad(at - course, reach, mode="reflect")
    smooth = course + np.convolve(padded, weights / weights.sum(), mode="valid")
    return np.asarray(np.clip(smooth, at - 0.5, at + 0.5))


def _interpolated(cells: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return a table of each count's cell, (counts, ...), at positions (n,) in counts."""
    first = np.floor(position).astype(np.int64)
    part = (position - first).reshape(-1, *(1,) * (cells.ndim - 1))
    low, high = cells[first % len(cells)], cells[(first + 1) % len(cells)]
    return np.asarray(low + part * (high - low))


@dataclass(frozen=True)
class WindowLines:
    """Complex lines of orders 1 to h over the turn, order h being Re(line exp(j h theta)).

    residual_Nm (h,): torque less that of the calibration's model with the sensed currents;
    command_A (h + 1, 3): commanded currents, from order 0 on. torque_Nm: the set-point;
    velocity_rad_s: mean, negative backwards; turns: whole ones; period_s: of sampling.
    """

    t_ns: int
    torque_Nm: float
    velocity_rad_s: float
    period_s: float
    turns: int
    residual_Nm: np.ndarray
    command_A: np.ndarray

    @property
    def highest(self) -> int:
        """The highest order that the window resolves."""
        return int(self.residual_Nm.size)


class WindowModel:
    """Makes lines of windows, by the model of a calibration."""

    def __init__(self, config: Config, calibration: Calibration) -> None:
        self._motor, self._sensor = config.motor, config.torque_sensor
        self._calibration = calibration
        self._gain = calibration.delta_epsilon * np.array(calibration.alpha)
        self._cogging_Nm = cell_means(np.array(calibration.tau_cog_Nm)[:, None])[:, 0]
        self._back_emf = cell_means(self._motor.back_emf_table())
        orders = [one.order for one in calibration.tau_cog_harmonics]
        self._wanted = round(BEYOND * max([2 * self._motor.pole_pairs, *orders]))
        self._bins = min(self._motor.counts, ANGLE_BINS)

    def lines(self, ticks: np.ndarray) -> WindowLines:
        """Return the lines of a window of ticks. Raises IdentifyError."""
        data = PointData(float(ticks["torque_set_Nm"][0]), 0.0, ticks)
        samples = prepare(data, self._motor.counts)
        samples = without_sensor(samples, self._calibration, self._motor, self._sensor)
        fewest = min(end - first for first, end in samples.turns)
        highest = resolved_order(fewest, self._bins, self._wanted)
        highest = max(order_below_resonance(self._sensor, highest, samples.speed_Hz), 1)
        band_Hz = BAND_MARGIN * highest * samples.speed_Hz
        mount = MountInverse.of(self._sensor, samples.period_s, band_Hz)
        torque_Nm = mount.apply(samples.t_s, samples.torque_Nm - samples.torque_Nm.mean())
        flowing_A = samples.i_A * self._gain + self._calibration.beta_A
        position = unrounded(samples.t_s, samples.count, self._motor.counts)
        model_Nm = (flowing_A * _interpolated(self._back_emf, position)).sum(axis=1)
        residual_Nm = torque_Nm - model_Nm - _interpolated(self._cogging_Nm, position)
        here = samples.count[samples.whole] * self._bins // self._motor.counts
        columns = [without_drift(samples, residual_Nm), *samples.command_A[samples.whole].T]
        lines = lines_at(here, np.array(columns), self._bins, highest).T.copy()
        lines *= self._first_count_to_middle(highest)[:, None]
        return WindowLines(
            t_ns=int(ticks["t_ns"][-1]),
            torque_Nm=samples.torque_set_Nm,
            velocity_rad_s=2 * np.pi * samples.velocity_Hz,
            period_s=samples.period_s,
            turns=len(samples.turns),
            residual_Nm=lines[1:, 0],
            command_A=lines[:, 1:],
        )

    def _first_count_to_middle(self, highest: int) -> np.ndarray:
        """Return the factor (highest + 1,) of lines from a bin's first count to its middle."""
        behind = (1 / self._bins - 1 / self._motor.counts) / 2
        return np.asarray(np.exp(-2j * np.pi * np.arange(highest + 1) * behind))
