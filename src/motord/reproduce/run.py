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
from motord.experiments.back_emf.command import measured_back_emf
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.cogging.command import measured_cogging
from motord.experiments.cogging.estimate import compare
from motord.experiments.cogging.result import Comparison, MeasuredCogging
from motord.experiments.inertia import command as inertia
from motord.experiments.inertia.oscillation import Oscillation
from motord.experiments.inertia.torque_step import Acceleration
from motord.experiments.ripple.estimate import Explained, explained
from motord.experiments.sensitivity.estimate import sensitivity
from motord.experiments.sensitivity.result import Sensitivity
from motord.experiments.subject import Subject
from motord.recording.reader import Run
from motord.reproduce.bench import Calibrated, SimulatedBench, StageProgress, with_rig
from motord.reproduce.demo import SMALL_MESH
from motord.reproduce.learning import PASSES, Learned, learn_virtual
from motord.rig.truth import RigTruth
from motord.simulate import PlanSource
from motord.virtual.mesh import processors

STAGES = (
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
    inertia_subject: Subject
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

    def __init__(self, folder: Path, quick: bool) -> None:
        self._folder, self.quick = folder, quick
        self.runs: list[Path] = []

    def take(
        self,
        bench: SimulatedBench,
        name: str,
        progress: Callable[[float], None],
        calibration: Calibration | None = None,
    ) -> Run:
        """Record plan `name` and return the opened recording."""
        settings = QUICK.get(name, {}) if self.quick else {}
        path = self._folder / f"{len(self.runs) + 1:02d}-{name}.mcap"
        self.runs.append(path)
        return bench.record(name, settings, path, progress, calibration)


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
        return _all_experiments(_Recorder(Path(name), quick), folder, seed, pool, progress)


def _all_experiments(
    recorder: _Recorder,
    folder: Path,
    seed: int,
    pool: ProcessPoolExecutor,
    progress: StageProgress,
) -> Results:
    began_s = time.monotonic()
    plain = PlanSource.of()
    swing = SimulatedBench(PlanSource.of(packaged("inertia.toml")), pool, seed + 1)
    main = SimulatedBench(plain, pool, seed + 2)
    nonlinear = SimulatedBench(with_rig(plain, NONLINEAR_RIG), pool, seed + 3)
    oscillation, acceleration = _inertia(recorder, swing, main, progress)
    cogging, back_emf = _driven(recorder, main, progress)
    calibrated = _calibrate(recorder, main, progress, 0.0, 0.5)
    nonlinear_calibration = _calibrate(recorder, nonlinear, progress, 0.5, 1.0).calibration
    calibration = calibrated.calibration
    calibration.save(folder / "calibration.json")
    both = (
        _verify(recorder, main, calibration, progress, 0.0),
        _verify(recorder, nonlinear, nonlinear_calibration, progress, 0.5),
    )
    induced = _sensitivity(recorder, main, calibration, progress)
    learned = _learn(nonlinear, nonlinear_calibration, recorder.quick, pool, progress)
    return Results(
        oscillation, acceleration, swing.subject, swing.truth, main.subject, main.truth,
        cogging, compare(cogging, calibration), back_emf, calibrated, both, induced, learned,
        runs=tuple(recorder.runs),
        wall_s=time.monotonic() - began_s,
        bench_s=swing.bench_s + main.bench_s + nonlinear.bench_s + learned.bench_s,
    )  # fmt: skip


def _part(progress: StageProgress, stage: str, first: float, last: float, fraction: float) -> None:
    progress(stage, first + (last - first) * fraction)


def _inertia(
    recorder: _Recorder, swing: SimulatedBench, main: SimulatedBench, progress: StageProgress
) -> tuple[Oscillation, Acceleration]:
    stage = partial(_part, progress, STAGES[0])
    run = recorder.take(swing, "inertia-oscillation", partial(stage, 0.0, 0.4))
    oscillation = inertia.oscillation([run], swing.subject)
    stage(0.0, 0.6, 1.0)
    run = recorder.take(main, "inertia-acceleration", partial(stage, 0.6, 0.9))
    acceleration = inertia.acceleration([run], main.subject)
    stage(0.0, 1.0, 1.0)
    return oscillation, acceleration


def _driven(
    recorder: _Recorder, main: SimulatedBench, progress: StageProgress
) -> tuple[MeasuredCogging, MeasuredBackEmf]:
    stage = partial(_part, progress, STAGES[1])
    run = recorder.take(main, "cogging", partial(stage, 0.0, 0.3))
    cogging = measured_cogging([run], main.subject)
    stage(0.0, 0.5, 1.0)
    run = recorder.take(main, "back-emf", partial(stage, 0.5, 0.8))
    back_emf = measured_back_emf([run], main.subject)
    stage(0.0, 1.0, 1.0)
    return cogging, back_emf


def _calibrate(
    recorder: _Recorder, bench: SimulatedBench, progress: StageProgress, first: float, last: float
) -> Calibrated:
    middle = 0.5 * (first + last)
    stage = partial(_part, progress, STAGES[2])
    run = recorder.take(bench, "calibrate", partial(stage, first, middle))
    return bench.calibrate(run, partial(stage, middle, last))


def _verify(
    recorder: _Recorder,
    bench: SimulatedBench,
    calibration: Calibration,
    progress: StageProgress,
    first: float,
) -> tuple[Explained, ...]:
    stage = partial(_part, progress, STAGES[3])
    run = recorder.take(bench, "verify", partial(stage, first, first + 0.25), calibration)
    found = tuple(explained([run], bench.subject, calibration))
    stage(0.0, first + 0.5, 1.0)
    return found


def _sensitivity(
    recorder: _Recorder, main: SimulatedBench, calibration: Calibration, progress: StageProgress
) -> Sensitivity:
    stage = partial(_part, progress, STAGES[4])
    run = recorder.take(main, "sensitivity", partial(stage, 0.0, 0.5), calibration)
    found = sensitivity([run], main.subject)
    stage(0.0, 1.0, 1.0)
    return found


def _learn(
    nonlinear: SimulatedBench,
    calibration: Calibration,
    quick: bool,
    pool: ProcessPoolExecutor,
    progress: StageProgress,
) -> Learned:
    passes = 2 if quick else PASSES
    begun: list[str] = []

    def in_pass(name: str, fraction: float) -> None:
        if name not in begun:
            begun.append(name)
        progress(STAGES[5], (len(begun) - 1 + fraction) / passes)

    mesh = QUICK["learn"] if quick else None
    config = nonlinear.source.config
    learned = learn_virtual(config, calibration, nonlinear.seed(), passes, mesh, pool, in_pass)
    progress(STAGES[5], 1.0)
    return learned


def save_summary(path: Path, found: Results, rows: Mapping[str, Any]) -> None:
    """Write what was found beside the report's numbers, JSON. Raises OSError."""
    content = {
        "schema": "motord.reproduction/1",
        "runs": [run.name for run in found.runs],
        "wall_s": round(found.wall_s, 2),
        "bench_s": round(found.bench_s, 1),
        **rows,
    }
    write_whole(path, json.dumps(content, indent=1) + "\n")
