"""A simulated bench: plans recorded in virtual time one after the other, and its calibration."""

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.config import packaged
from motord.config.text.editing import with_values
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult, Estimate
from motord.experiments.plans import build
from motord.experiments.subject import Recordings, Subject
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.simulate import PlanSource, record_plan

StageProgress = Callable[[str, float], None]
"""Called with the stage that is under way and the fraction of it that is done."""

MOST_RUNS = 16
"""Recordings for which a bench has seeds."""

AS_IN_THE_REPORT: Mapping[str, Mapping[str, Any]] = {"calibrate": {"directions": "forwards"}}
"""Settings of plans other than their defaults: the rotor of Poels 2008 turned one way."""


@dataclass(frozen=True)
class Calibrated:
    """What both estimators found, and the calibration that the joint one gives."""

    joint: CalibrationResult
    residual: CalibrationResult
    calibration: Calibration


class SimulatedBench:
    """Records plans on a simulated rig; keeps account of recordings and time on the bench."""

    def __init__(self, source: PlanSource, pool: ProcessPoolExecutor, seed: int) -> None:
        self.source, self.subject = source, Subject.of_config(source.config)
        self.truth: RigTruth = load_truth(source.config.bench.rig)
        self.runs: list[Path] = []
        self.bench_s = 0.0
        self._pool = pool
        self._seeds = iter(np.random.SeedSequence(seed).generate_state(MOST_RUNS).tolist())

    def seed(self) -> int:
        """Return the next seed."""
        return int(next(self._seeds))

    def record(
        self,
        name: str,
        settings: Mapping[str, Any],
        path: Path,
        progress: Callable[[float], None],
        calibration: Calibration | None = None,
    ) -> Recordings:
        """Record plan `name` with `settings` to `path` and return the opened recording.

        Raises PlanError, PlanFailed, RecordError, OSError.
        """
        plan = build(name, self.source.config, {**AS_IN_THE_REPORT.get(name, {}), **settings})
        recorded = record_plan(
            self.source, plan, path, self.seed(), calibration, self._pool, progress
        )
        self.bench_s += recorded.bench_s
        self.runs.append(path)
        return Recordings.open([path])

    def calibrate(self, run: Recordings, progress: Callable[[float], None]) -> Calibrated:
        """Identify the bench from a run of `calibrate`. Raises IdentifyError."""
        readings: dict[str, int] = {}

        def read(phase: str, part: float) -> None:
            number = readings.setdefault(phase, len(readings))
            progress(0.9 * (number + part) / (number + 1))

        taken = Calibrator.of_runs(run.runs, self.subject, read)
        joint, residual = taken.joint(), taken.residual()
        progress(1.0)
        made = joint.to_calibration(self.subject.motor, datetime.now(UTC), run.names)
        return Calibrated(joint, residual, made)


def true_estimate(truth: RigTruth, counts: int) -> Estimate:
    """Return what is true of a rig as an estimate without errors, to compare with."""
    cogging = [(h.order, h.amplitude_Nm, h.phase_rad) for h in truth.motor.cogging]
    return Estimate.of_truth(truth.inverter.alpha, truth.inverter.beta_A, cogging, counts)


def with_rig(source: PlanSource, rig: str) -> PlanSource:
    """Return the same bench, model and text, with another packaged rig.

    Raises ConfigError if the text has no table [bench].
    """
    bench = source.config.bench.model_copy(update={"rig": packaged(rig)})
    config = source.config.model_copy(update={"bench": bench})
    return PlanSource(config, with_values(source.text, "bench", {"rig": rig}, rig))
