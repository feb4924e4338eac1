"""The torque error of the capture under way: measured less set torque, turn by turn, from ticks.

What a torque sensor that does not pass the mean should show of the set-point is followed and taken
off. The RMS is that of Poels 2008, eq. (4.16): over the angle, about the mean, here of each whole
turn, so that a sensor's drift is not in it; noise is. Pure.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import Config
from motord.control import parameters
from motord.sequencing import Observation


@dataclass(frozen=True)
class MeasuredError:
    """Of a capture, in percent of rated torque; None: not measured.

    mean_error_percent: of measured less set torque, if the sensor passes the mean.
    """

    rms_error_percent: float | None = None
    mean_error_percent: float | None = None


class TorqueError:
    """Follows blocks of ticks; `of` returns the error of the capture that they belong to."""

    def __init__(self, config: Config) -> None:
        self._decay = float(parameters.build(config)[0][0].torque_decay)
        self._rated_Nm = config.motor.rated_torque_Nm
        self._passes_mean = config.torque_sensor.passes_mean
        self._set_Nm = self._expected_Nm = 0.0
        self._tick: int | None = None
        self._capture = (-1, 0)  # point, first tick
        self._turns = np.zeros((1, 3))  # sums over each turn of weight, weight e, weight e^2

    def update(self, ticks: np.ndarray, seen: Observation) -> None:
        """Take in a block of ticks, shape (n,), n > 0, and the observation made of it."""
        error_Nm = ticks["torque_Nm"] - self._expect_Nm(ticks)
        capture = (seen.plan_point, seen.point_first_tick)
        if capture != self._capture:
            self._capture, self._turns = capture, np.zeros((1, 3))
        if seen.plan_point < 0:
            return
        inside = ticks["tick"] >= seen.point_first_tick
        error_Nm, weight = error_Nm[inside], np.abs(ticks["speed_rad_s"][inside].astype(float))
        weighted = weight * error_Nm
        self._turns[-1] += weight.sum(), weighted.sum(), (weighted * error_Nm).sum()
        if int(abs(seen.point_turns)) >= len(self._turns):
            self._turns = np.vstack([self._turns, np.zeros(3)])

    def of(self, point: int) -> MeasuredError:
        """Return the error over the whole turns of the capture of `point` so far."""
        turns = self._turns[:-1]
        if point != self._capture[0] or not len(turns) or not (turns[:, 0] > 0).all():
            return MeasuredError()
        mean_Nm = turns[:, 1] / turns[:, 0]
        square_Nm2 = turns[:, 2] / turns[:, 0] - mean_Nm**2
        percent = 100 / self._rated_Nm
        rms = percent * float(np.sqrt(np.maximum(square_Nm2, 0.0).mean()))
        mean = percent * float(mean_Nm.mean())
        if not np.isfinite([rms, mean]).all():  # the measured torque may be anything
            return MeasuredError()
        return MeasuredError(round(rms, 4), round(mean, 4) if self._passes_mean else None)

    def _expect_Nm(self, ticks: np.ndarray) -> np.ndarray:
        """Return what the sensor should show of the set-point at each tick, shape (n,).

        Where it changes within the block, as of the block's end: captures are at a constant one.
        """
        numbers = ticks["tick"].astype(np.int64)
        before = int(numbers[0]) - 1 if self._tick is None else self._tick
        set_Nm = ticks["torque_set_Nm"].astype(float)
        faded = self._decay ** np.maximum(numbers - before, 0)
        expected_Nm = self._expected_Nm * faded
        if (set_Nm != self._set_Nm).any():
            changes_Nm = np.diff(set_Nm, prepend=self._set_Nm)
            changed = changes_Nm != 0.0
            left = self._decay ** (numbers[-1] - numbers[changed])
            expected_Nm[:] = expected_Nm[-1] + float((left * changes_Nm[changed]).sum())
        self._tick, self._set_Nm = int(numbers[-1]), float(set_Nm[-1])
        self._expected_Nm = float(expected_Nm[-1])
        return expected_Nm
