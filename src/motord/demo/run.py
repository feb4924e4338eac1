"""The whole story in virtual time: mesh without compensation, calibration, mesh with it.

Everything is read back from the recordings. The truth that the simulation records beside the
ticks is used for the verdict alone: the root-mean-square error of the true torque.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from motord.atomic_write import write_whole
from motord.calibration import Calibration
from motord.config import Config
from motord.demo.files import Files
from motord.demo.judge import Errors, Verdict, judge
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult, rms_errors
from motord.experiments.plans import build
from motord.recording.captures import captures
from motord.recording.reader import open_run
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.sequencing import Plan
from motord.simulate import PlanSource, record_plan
from motord.virtual.mesh import processors

QUICK = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.6, 0.9], "turns": 8}
"""The mesh of `--quick`: enough to see the effect, not to quote it."""

Progress = Callable[[str, float], None]
"""Called with a stage of STAGES and the fraction of it that is done."""

BEFORE, CALIBRATE, IDENTIFY, AFTER = STAGES = (
    "mesh without compensation",
    "calibration mesh",
    "identification",
    "mesh with compensation",
)


@dataclass(frozen=True)
class Demo:
    """What a demo found."""

    files: Files
    config: Config
    truth: RigTruth
    before: Verdict
    after: Verdict
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
    source = PlanSource.of()
    config = source.config
    seeds = iter(np.random.SeedSequence(seed).generate_state(3).tolist())
    mesh = QUICK if quick else {}
    off, on = {**mesh, "compensate": "off"}, {**mesh, "compensate": "on"}
    bench_s = 0.0
    with processors() as pool:

        def take(
            stage: str, plan: Plan, path: Path, calibration: Calibration | None = None
        ) -> float:
            return record_plan(
                source, plan, path, next(seeds), calibration, pool, partial(progress, stage)
            )

        bench_s += take(BEFORE, build("verify", config, off), files.before)
        judged = pool.submit(judge, config, files.before)
        plan = build("calibrate", config, mesh)
        bench_s += take(CALIBRATE, plan, files.calibrate)
        joint, residual = _identify(config, files.calibrate, progress)
        calibration = joint.to_calibration(config.motor, datetime.now(UTC), [files.calibrate.name])
        plan = build("verify", config, on)
        bench_s += take(AFTER, plan, files.after, calibration)
        after = judge(config, files.after)
        before = judged.result()
    calibration = calibration.with_rms_error(rms_errors([*before.ripples, *after.ripples]))
    calibration.save(files.calibration)
    truth = load_truth(config.bench.rig)
    summary = _summary(truth, files, before.true_percent, after.true_percent)
    summary |= {"joint": _gains(joint), "residual": _gains(residual)}
    summary |= {"wall_s": round(time.monotonic() - began, 2), "bench_s": round(bench_s, 1)}
    write_whole(files.result, json.dumps(summary, indent=2) + "\n")
    return Demo(files, config, truth, before, after, joint, residual, calibration, summary)


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


def _summary(truth: RigTruth, files: Files, before: Errors, after: Errors) -> dict[str, Any]:
    """Return what `motord demo --json` prints, but for the estimates and times."""
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


def _mean_and_max(errors: Errors) -> dict[str, float]:
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
