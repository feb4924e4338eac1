"""The whole story in virtual time: mesh without compensation, calibration, mesh with it.

Everything is read back from the recordings. The truth that the simulation records beside the
ticks is used for the verdict alone: the root-mean-square error of the true torque.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.config import Config, load, packaged
from motord.identify.calibrate import Calibrator
from motord.identify.points import prepare
from motord.identify.result import CalibrationResult, rms_errors
from motord.identify.ripple import rms_error_percent
from motord.identify.verify import PointRipple, point_ripple
from motord.plans import build
from motord.record.captures import captures, true_torque
from motord.record.metadata import describe
from motord.record.reader import open_run
from motord.record.writer import RunWriter
from motord.rig.truth import RigTruth
from motord.virtual import VirtualBench
from motord.virtual_plan import run_plan

QUICK = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.6, 0.9], "turns": 8}
"""The mesh of `--quick`: enough to see the effect, not to quote it."""

CHUNK_S = 1.0
"""Time that one chunk of a recording spans; nothing here dies, so chunks may be large."""

Progress = Callable[[str, float], None]
"""Called with a stage of STAGES and the fraction of it that is done."""

BEFORE, CALIBRATE, IDENTIFY, AFTER = STAGES = (
    "mesh without compensation",
    "calibration mesh",
    "identification",
    "mesh with compensation",
)


@dataclass(frozen=True)
class Files:
    """What a demo leaves behind in its folder."""

    folder: Path

    @property
    def before(self) -> Path:
        """The mesh without compensation."""
        return self.folder / "verify-off.mcap"

    @property
    def calibrate(self) -> Path:
        """The run that the calibration came from."""
        return self.folder / "calibrate.mcap"

    @property
    def after(self) -> Path:
        """The mesh with compensation."""
        return self.folder / "verify-on.mcap"

    @property
    def calibration(self) -> Path:
        """The calibration file."""
        return self.folder / "calibration.json"

    @property
    def result(self) -> Path:
        """What `demo --json` prints."""
        return self.folder / "demo.json"

    @property
    def report(self) -> Path:
        """The report."""
        return self.folder / "report.html"

    def remove(self) -> None:
        """Remove what an earlier demo left here."""
        runs = (self.before, self.calibrate, self.after)
        for file in (*runs, self.calibration, self.result, self.report):
            file.unlink(missing_ok=True)
            file.with_name(f"{file.name}.part").unlink(missing_ok=True)


@dataclass(frozen=True)
class Demo:
    """What a demo found."""

    files: Files
    config: Config
    truth: RigTruth
    joint: CalibrationResult
    residual: CalibrationResult
    calibration: Calibration
    summary: dict[str, Any]


def run_demo(folder: Path, seed: int, quick: bool, progress: Progress) -> Demo:
    """Run the demo on the packaged simulated rig, leaving files in `folder`.

    Raises OSError or RecordError where a file cannot be written, PlanFailed, IdentifyError.
    """
    began = time.monotonic()
    files = Files(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files.remove()
    config = load()
    bench = VirtualBench(config, seed=seed)
    mesh = QUICK if quick else {}
    _record(bench, "verify", {**mesh, "compensate": "off"}, files.before, BEFORE, progress)
    _record(bench, "calibrate", mesh, files.calibrate, CALIBRATE, progress)
    joint, residual = _identify(config, files.calibrate, progress)
    calibration = joint.to_calibration(config.motor, datetime.now(UTC), [files.calibrate.name])
    bench.install(calibration)
    settings = {**mesh, "compensate": "on"}
    _record(bench, "verify", settings, files.after, AFTER, progress, calibration.id)
    ripples = [*_ripples(config, files.before), *_ripples(config, files.after)]
    calibration = calibration.with_rms_error(rms_errors(ripples))
    calibration.save(files.calibration)
    summary = _summary(bench, files, joint, residual)
    summary |= {"wall_s": round(time.monotonic() - began, 2), "bench_s": round(bench.t_s, 1)}
    files.result.write_text(json.dumps(summary, indent=2) + "\n")
    return Demo(files, config, bench.truth, joint, residual, calibration, summary)


def _record(
    bench: VirtualBench,
    name: str,
    settings: dict[str, Any],
    path: Path,
    stage: str,
    progress: Progress,
    calibration_id: str = "",
) -> None:
    """Run a plan on the bench and write ticks, truth, points and plan into `path`."""
    plan = build(name, bench.config, settings)
    described = {"name": name, "settings": plan.settings}
    text = packaged("sim.toml").read_text()
    metadata = describe(bench.config, text, plan=described, calibration_id=calibration_id)
    with RunWriter(path, metadata, chunk_s=CHUNK_S) as writer:

        def on_block(ticks: np.ndarray, truth: np.ndarray) -> None:
            writer.ticks(ticks)
            writer.truth(truth)

        def on_progress(state: dict[str, Any]) -> None:
            writer.plan(bench.t_ns, state)
            progress(stage, state["fraction"])

        def on_point(point: dict[str, Any]) -> None:
            writer.operating_point(int(point["t_end_ns"]), point)

        run_plan(bench, plan, on_block, on_point, on_progress)
    progress(stage, 1.0)


def _identify(
    config: Config, path: Path, progress: Progress
) -> tuple[CalibrationResult, CalibrationResult]:
    """Return the joint and the residual estimator's results from the run at `path`."""
    run = open_run(path)
    calibrator = Calibrator(config.motor, config.torque_sensor)
    points = len(run.operating_points())
    for number, point in enumerate(captures(run), start=1):
        calibrator.add(point)
        progress(IDENTIFY, 0.9 * number / points)
    results = calibrator.joint(), calibrator.residual()
    progress(IDENTIFY, 1.0)
    return results


def _ripples(config: Config, path: Path) -> list[PointRipple]:
    """Return the ripple that the torque sensor shows at each point of the run at `path`."""
    motor, sensor = config.motor, config.torque_sensor
    return [
        point_ripple(prepare(point, motor.counts), motor, sensor)
        for point in captures(open_run(path))
    ]


def true_errors(path: Path, rated_torque_Nm: float) -> dict[tuple[float, float], float]:
    """Return eq. (4.16) of the true torque, in percent, by (torque_Nm, speed_Hz)."""
    return {
        (torque_set_Nm, speed_Hz): rms_error_percent(torque_Nm, rated_torque_Nm, weights)
        for torque_set_Nm, speed_Hz, torque_Nm, weights in true_torque(open_run(path))
    }


def _summary(
    bench: VirtualBench, files: Files, joint: CalibrationResult, residual: CalibrationResult
) -> dict[str, Any]:
    """Return what `motord demo --json` prints."""
    rated_torque_Nm = bench.config.motor.rated_torque_Nm
    before = true_errors(files.before, rated_torque_Nm)
    after = true_errors(files.after, rated_torque_Nm)
    truth = bench.truth
    return {
        "before": _mean_and_max(before),
        "after": _mean_and_max(after),
        "points": [
            {
                "torque_Nm": torque_Nm,
                "speed_Hz": speed_Hz,
                "before": round(before[torque_Nm, speed_Hz], 4),
                "after": round(after[torque_Nm, speed_Hz], 4),
            }
            for torque_Nm, speed_Hz in sorted(before.keys() & after.keys())
        ],
        "joint": _gains(joint),
        "residual": _gains(residual),
        "truth": {
            "alpha": list(truth.inverter.alpha),
            "beta_A": list(truth.inverter.beta_A),
            "tau_cog_harmonics": [h.model_dump() for h in truth.motor.cogging],
        },
        "files": {
            name: str(getattr(files, name))
            for name in ("before", "calibrate", "after", "calibration", "report")
        },
    }


def _mean_and_max(errors: dict[tuple[float, float], float]) -> dict[str, float]:
    values = list(errors.values())
    return {"mean": round(sum(values) / len(values), 4), "max": round(max(values), 4)}


def _gains(result: CalibrationResult) -> dict[str, Any]:
    return {
        "alpha": result.alpha.tolist(),
        "alpha_stderr": result.alpha_stderr.tolist(),
        "beta_A": result.beta_A.tolist(),
        "beta_stderr_A": result.beta_stderr_A.tolist(),
        "tau_cog_harmonics": [harmonic.model_dump() for harmonic in result.harmonics],
    }
