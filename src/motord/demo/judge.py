"""How smooth a simulated run was: as the torque sensor shows it, and in truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord.config import Config
from motord.identification.operating_points import prepare
from motord.identification.point_ripple import PointRipple, point_ripple
from motord.identification.ripple import rms_error_percent
from motord.recording.captures import TrueTorque, captures, true_torque
from motord.recording.reader import open_run

Errors = dict[tuple[float, float], float]
"""RMS error in percent of rated torque by (torque_Nm, speed_Hz)."""

CELLS = 1024
"""Parts of a turn over which the true torque is averaged for the picture."""


@dataclass(frozen=True)
class Verdict:
    """Ripple of every point: measured, true by (torque_Nm, speed_Hz), and over the turn of one.

    turn_Nm (CELLS,): true torque without its mean at the point `shown`, averaged by angle.
    """

    ripples: tuple[PointRipple, ...]
    true_percent: Errors
    shown: tuple[float, float]
    turn_Nm: np.ndarray


def judge(config: Config, path: Path) -> Verdict:
    """Return the verdict on the simulated run at `path`."""
    motor, sensor = config.motor, config.torque_sensor
    run = open_run(path)
    ripples = tuple(
        point_ripple(prepare(point, motor.counts), motor, sensor) for point in captures(run)
    )
    true_percent: Errors = {}
    turns: dict[tuple[float, float], np.ndarray] = {}
    for true in true_torque(run):
        key = true.torque_set_Nm, true.speed_Hz
        true_percent[key] = rms_error_percent(true.torque_Nm, motor.rated_torque_Nm, true.weights)
        turns[key] = _over_turn(true)
    shown = _middle(list(true_percent))
    return Verdict(ripples, true_percent, shown, turns[shown])


def _middle(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the point in the middle of the mesh."""
    torques_Nm, speeds_Hz = (sorted({p[k] for p in points}) for k in (0, 1))
    return torques_Nm[len(torques_Nm) // 2], speeds_Hz[(len(speeds_Hz) - 1) // 2]


def _over_turn(true: TrueTorque) -> np.ndarray:
    """Return the torque averaged in CELLS parts of the turn, less its mean."""
    cell = np.floor(true.angle_rad / (2 * np.pi) * CELLS).astype(int) % CELLS
    sums = np.bincount(cell, true.weights * true.torque_Nm, CELLS)
    weights = np.bincount(cell, true.weights, CELLS)
    known = weights > 0
    centres = np.arange(CELLS)
    mean = np.interp(centres, centres[known], sums[known] / weights[known], period=CELLS)
    turn: np.ndarray = mean - mean.mean()
    return turn
