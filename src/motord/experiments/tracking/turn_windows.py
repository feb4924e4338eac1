"""Ordinary operation, cut into windows of whole turns at steady set-points.

A tick counts where the motor is enabled, at its set-point, and compensated by the calibration that
is tracked: its cogging torque is the one that the tick made up for.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.lib.recfunctions import repack_fields

from motord.calibration import Calibration
from motord.identification import CaptureError
from motord.identification.encoder_ticks import countable_ticks
from motord.identification.operating_points import COMMANDS, REQUIRED
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
