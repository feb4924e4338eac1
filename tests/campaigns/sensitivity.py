"""Induced errors against theory, and found again: `python -m tests.campaigns.sensitivity`.

Calibrates the packaged rig, induces the errors of Poels 2008, sections 4.3 and 4.4, and prints what
is found; exits with 1 if a bound is not kept. Table 4.2 twice: by the first calibration, as the
packaged rig has just these errors, and by calibrating again from currents with the errors induced.
"""

import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.experiments.sensitivity.estimate import sensitivity
from motord.experiments.sensitivity.result import Sensitivity
from motord.experiments.subject import Subject
from motord.recording.reader import open_run
from motord.simulate import PlanSource, record_plan
from motord.virtual import processors
from tests.campaigns import seeds

SEEDS = seeds.several(3)
ALPHA = np.array([0.8, 1.118, 1.118])
BETA_A = np.array([1.0, -0.5, -0.5])

ALPHA_PERCENT = 0.5
BETA_BOUND_A = 0.02
SLOPE_PERCENT = 3.0
DIFFERENCE_PERCENT = 0.2


def experiment(seed: int, folder: Path) -> tuple[CalibrationResult, Sensitivity]:
    """Calibrate and induce errors on the packaged rig."""
    source = PlanSource.of()
    subject = Subject.of_config(source.config)
    first, second = folder / f"calibrate-{seed}.mcap", folder / f"sensitivity-{seed}.mcap"
    with processors() as pool:
        record_plan(source, build("calibrate", source.config), first, seed, pool=pool)
        result = Calibrator.of_runs([open_run(first)], subject).joint()
        calibration = result.to_calibration(subject.motor, datetime.now(UTC), [first.name])
        plan = build("sensitivity", source.config)
        record_plan(source, plan, second, 1000 + seed, calibration, pool)
    found = sensitivity([open_run(second)], subject)
    for path in (first, second):
        path.unlink()
    return result, found


def off_by(result: CalibrationResult) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of alpha in percent and of beta in A against the known errors."""
    alpha = ALPHA / np.cbrt(ALPHA.prod())
    return 100 * (result.alpha / alpha - 1), result.beta_A - BETA_A


def judge(first: CalibrationResult, found: Sensitivity) -> tuple[list[str], list[str]]:
    """Return what was found, and messages of what was not kept."""
    lines, failures = [], []
    assert found.again is not None
    for what, result in (("calibrated", first), ("calibrated again", found.again.found)):
        alpha_percent, beta_A = off_by(result)
        lines.append(f"{what}: alpha {alpha_percent.round(3)} %, beta {beta_A.round(4)} A off")
        if np.abs(alpha_percent).max() > ALPHA_PERCENT or np.abs(beta_A).max() > BETA_BOUND_A:
            failures.append(f"{what}: gains or offsets are off")
    for one in found.series:
        lines.append(
            f"{one.what}: floor {one.floor_percent:.3f} %, at most "
            f"{one.worst_difference_percent:.3f} % from the theory"
        )
        if one.worst_difference_percent > DIFFERENCE_PERCENT:
            failures.append(f"{one.what}: practice is not the theory")
        for branch in one.branches:
            if branch is None:
                failures.append(f"{one.what}: a branch has no line")
                continue
            off = 100 * (branch.slope / branch.theory_slope - 1)
            lines.append(
                f"  slope {branch.slope:.3f} +- {branch.slope_stderr:.3f}, theory "
                f"{branch.theory_slope:.3f}: {off:+.2f} %"
            )
            if one.what in ("alpha_a", "beta_a_A") and abs(off) > SLOPE_PERCENT:
                failures.append(f"{one.what}: a slope is off")
    return lines, failures


def main() -> int:
    """Run all seeds, print what they show, return the exit code."""
    failures = []
    with tempfile.TemporaryDirectory() as name:
        for seed in SEEDS:
            lines, missed = judge(*experiment(seed, Path(name)))
            print(f"seed {seed}", *lines, sep="\n")
            failures += [f"seed {seed}: {text}" for text in missed]
    for failure in failures:
        print(f"NOT KEPT: {failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
