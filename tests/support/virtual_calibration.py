"""Calibration and verification without recordings, of given points and of the simulated rig."""

from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from typing import Any

from motord.calibration import Calibration
from motord.config import Config, MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult, Method
from motord.experiments.plans import build
from motord.identification.operating_points import PointData, split
from motord.reproduce.evaluate import Errors
from motord.reproduce.learning import place_of, true_error_percent
from motord.rig.truth import load as load_truth
from motord.sequencing import Plan
from motord.virtual.mesh import run_points


def calibrate(
    points: Iterable[PointData],
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    method: Method = "joint",
) -> CalibrationResult:
    """Identify alpha, beta and cogging torque. Raises IdentifyError where the data do not."""
    all_points = list(points)
    calibrator = Calibrator(motor, sensor, lambda: all_points)
    for point in all_points:
        calibrator.add(point)
    return calibrator.result(method)


def calibrate_virtual(
    config: Config,
    seed: int,
    mesh: Mapping[str, Any] | None = None,
    pool: ProcessPoolExecutor | None = None,
) -> Calibration:
    """Return the calibration of the simulated rig of `config`. Raises IdentifyError, PlanFailed."""
    plan = build("calibrate", config, mesh)

    def points() -> Iterator[PointData]:
        for piece in run_points(config, plan, seed, None, pool):
            yield from split(piece.ticks, [piece.point])

    calibrator = Calibrator(config.motor, config.torque_sensor, points)
    for point in points():
        calibrator.add(point)
    return calibrator.joint().to_calibration(config.motor, datetime.now(UTC), ["calibrate"])


def verify_virtual(
    config: Config,
    calibration: Calibration,
    seed: int,
    plan: Plan,
    pool: ProcessPoolExecutor | None = None,
) -> Errors:
    """Return the RMS errors of the true torque that `plan` finds with `calibration` in force."""
    rig = load_truth(config.bench.rig)
    return {
        place_of(piece): true_error_percent(piece, rig, config.motor.rated_torque_Nm)
        for piece in run_points(config, plan, seed, calibration, pool)
    }
