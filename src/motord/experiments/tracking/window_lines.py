"""Windows of ordinary operation at steady set-points, and their lines over the turn.

A window is of whole turns. A tick counts where the motor is enabled, at its set-point, and
compensated by the calibration that is tracked: its cogging torque is the one that the tick made up
for. The lines are of the residual of the calibration, and of the commands.

An angle that is rounded to counts c is off by a sawtooth of order c - k f_s / f at a loop rate f_s
and a speed f: at 4096 counts, 1 kHz and 0.746 turns/s by order 75 for k = 3. Times the slope of the
cogging torque, of order 48, it leaves several mNm at orders 27 and 123, as long as the speed lasts,
which all windows of a set-point have alike. So the model is taken at a smoothed angle.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.recfunctions import repack_fields

from motord.calibration import Calibration
from motord.config import Config
from motord.experiments.calibration.estimate.turn_products import BAND_MARGIN
from motord.experiments.calibration.estimate.turn_spectrum import ANGLE_BINS, BEYOND
from motord.experiments.check_calibration.shift import without_sensor
from motord.identification import CaptureError
from motord.identification.basis import cell_means
from motord.identification.encoder_ticks import countable_ticks
from motord.identification.harmonics import lines_at
from motord.identification.operating_points import COMMANDS, REQUIRED, PointData, prepare
from motord.identification.orders import resolved_order
from motord.identification.point_ripple import without_drift
from motord.identification.torque.torque_sensor import MountInverse, order_below_resonance
from motord.identification.turning import NoWholeTurn, continuous_turns, unwrap_counts
from motord.schema import Flag, State, joined

COLUMNS = [*REQUIRED, *COMMANDS, "i_age_ns", "torque_set_Nm", "speed_rad_s"]

APPLIED = Flag.CURRENTS_COMPENSATED | Flag.COGGING_COMPENSATED

UNSTEADY = Flag.RAMPING | Flag.TORQUE_LIMITED | Flag.CURRENT_LIMITED | Flag.POSITION_AGED

SAME_COGGING = 1e-4
"""Part of the rated torque by which the cogging torque may differ, in single precision."""

LONGEST_GAP = 5
"""Ticks that may be missing inside a window."""

LONGEST_S = 60.0
"""A rotor that takes longer for LEAST_TURNS is not followed."""

LEAST_TURNS = 2
"""Whole turns of a window: the drift of the torque sensor shows by how they differ."""

MARGIN = 16
"""Samples on either side of the whole turns, for filters to settle."""

ONE_WAY = 0.9
"""Part of the path of a rotor that keeps its direction, at least: counts may tremble."""

SMOOTHING_S = 0.02
"""Standard deviation of the Gaussian that smooths the angle: up to 8 Hz pass; the inertia lets a
compensated rotor ripple little beyond. One that ripples by more is seen by its counts."""


class TurnWindows:
    """Takes ticks as they come and gives windows of about `window_s`, or LEAST_TURNS if longer."""

    def __init__(self, calibration: Calibration, rate_Hz: float, window_s: float) -> None:
        """rate_Hz: of the ticks."""
        table = np.array(calibration.tau_cog_Nm)
        self._cogging_Nm = np.append(table, table[0])
        self._allowed_Nm = SAME_COGGING * calibration.motor.rated_torque_Nm
        self._counts = calibration.motor.counts
        self._window = round(window_s * rate_Hz)
        self._longest = round(LONGEST_S * rate_Hz)
        self._keep()
        self._last_tick, self._last_torque_Nm = 0, 0.0

    def take(self, ticks: np.ndarray) -> Iterator[np.ndarray]:
        """Take ticks (n,) of TICK_DTYPE and yield the windows that they end, of COLUMNS."""
        if ticks.size == 0:
            return
        good = self._usable(ticks)
        number, torque_Nm = ticks["tick"].astype(np.int64), ticks["torque_set_Nm"]
        apart = np.diff(number, prepend=self._last_tick) > LONGEST_GAP + 1
        apart |= np.diff(torque_Nm, prepend=self._last_torque_Nm) != 0
        apart[1:] |= good[1:] != good[:-1]
        self._last_tick, self._last_torque_Nm = int(number[-1]), float(torque_Nm[-1])
        for start, end in pairwise([0, *(np.flatnonzero(apart[1:]) + 1), ticks.size]):
            if apart[start] or not good[start]:
                yield from self._ended()
            if good[start]:
                yield from self._longer(ticks[start:end])

    def _usable(self, ticks: np.ndarray) -> np.ndarray:
        """Return which ticks count (n,)."""
        flags = ticks["flags"]
        good = (ticks["state"] == State.ENABLED) & (ticks["trip_bits"] == 0)
        good &= (flags & (APPLIED | UNSTEADY)) == APPLIED
        position = ticks["angle_predicted_rad"] / (2 * np.pi) * self._counts % self._counts
        known_Nm = np.interp(position, np.arange(self._counts + 1), self._cogging_Nm)
        return np.asarray(good & (np.abs(ticks["cogging_comp_Nm"] - known_Nm) < self._allowed_Nm))

    def _longer(self, ticks: np.ndarray) -> Iterator[np.ndarray]:
        """Keep ticks of a steady set-point and yield the windows that they end."""
        while ticks.size:
            room = self._looked_at + self._window - self._size
            self._kept.append(repack_fields(ticks[COLUMNS][:room]))
            self._size += self._kept[-1].size
            ticks = ticks[room:]
            if self._size == self._looked_at + self._window:
                yield from self._cut()

    def _ended(self) -> Iterator[np.ndarray]:
        """Yield the rest of a steady set-point, and drop it."""
        if self._size:
            yield from self._cut()
        self._keep()

    def _cut(self) -> Iterator[np.ndarray]:
        """Yield the whole turns so far and keep what comes after them."""
        ticks = joined(self._kept)
        self._keep()
        turns: tuple[tuple[int, int], ...] = ()
        try:
            ticks, position, _ = countable_ticks(ticks, self._counts, "window")
            turns = continuous_turns(position, self._counts, "window")
        except NoWholeTurn:
            pass
        except CaptureError:
            yield ticks  # `prepare` says why not, or leaves samples out whose times go back
            return
        if len(turns) < LEAST_TURNS:
            if ticks.size <= self._longest:
                self._keep(ticks)
            return
        end = turns[-1][1]
        window = ticks[: end + MARGIN]
        self._keep(joined([ticks[max(end - MARGIN, 0) :]]))
        position = unwrap_counts(window["encoder_count"], self._counts)
        if abs(position[-1] - position[0]) >= ONE_WAY * np.abs(np.diff(position)).sum():
            yield window

    def _keep(self, *ticks: np.ndarray) -> None:
        """Keep these ticks, which were looked at, and no others."""
        self._kept = list(ticks)
        self._size = self._looked_at = sum(one.size for one in ticks)


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
