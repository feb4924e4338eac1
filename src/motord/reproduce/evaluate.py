"""Torque ripple of a simulated run: as the torque sensor shows it, and of the true torque.

Between two ticks a current follows the command that is held, with a dead time d and a lag L:

    i(t) = u + (i(d) - u) exp(-(t - d) / L),    before d the same with the command before.

Both ends are known, so the commands u follow one from the other; what is assumed of the first is
forgotten from the beginning on or, where the dead time is long, from the end on. Torque less that
of the currents is smooth from tick to tick: cubic splines. Truth at ticks alone has images of the
held currents folded onto the orders of the turn, as any sampled torque.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord.calibration import TorqueSpeed
from motord.config import Config
from motord.config.motor import back_emf_waves
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.ripple.estimate import middle_point, ripples
from motord.experiments.subject import Subject
from motord.identification.point_ripple import PointRipple, rms_error_percent
from motord.identification.resample import fill_gaps
from motord.recording.captures import TrueTorque, true_torque
from motord.recording.reader import open_run
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth

PARTS = 10
"""Instants for each tick."""

CURRENTS = ("i_a_A", "i_b_A", "i_c_A")
COLUMNS = ("t_ns", "angle_rad", "speed_rad_s", "torque_Nm", *CURRENTS)
_FINE = np.dtype([(name, float) for name in ("angle_rad", "speed_rad_s", "torque_Nm")])

Errors = dict[TorqueSpeed, float]
"""RMS error in percent of rated torque by (torque_Nm, speed_Hz)."""

CELLS = 1024
"""Parts of a turn over which the true torque is averaged for the picture."""


@dataclass(frozen=True)
class BetweenTicks:
    """What a rig does between the ticks: its currents follow commands of phase currents."""

    rig: RigTruth

    def truth(self, at_ticks: np.ndarray) -> np.ndarray:
        """Return angle, speed and torque at PARTS instants for each of the ticks (COLUMNS).

        The last instant is that of the last tick.
        """
        from scipy.interpolate import CubicSpline  # 0.2 s, of whoever asks for less

        t_s = (at_ticks["t_ns"] - at_ticks["t_ns"][0]) * 1e-9
        part_s = float(np.median(np.diff(t_s))) * np.arange(PARTS) / PARTS
        fine_s = np.append((t_s[:-1, None] + part_s).ravel(), t_s[-1])
        i_A = np.array([at_ticks[name] for name in CURRENTS], float)
        fine = np.empty(fine_s.size, _FINE)
        fine["angle_rad"] = CubicSpline(t_s, at_ticks["angle_rad"])(fine_s)
        fine["speed_rad_s"] = np.interp(fine_s, t_s, at_ticks["speed_rad_s"])
        smooth_Nm = at_ticks["torque_Nm"] - self._torque_Nm(i_A, at_ticks["angle_rad"])
        fine["torque_Nm"] = CubicSpline(t_s, smooth_Nm)(fine_s)
        fine_A = np.concatenate([self._currents_A(i_A, part_s), i_A[:, -1:]], axis=1)
        fine["torque_Nm"] += self._torque_Nm(fine_A, fine["angle_rad"])
        return fine

    def _torque_Nm(self, i_A: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
        """Return the torque (n,) of currents (3, n) at angles (n,)."""
        motor, order = self.rig.motor, self.rig.inverter.phase_order
        k = back_emf_waves(motor.back_emf, motor.pole_pairs * angle_rad, order).T
        return np.asarray(i_A[0] * k[0] + i_A[1] * k[1] + i_A[2] * k[2])

    def _currents_A(self, i_A: np.ndarray, part_s: np.ndarray) -> np.ndarray:
        """Return the currents (3, parts (n - 1)) `part_s` (parts,) after all ticks but the last."""
        period_s = PARTS * part_s[1]
        lag_s = 1 / (2 * np.pi * self.rig.inverter.bandwidth_Hz)
        dead_s = self.rig.inverter.dead_time_s % period_s
        old, new = np.exp(-dead_s / lag_s), np.exp(-(period_s - dead_s) / lag_s)
        first_A = i_A[:, :-1]
        command_A = _commands_A(i_A[:, 1:] - new * old * first_A, new * (1 - old), 1 - new, i_A)
        before_A, after_A = command_A[:, :-1], command_A[:, 1:]
        turn_A = before_A + (first_A - before_A) * old
        fine_A = np.empty((*first_A.shape, part_s.size))
        early = np.exp(-part_s / lag_s)
        late = np.exp(-np.maximum(part_s - dead_s, 0.0) / lag_s)
        for part, s in enumerate(part_s):
            if s < dead_s:
                fine_A[:, :, part] = before_A + (first_A - before_A) * early[part]
            else:
                fine_A[:, :, part] = after_A + (turn_A - after_A) * late[part]
        return fine_A.reshape(3, -1)


def _commands_A(driven_A: np.ndarray, before: float, after: float, i_A: np.ndarray) -> np.ndarray:
    """Return the commands u (3, n) of `before` u_m + `after` u_(m+1) = driven_A_m (3, n - 1).

    Solved in the direction in which errors get smaller. One of the ends, which the equations leave
    open, is taken for the current i_A (3, n) there.
    """
    from scipy.signal import lfilter, lfiltic  # 0.3 s, of whoever asks for less

    if backwards := before > after:
        driven_A, i_A, before, after = driven_A[:, ::-1], i_A[:, ::-1], after, before
    feedback = np.array([1.0, before / after])
    begin = np.stack([lfiltic([1.0], feedback, [first]) for first in i_A[:, 0]])
    rest_A, _ = lfilter([1.0], feedback, driven_A / after, axis=1, zi=begin)
    command_A = np.concatenate([i_A[:, :1], rest_A], axis=1)
    return command_A[:, ::-1] if backwards else command_A


@dataclass(frozen=True)
class Ripple:
    """Ripple of every point: measured, true by (torque_Nm, speed_Hz), and over the turn of one.

    turn_Nm (CELLS,): true torque without its mean at the point `shown`, averaged by angle.
    """

    ripples: tuple[PointRipple, ...]
    true_percent: Errors
    shown: tuple[float, float]
    turn_Nm: np.ndarray


def evaluate(config: Config, path: Path) -> Ripple:
    """Return the ripple of the simulated run at `path`."""
    run, motor = open_run(path), config.motor
    measured = tuple(ripples([run], Subject.of_config(config), EveryCapture()))
    true_percent: Errors = {}
    turns: dict[TorqueSpeed, np.ndarray] = {}
    between = BetweenTicks(load_truth(config.bench.rig))
    for true in true_torque(run, COLUMNS, between.truth):
        key = true.torque_set_Nm, true.speed_Hz
        true_percent[key] = rms_error_percent(true.torque_Nm, motor.rated_torque_Nm, true.weights)
        turns[key] = _over_turn(true)
    shown = middle_point(list(true_percent))
    return Ripple(measured, true_percent, shown, turns[shown])


def _over_turn(true: TrueTorque) -> np.ndarray:
    """Return the torque averaged in CELLS parts of the turn, less its mean."""
    cell = np.floor(true.angle_rad / (2 * np.pi) * CELLS).astype(int) % CELLS
    sums = np.bincount(cell, true.weights * true.torque_Nm, CELLS)
    weights = np.bincount(cell, true.weights, CELLS)
    with np.errstate(invalid="ignore"):
        mean = fill_gaps(sums / weights)
    return np.asarray(mean - mean.mean())
