"""All experiments of Poels 2008, one after the other: record in virtual time, read, analyse."""

import json
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from motord.atomic_write import write_whole
from motord.calibration import Calibration
from motord.config import packaged
from motord.experiments.back_emf import command as back_emf
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.cogging import command as cogging
from motord.experiments.cogging.estimate import compare
from motord.experiments.cogging.result import Comparison, MeasuredCogging
from motord.experiments.inertia import command as inertia
from motord.experiments.inertia.acceleration import Acceleration
from motord.experiments.inertia.oscillation import Oscillation
from motord.experiments.ripple.estimate import Explained, explained
from motord.experiments.sensitivity.estimate import sensitivity
from motord.experiments.sensitivity.result import Sensitivity
from motord.experiments.subject import Recordings, Subject
from motord.reproduce.bench import Calibrated, SimulatedBench, StageProgress, with_rig
from motord.reproduce.demo import SMALL_MESH
from motord.reproduce.learning import PASSES, Learned, learn_virtual
from motord.rig.truth import RigTruth
from motord.simulate import PlanSource
from motord.virtual.mesh import processors

INERTIA, DRIVEN, CALIBRATION, VERIFICATION, SENSITIVITY, LEARNING = STAGES = (
    "moment of inertia",
    "driven rotor",
    "calibration",
    "verification",
    "sensitivity",
    "learning",
)

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
class Results:
    """Results of all experiments; truth is that of the simulated rigs.

    explained: of the verification with sensors that are linear, and with such as the report's.
    """

    oscillation: Oscillation
    acceleration: Acceleration
    inertia_truth: RigTruth
    subject: Subject
    truth: RigTruth
    cogging: MeasuredCogging
    comparison: Comparison
    back_emf: MeasuredBackEmf
    calibrated: Calibrated
    explained: tuple[tuple[Explained, ...], tuple[Explained, ...]]
    sensitivity: Sensitivity
    learned: Learned
    runs: tuple[Path, ...]
    wall_s: float
    bench_s: float


class _Recorder:
    """Records the plans of all benches into one folder, numbered in the order of recording."""

    def __init__(self, folder: Path, quick: bool, progress: StageProgress) -> None:
        self._folder, self.quick, self.progress = folder, quick, progress
        self.runs: list[Path] = []

    def take(
        self,
        bench: SimulatedBench,
        name: str,
        progress: Callable[[float], None],
        calibration: Calibration | None = None,
    ) -> Recordings:
        """Record plan `name` and return the opened recording."""
        settings = QUICK.get(name, {}) if self.quick else {}
        path = self._folder / f"{len(self.runs) + 1:02d}-{name}.mcap"
        self.runs.append(path)
        return bench.record(name, settings, path, progress, calibration)

    def part(self, stage: str, first: float, last: float) -> Callable[[float], None]:
        """Return the progress of a part of a stage, between two fractions of it."""
        return lambda fraction: self.progress(stage, first + (last - first) * fraction)


def reproduce(
    folder: Path, seed: int, quick: bool, keep_recordings: bool, progress: StageProgress
) -> Results:
    """Run all experiments, leaving results in `folder`, which must be empty.

    The recordings, about 1 GB, are removed at the end unless `keep_recordings`; until then they
    are in a folder of their own under `folder`, whose disk was chosen, while /tmp may be memory.
    Raises OSError, RecordError, PlanFailed, IdentifyError, AnalysisError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    removed = partial(TemporaryDirectory, prefix="recordings-", dir=folder)
    with nullcontext(str(folder)) if keep_recordings else removed() as name, processors() as pool:
        return _all_experiments(_Recorder(Path(name), quick, progress), folder, seed, pool)


def _all_experiments(
    recorder: _Recorder, folder: Path, seed: int, pool: ProcessPoolExecutor
) -> Results:
    began_s = time.monotonic()
    plain = PlanSource.of()
    swing = SimulatedBench(PlanSource.of(packaged("inertia.toml")), pool, seed + 1)
    main = SimulatedBench(plain, pool, seed + 2)
    nonlinear = SimulatedBench(with_rig(plain, NONLINEAR_RIG), pool, seed + 3)
    oscillation, acceleration = _inertia(recorder, swing, main)
    cogging_torque, voltages = _driven(recorder, main)
    calibrated = _calibrate(recorder, main, 0.0)
    nonlinear_calibration = _calibrate(recorder, nonlinear, 0.5).calibration
    calibration = calibrated.calibration
    calibration.save(folder / "calibration.json")
    both = (
        _verify(recorder, main, calibration, 0.0),
        _verify(recorder, nonlinear, nonlinear_calibration, 0.5),
    )
    run = recorder.take(main, "sensitivity", recorder.part(SENSITIVITY, 0.0, 0.5), calibration)
    induced = sensitivity(run.runs, main.subject)
    recorder.progress(SENSITIVITY, 1.0)
    learned = _learn(recorder, nonlinear, nonlinear_calibration, pool)
    return Results(
        oscillation, acceleration, swing.truth, main.subject, main.truth,
        cogging_torque, compare(cogging_torque, calibration), voltages,
        calibrated, both, induced, learned,
        runs=tuple(recorder.runs),
        wall_s=time.monotonic() - began_s,
        bench_s=swing.bench_s + main.bench_s + nonlinear.bench_s + learned.bench_s,
    )  # fmt: skip


def _inertia(
    recorder: _Recorder, swing: SimulatedBench, main: SimulatedBench
) -> tuple[Oscillation, Acceleration]:
    run = recorder.take(swing, "inertia-oscillation", recorder.part(INERTIA, 0.0, 0.4))
    oscillation = inertia.oscillation(run.runs, swing.subject)
    run = recorder.take(main, "inertia-acceleration", recorder.part(INERTIA, 0.6, 0.9))
    acceleration = inertia.acceleration(run.runs, main.subject)
    recorder.progress(INERTIA, 1.0)
    return oscillation, acceleration


def _driven(recorder: _Recorder, main: SimulatedBench) -> tuple[MeasuredCogging, MeasuredBackEmf]:
    found = cogging.estimate(recorder.take(main, "cogging", recorder.part(DRIVEN, 0.0, 0.3)))
    run = recorder.take(main, "back-emf", recorder.part(DRIVEN, 0.5, 0.8))
    voltages = back_emf.estimate(run)
    recorder.progress(DRIVEN, 1.0)
    return found, voltages


def _calibrate(recorder: _Recorder, bench: SimulatedBench, first: float) -> Calibrated:
    """Take one half of the stage, from `first` on."""
    part = partial(recorder.part, CALIBRATION)
    run = recorder.take(bench, "calibrate", part(first, first + 0.25))
    return bench.calibrate(run, part(first + 0.25, first + 0.5))


def _verify(
    recorder: _Recorder, bench: SimulatedBench, calibration: Calibration, first: float
) -> tuple[Explained, ...]:
    """Take one half of the stage, from `first` on."""
    part = recorder.part(VERIFICATION, first, first + 0.25)
    run = recorder.take(bench, "verify", part, calibration)
    found = tuple(explained(run.runs, bench.subject, calibration, EveryCapture()))
    recorder.progress(VERIFICATION, first + 0.5)
    return found


def _learn(
    recorder: _Recorder,
    nonlinear: SimulatedBench,
    calibration: Calibration,
    pool: ProcessPoolExecutor,
) -> Learned:
    passes, mesh = (2, QUICK["learn"]) if recorder.quick else (PASSES, None)
    config, part = nonlinear.source.config, recorder.part(LEARNING, 0.0, 1.0)
    learned = learn_virtual(config, calibration, nonlinear.seed(), passes, mesh, pool, part)
    part(1.0)
    return learned


def save_summary(path: Path, found: Results, rows: Mapping[str, Any]) -> None:
    """Write what was found next to the report's numbers, JSON. Raises OSError."""
    content = {
        "schema": "motord.reproduction/1",
        "runs": [run.name for run in found.runs],
        "wall_s": round(found.wall_s, 2),
        "bench_s": round(found.bench_s, 1),
        **rows,
    }
    write_whole(path, json.dumps(content, indent=1) + "\n")
