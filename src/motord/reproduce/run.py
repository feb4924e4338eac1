"""All experiments, one after the other: record in virtual time, read back, analyse."""

import json
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from motord.atomic_write import write_whole
from motord.calibration import Calibration
from motord.config import packaged
from motord.demo.learn import Learned, learn_virtual
from motord.experiments.back_emf.command import measured_back_emf
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.recordings import calibrator, explained
from motord.experiments.cogging.command import measured_cogging
from motord.experiments.cogging.estimate import Comparison, MeasuredCogging, compare
from motord.experiments.inertia import command as inertia
from motord.experiments.inertia.oscillation import Oscillation
from motord.experiments.inertia.torque_step import Acceleration
from motord.experiments.plans import build
from motord.experiments.ripple.reconstruct import Explained
from motord.experiments.sensitivity.estimate import sensitivity
from motord.experiments.sensitivity.result import Sensitivity
from motord.experiments.subject import Subject
from motord.recording.reader import Run, open_run
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.simulate import PlanSource, record_plan
from motord.virtual.mesh import processors

STAGES = (
    "moment of inertia",
    "driven rotor",
    "calibration",
    "verification",
    "sensitivity",
    "learning",
)

Progress = Callable[[str, float], None]
"""Called with a stage of STAGES and the fraction of it that is done."""

SMALL_MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.6, 0.9], "turns": 8}
QUICK: Mapping[str, Mapping[str, Any]] = {
    "inertia-oscillation": {"repeats": 4},
    "cogging": {"speeds_Hz": [0.6, 0.9], "turns": 8},
    "back-emf": {"speeds_Hz": [0.6, 0.9], "turns": 8},
    "calibrate": {**SMALL_MESH, "gain_steps": []},
    "verify": SMALL_MESH,
    "sensitivity": {
        "alpha_a_steps": 5, "beta_a_steps": 5, "cogging_steps": 5, "delta_epsilon_steps": 5,
        "turns": 6, "again_torques_Nm": [2.0, 4.0], "again_speeds_Hz": [0.6, 0.9],
    },
    "learn": {**SMALL_MESH, "turns": 6},
}  # fmt: skip
"""Settings of `--quick`: enough to see every picture, not to quote a number."""

NONLINEAR_RIG = "nonlinear.rig.toml"


@dataclass(frozen=True)
class Found:
    """What the experiments gave; truth is that of the simulated rigs.

    explained: of the verification with sensors that are linear, and with such as the report's.
    """

    oscillation: Oscillation
    acceleration: Acceleration
    inertia_subject: Subject
    inertia_truth: RigTruth
    subject: Subject
    truth: RigTruth
    cogging: MeasuredCogging
    comparison: Comparison
    back_emf: MeasuredBackEmf
    joint: CalibrationResult
    residual: CalibrationResult
    calibration: Calibration
    explained: tuple[tuple[Explained, ...], tuple[Explained, ...]]
    sensitivity: Sensitivity
    learned: Learned
    runs: tuple[Path, ...]
    wall_s: float
    bench_s: float


class _Bench:
    """Records plans on a simulated rig and keeps account of them."""

    def __init__(
        self, source: PlanSource, folder: Path, quick: bool, pool: ProcessPoolExecutor, seed: int
    ) -> None:
        self.source, self.subject = source, Subject.of_config(source.config)
        self._folder, self._quick, self._pool = folder, quick, pool
        self._seeds = iter(np.random.SeedSequence(seed).generate_state(16).tolist())
        self.runs: list[Path] = []
        self.bench_s = 0.0

    @property
    def truth(self) -> RigTruth:
        """What is true of the rig."""
        return load_truth(self.source.config.bench.rig)

    def seed(self) -> int:
        """Return the next seed."""
        return int(next(self._seeds))

    def take(
        self, name: str, progress: Callable[[float], None], calibration: Calibration | None = None
    ) -> Run:
        """Record plan `name` and return the opened recording."""
        settings = QUICK.get(name, {}) if self._quick else {}
        plan = build(name, self.source.config, settings)
        path = self._folder / f"{len(list(self._folder.glob('*.mcap'))) + 1:02d}-{name}.mcap"
        self.bench_s += record_plan(
            self.source, plan, path, self.seed(), calibration, self._pool, progress
        )
        self.runs.append(path)
        return open_run(path)


def with_rig(source: PlanSource, rig: str) -> PlanSource:
    """Return the same bench with another packaged rig."""
    config, before = source.config, source.config.bench.rig
    bench = config.bench.model_copy(update={"rig": packaged(rig)})
    old = before.name if before else ""
    return PlanSource(config.model_copy(update={"bench": bench}), source.text.replace(old, rig, 1))


def reproduce(folder: Path, seed: int, quick: bool, progress: Progress) -> Found:
    """Run all experiments, leaving recordings and results in `folder`, which must be empty.

    Raises OSError, RecordError, PlanFailed, IdentifyError, AnalysisError.
    """
    began_s = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    plain = PlanSource.of()
    with processors() as pool:

        def bench(source: PlanSource, number: int) -> _Bench:
            return _Bench(source, folder, quick, pool, seed + number)

        swing = bench(PlanSource.of(packaged("inertia.toml")), 1)
        main, bent = bench(plain, 2), bench(with_rig(plain, NONLINEAR_RIG), 3)
        oscillation, acceleration = _inertia(swing, main, progress)
        driven = _driven(main, progress)
        joint, residual, calibration = _calibrate(main, progress, "calibration", 0.0, 0.5)
        _, _, bent_calibration = _calibrate(bent, progress, "calibration", 0.5, 1.0)
        calibration.save(folder / "calibration.json")
        both = (
            _verify(main, calibration, progress, 0.0),
            _verify(bent, bent_calibration, progress, 0.5),
        )
        practice = _sensitivity(main, calibration, progress)
        learned = _learn(bent, bent_calibration, quick, pool, progress)
    cogging, back_emf = driven
    comparison = compare(cogging, calibration)
    benches = (swing, main, bent)
    return Found(
        oscillation, acceleration, swing.subject, swing.truth, main.subject, main.truth,
        cogging, comparison, back_emf, joint, residual, calibration, both, practice, learned,
        runs=tuple(sorted(path for one in benches for path in one.runs)),
        wall_s=time.monotonic() - began_s,
        bench_s=sum(one.bench_s for one in benches) + learned.bench_s,
    )  # fmt: skip


def _part(progress: Progress, stage: str, first: float, last: float, fraction: float) -> None:
    progress(stage, first + (last - first) * fraction)


def _inertia(swing: _Bench, main: _Bench, progress: Progress) -> tuple[Oscillation, Acceleration]:
    stage = partial(_part, progress, STAGES[0])
    run = swing.take("inertia-oscillation", partial(stage, 0.0, 0.4))
    oscillation = inertia.oscillation([run], swing.subject)
    stage(0.0, 0.6, 1.0)
    run = main.take("inertia-acceleration", partial(stage, 0.6, 0.9))
    acceleration = inertia.acceleration([run], main.subject)
    stage(0.0, 1.0, 1.0)
    return oscillation, acceleration


def _driven(main: _Bench, progress: Progress) -> tuple[MeasuredCogging, MeasuredBackEmf]:
    stage = partial(_part, progress, STAGES[1])
    run = main.take("cogging", partial(stage, 0.0, 0.3))
    cogging = measured_cogging([run], main.subject)
    stage(0.0, 0.5, 1.0)
    run = main.take("back-emf", partial(stage, 0.5, 0.8))
    back_emf = measured_back_emf([run], main.subject)
    stage(0.0, 1.0, 1.0)
    return cogging, back_emf


def _calibrate(
    bench: _Bench, progress: Progress, stage: str, first: float, last: float
) -> tuple[CalibrationResult, CalibrationResult, Calibration]:
    middle = 0.5 * (first + last)
    run = bench.take("calibrate", partial(_part, progress, stage, first, middle))
    taken = calibrator([run], bench.subject)
    joint, residual = taken.joint(), taken.residual()
    progress(stage, last)
    made = joint.to_calibration(bench.subject.motor, datetime.now(UTC), [run.path.name])
    return joint, residual, made


def _verify(
    bench: _Bench, calibration: Calibration, progress: Progress, first: float
) -> tuple[Explained, ...]:
    stage = partial(_part, progress, STAGES[3])
    run = bench.take("verify", partial(stage, first, first + 0.25), calibration)
    found = tuple(explained([run], bench.subject, calibration))
    stage(0.0, first + 0.5, 1.0)
    return found


def _sensitivity(main: _Bench, calibration: Calibration, progress: Progress) -> Sensitivity:
    stage = partial(_part, progress, STAGES[4])
    run = main.take("sensitivity", partial(stage, 0.0, 0.5), calibration)
    found = sensitivity([run], main.subject)
    stage(0.0, 1.0, 1.0)
    return found


def _learn(
    bent: _Bench,
    calibration: Calibration,
    quick: bool,
    pool: ProcessPoolExecutor,
    progress: Progress,
) -> Learned:
    passes = 2 if quick else 5
    done: list[str] = []

    def told(name: str, fraction: float) -> None:
        if name not in done:
            done.append(name)
        progress(STAGES[5], (len(done) - 1 + fraction) / passes)

    mesh = QUICK["learn"] if quick else None
    config = bent.source.config
    learned = learn_virtual(config, calibration, bent.seed(), passes, mesh, pool, told)
    progress(STAGES[5], 1.0)
    return learned


def save_summary(path: Path, found: Found, rows: Mapping[str, Any]) -> None:
    """Write what was found beside the report's numbers, JSON. Raises OSError."""
    content = {
        "schema": "motord.reproduction/1",
        "runs": [run.name for run in found.runs],
        "wall_s": round(found.wall_s, 2),
        "bench_s": round(found.bench_s, 1),
        **rows,
    }
    write_whole(path, json.dumps(content, indent=1) + "\n")
