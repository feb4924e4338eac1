"""The true torque of a simulated rig between the loop's ticks, where its truth is recorded.

Between two ticks a current follows the command that is held, with a dead time d and a lag L:

    i(t) = u + (i(d) - u) exp(-(t - d) / L),    before d the same with the command before.

Both ends are known, so the commands u follow one from the other. Torque less that of the currents
is smooth from tick to tick: cubic splines. Truth at ticks alone has images of the held currents
folded onto the orders of the turn, as any sampled torque.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.identification.operating_points import stacked
from motord.rig.truth import RigTruth

PARTS = 10
"""Instants for each tick."""

CURRENTS = ("i_a_A", "i_b_A", "i_c_A")
COLUMNS = ("t_ns", "angle_rad", "speed_rad_s", "torque_Nm", *CURRENTS)
_FINE = np.dtype([(name, float) for name in ("angle_rad", "speed_rad_s", "torque_Nm")])


@dataclass(frozen=True)
class BetweenTicks:
    """How currents follow their commands in a rig with this motor: dead_s, lag_s."""

    motor: MotorConfig
    dead_s: float
    lag_s: float

    @classmethod
    def of(cls, motor: MotorConfig, truth: RigTruth) -> "BetweenTicks":
        """Return it for a rig."""
        inverter = truth.inverter
        return cls(motor, inverter.dead_time_s, 1 / (2 * np.pi * inverter.bandwidth_Hz))

    def truth(self, at_ticks: np.ndarray) -> np.ndarray:
        """Return angle, speed and torque at PARTS instants for each of the ticks (COLUMNS)."""
        from scipy.interpolate import CubicSpline  # 0.2 s, of whoever asks for less

        t_s = (at_ticks["t_ns"] - at_ticks["t_ns"][0]) * 1e-9
        part_s = float(np.median(np.diff(t_s))) * np.arange(PARTS) / PARTS
        fine_s = (t_s[:-1, None] + part_s).ravel()
        i_A = stacked(at_ticks, CURRENTS)
        fine = np.empty(fine_s.size, _FINE)
        fine["angle_rad"] = CubicSpline(t_s, at_ticks["angle_rad"])(fine_s)
        fine["speed_rad_s"] = np.interp(fine_s, t_s, at_ticks["speed_rad_s"])
        smooth_Nm = at_ticks["torque_Nm"] - self._torque_Nm(i_A, at_ticks["angle_rad"])
        fine["torque_Nm"] = CubicSpline(t_s, smooth_Nm)(fine_s)
        fine["torque_Nm"] += self._torque_Nm(self._currents_A(i_A, part_s), fine["angle_rad"])
        return fine

    def _torque_Nm(self, i_A: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
        """Return the torque (n,) of currents (n, 3) at angles (n,)."""
        table = self.motor.back_emf_table()
        point_rad = 2 * np.pi / len(table) * np.arange(len(table))
        k = [np.interp(angle_rad, point_rad, one, period=2 * np.pi) for one in table.T]
        return np.asarray((i_A * np.transpose(k)).sum(axis=1))

    def _currents_A(self, i_A: np.ndarray, part_s: np.ndarray) -> np.ndarray:
        """Return the currents (parts (n - 1), 3) `part_s` (parts,) after all ticks but the last."""
        from scipy.signal import lfilter, lfiltic

        period_s = PARTS * part_s[1]
        dead_s = self.dead_s % period_s
        old, new = np.exp(-dead_s / self.lag_s), np.exp(-(period_s - dead_s) / self.lag_s)
        feedback = np.array([1.0, new * (1 - old) / (1 - new)])
        driven_A = (i_A[1:] - new * old * i_A[:-1]) / (1 - new)
        begin = np.stack([lfiltic([1.0], feedback, [first]) for first in i_A[0]], axis=1)
        after_A, _ = lfilter([1.0], feedback, driven_A, axis=0, zi=begin)
        before_A = np.concatenate([i_A[:1], after_A[:-1]])
        turn_A = before_A + (i_A[:-1] - before_A) * old
        s = part_s[:, None]
        early_A = before_A[:, None] + (i_A[:-1] - before_A)[:, None] * np.exp(-s / self.lag_s)
        gone = np.exp(-np.maximum(s - dead_s, 0.0) / self.lag_s)
        late_A = after_A[:, None] + (turn_A - after_A)[:, None] * gone
        return np.asarray(np.where(s < dead_s, early_A, late_A).reshape(-1, 3))
