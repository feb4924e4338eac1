"""Torque ripple of a simulated run: as the torque sensor shows it, and of the true torque."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord.calibration import TorqueSpeed
from motord.config import Config
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.ripple.estimate import middle_point, ripples
from motord.experiments.subject import Subject
from motord.identification.point_ripple import PointRipple, rms_error_percent
from motord.identification.resample import fill_gaps
from motord.recording.captures import TrueTorque, true_torque
from motord.recording.reader import open_run
from motord.reproduce.between_ticks import COLUMNS, BetweenTicks
from motord.rig.truth import load as load_truth

Errors = dict[TorqueSpeed, float]
"""RMS error in percent of rated torque by (torque_Nm, speed_Hz)."""

CELLS = 1024
"""Parts of a turn over which the true torque is averaged for the picture."""


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
