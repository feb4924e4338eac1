"""What the compensation did, read off a recording: gains, offsets and cogging torque it applied.

The commands of a compensated run are i_cmd = (g i + b - beta) / (alpha delta epsilon), with i the
currents of the torque that is wanted, g and b what was induced. Torque, angle, cogging torque and
commands of every tick are recorded, so alpha delta epsilon and beta follow without a calibration
file at hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.identification import IdentifyError
from motord.identification.least_loss import currents_per_Nm
from motord.identification.operating_points import COMMANDS, CURRENTS
from motord.identification.resample import fill_gaps
from motord.schema import Flag, joined, rows_of

NEEDED = ("angle_predicted_rad", "torque_set_Nm", "cogging_comp_Nm", "flags", *COMMANDS)
"""Columns of the tick that describe the compensation."""

BOTH = Flag.CURRENTS_COMPENSATED | Flag.COGGING_COMPENSATED
SPOILT = Flag.CURRENT_LIMITED | Flag.TORQUE_LIMITED | Flag.LEARNED_COMPENSATED


@dataclass(frozen=True)
class Applied:
    """gain (3,): alpha delta epsilon; offset_A (3,): beta; tau_cog_Nm (counts,)."""

    gain: np.ndarray
    offset_A: np.ndarray
    tau_cog_Nm: np.ndarray

    def with_sensors_in_error(
        self, ticks: np.ndarray, gain: Sequence[float], offset_A: Sequence[float]
    ) -> np.ndarray:
        """Return ticks as sensors with these errors would have given them.

        What flowed was gain i + offset_A with i the currents wanted. Sensors that read i while
        that flows are wrong by just this gain and offset: sensed and commanded currents become
        ((alpha i* + beta) - offset_A) / gain.
        """
        changed = joined([ticks])
        for names in (CURRENTS, COMMANDS):
            for p, name in enumerate(names):
                flowing_A = self.gain[p] * ticks[name] + self.offset_A[p]
                changed[name] = (flowing_A - offset_A[p]) / gain[p]
        return changed


class AppliedCompensation:
    """Takes ticks point by point; then returns what was applied."""

    def __init__(self, motor: MotorConfig) -> None:
        self._per_Nm = currents_per_Nm(motor)
        self._counts = motor.counts
        self._sums = np.zeros((3, 2, 3))  # phase; command, 1; command, 1, what was to flow
        self._cogging = np.zeros((2, motor.counts))

    def add(
        self,
        ticks: np.ndarray,
        gain: Sequence[float] = (1.0, 1.0, 1.0),
        offset_A: Sequence[float] = (0.0, 0.0, 0.0),
        cogging: float = 1.0,
    ) -> None:
        """Take the ticks of a point with what was induced there. Raises IdentifyError."""
        flags = ticks["flags"].astype(np.int64)
        good = (flags & int(BOTH) == int(BOTH)) & (flags & int(SPOILT) == 0)
        if ticks.size and not good.any():
            raise IdentifyError(
                "the currents of this run were not compensated for gains, offsets and cogging "
                "torque: install a calibration before the plan"
            )
        for name in ("angle_predicted_rad", "torque_set_Nm", "cogging_comp_Nm", *COMMANDS):
            good &= np.isfinite(ticks[name])
        t = rows_of(ticks, good)
        position = t["angle_predicted_rad"].astype(float) * (self._counts / (2 * np.pi))
        whole = np.floor(position).astype(np.int64)
        share = (position - whole)[:, None]
        n, following = whole % self._counts, (whole + 1) % self._counts
        per_Nm = (1 - share) * self._per_Nm[n] + share * self._per_Nm[following]
        cog_Nm = t["cogging_comp_Nm"].astype(float)
        i_A = (t["torque_set_Nm"].astype(float) - cog_Nm)[:, None] * per_Nm
        ones = np.ones(len(t))
        for p, name in enumerate(COMMANDS):
            command_A = t[name].astype(float)
            flowing_A = gain[p] * i_A[:, p] + offset_A[p]
            sides = np.array([command_A, ones])
            self._sums[p] += sides @ np.array([command_A, ones, flowing_A]).T
        nearest = np.rint(position).astype(np.int64) % self._counts
        self._cogging[0] += np.bincount(nearest, cog_Nm * cogging, minlength=self._counts)
        self._cogging[1] += np.bincount(nearest, ones * cogging**2, minlength=self._counts)

    def result(self) -> Applied:
        """Return what was applied. Raises IdentifyError without any currents."""
        try:
            lines = np.array([np.linalg.solve(s[:, :2], s[:, 2]) for s in self._sums])
        except np.linalg.LinAlgError:
            raise IdentifyError("no currents were commanded: nothing was compensated") from None
        sums, hits = self._cogging
        with np.errstate(invalid="ignore", divide="ignore"):
            table = np.where(hits > 0, sums / hits, np.nan)
        if not np.isfinite(table).any():
            table = np.zeros(self._counts)
        return Applied(gain=lines[:, 0], offset_A=lines[:, 1], tau_cog_Nm=fill_gaps(table))
