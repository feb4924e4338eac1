"""`motord demo`: mesh without compensation, calibration, mesh with it, all in virtual time.

The shortest part of `motord reproduce`. Everything is read back from the recordings. The truth
that the simulation records besides the ticks serves the evaluation alone: the root-mean-square
error of the true torque.
"""

import json
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from motord.atomic_write import write_whole
from motord.calibration import Calibration
from motord.config import Config
from motord.experiments.calibration import report as calibration_report
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.ripple import report as ripple
from motord.identification.point_ripple import rms_errors
from motord.report.html import Page
from motord.report.plots.mesh import in_percent
from motord.report.plots.torque import TorqueCurve
from motord.reproduce.bench import Calibrated, SimulatedBench, StageProgress, true_estimate
from motord.reproduce.evaluate import CELLS, Errors, Ripple, evaluate
from motord.rig.truth import RigTruth
from motord.simulate import PlanSource
from motord.virtual.mesh import processors

SMALL_MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.6, 0.9], "turns": 8}
"""The mesh of `--quick`: enough to see the effect, not to quote it."""

BEFORE, CALIBRATE, IDENTIFY, AFTER = STAGES = (
    "mesh without compensation",
    "calibration mesh",
    "identification",
    "mesh with compensation",
)

FILES = {
    "before": "verify-off.mcap",
    "calibrate": "calibrate.mcap",
    "after": "verify-on.mcap",
    "calibration": "calibration.json",
    "report": "report.html",
}
"""What a demo leaves in its folder, in addition to `demo.json`; by their names in that."""

HIGHEST_ORDER = 300

LEAD = (
    "A simulated bench was taken over a mesh of torques and speeds, calibrated from its "
    "own torque sensor, and taken over the mesh again with compensation. The errors "
    "shown are those of the true torque, between the loop's ticks as well, which the controller "
    "never sees."
)


@dataclass(frozen=True)
class Demo:
    """What a demo found. files: by their names in FILES; calibration: with the RMS errors."""

    files: dict[str, Path]
    config: Config
    truth: RigTruth
    before: Ripple
    after: Ripple
    calibrated: Calibrated
    calibration: Calibration
    summary: dict[str, Any]


def run_demo(folder: Path, seed: int, quick: bool, progress: StageProgress) -> Demo:
    """Run the demo on the packaged simulated rig, leaving files in `folder`.

    Raises OSError or RecordError where a file cannot be written, PlanFailed, IdentifyError.
    """
    began = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*FILES.values(), "demo.json"):
        (folder / name).unlink(missing_ok=True)
        (folder / f"{name}.part").unlink(missing_ok=True)
    files = {name: folder / file for name, file in FILES.items()}
    mesh = SMALL_MESH if quick else {}
    off, on = {**mesh, "compensate": "off"}, {**mesh, "compensate": "on"}
    with processors() as pool:
        bench = SimulatedBench(PlanSource.of(), pool, seed)
        config = bench.source.config
        bench.record("verify", off, files["before"], partial(progress, BEFORE))
        evaluating = pool.submit(evaluate, config, files["before"])
        run = bench.record("calibrate", mesh, files["calibrate"], partial(progress, CALIBRATE))
        found = bench.calibrate(run, partial(progress, IDENTIFY))
        after_progress = partial(progress, AFTER)
        bench.record("verify", on, files["after"], after_progress, found.calibration)
        after = evaluate(config, files["after"])
        before = evaluating.result()
    scale = config.accuracy.torque_scale
    ripples = [one.with_scale_error(scale) for one in (*before.ripples, *after.ripples)]
    calibration = found.calibration.with_rms_error(rms_errors(ripples))
    calibration.save(files["calibration"])
    summary = _summary(bench.truth, files, before.true_percent, after.true_percent)
    summary |= {"joint": _gains(found.joint), "residual": _gains(found.residual)}
    summary |= {"wall_s": round(time.monotonic() - began, 2), "bench_s": round(bench.bench_s, 1)}
    write_whole(folder / "demo.json", json.dumps(summary, indent=2) + "\n")
    return Demo(files, config, bench.truth, before, after, found, calibration, summary)


def _summary(
    truth: RigTruth, files: dict[str, Path], before: Errors, after: Errors
) -> dict[str, Any]:
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
        "files": {name: str(file) for name, file in files.items()},
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


def write_report(demo: Demo) -> None:
    """Write the page of a demo. Raises OSError."""
    before, after = demo.before, demo.after
    page = Page("motord demo: torque ripple before and after calibration", LEAD)
    page.cards(_key_figures(demo.summary["before"], demo.summary["after"]))
    ripple.fill_mesh(page, before.true_percent, after.true_percent, "true torque")
    torque_Nm, speed_Hz = before.shown
    pole_pairs = demo.config.motor.pole_pairs
    orders = range(pole_pairs, HIGHEST_ORDER, pole_pairs)
    label = f"{torque_Nm:g} Nm, {speed_Hz:g} turns/s"
    ripple.fill_torque(page, label, _curve(before), _curve(after), orders)
    estimates = (
        ("joint estimator", demo.calibrated.joint),
        ("residual estimator (2008 report)", demo.calibrated.residual),
    )
    truth = true_estimate(demo.truth, demo.config.motor.counts)
    calibration_report.fill(page, estimates, ("truth", truth))
    page.heading("About these figures")
    page.points(demo.calibration.observable)
    page.facts(_facts(demo))
    page.write(demo.files["report"])


def _key_figures(before: dict[str, float], after: dict[str, float]) -> list[tuple[str, str]]:
    return [
        (f"{in_percent(before['mean'])} %", "mean RMS error of the true torque, before"),
        (f"{in_percent(after['mean'])} %", "mean RMS error of the true torque, after"),
        (f"{in_percent(after['max'])} %", "of the true torque at the worst operating point, after"),
        (f"{before['mean'] / after['mean']:.0f} \u00d7", "smoother on average, by the true torque"),
    ]


def _facts(demo: Demo) -> tuple[tuple[str, str], ...]:
    motor, summary = demo.config.motor, demo.summary
    return (
        ("motor", f"{motor.name}, {motor.slots} slots, {2 * motor.pole_pairs} poles"),
        ("encoder", f"{motor.counts} counts a turn"),
        ("loop", f"{demo.config.loop.rate_Hz} Hz"),
        ("calibration", demo.calibration.id),
        ("bench time", f"{summary['bench_s']:.0f} s, computed in {summary['wall_s']:.0f} s"),
        ("recordings", ", ".join(FILES[name] for name in ("before", "calibrate", "after"))),
    )


def _curve(found: Ripple) -> TorqueCurve:
    return TorqueCurve(
        angle_rad=2 * np.pi * (np.arange(CELLS) + 0.5) / CELLS,
        torque_Nm=found.turn_Nm,
        order=np.arange(1, HIGHEST_ORDER + 1),
        amplitude_Nm=np.abs(np.fft.rfft(found.turn_Nm)[1 : HIGHEST_ORDER + 1] * 2 / CELLS),
    )
