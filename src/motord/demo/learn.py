"""Learning in virtual time: passes over the mesh, each with what the ones before have taught."""

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.demo.judge import Errors
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.ilc.analysis import LearnPass, finish, learn, learn_report, stairs
from motord.experiments.ilc.estimate import Learning
from motord.experiments.ilc.report import LearnReport
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.identification.operating_points import PointData, split
from motord.identification.ripple import rms_error_percent
from motord.recording.captures import true_torque_of
from motord.sequencing import Plan
from motord.virtual.mesh import MeshPiece, run_points

PASSES = 5
"""Passes of which the last one only measures."""

Progress = Callable[[str, float], None]
"""Called with what is under way and the fraction of it that is done."""


@dataclass(frozen=True)
class Learned:
    """What learning did: the passes, and the RMS error of the true torque in each of them.

    The first pass had the calibration alone. `truth` is by (torque_Nm, speed_Hz), in percent.
    """

    passes: tuple[LearnPass, ...]
    truth: tuple[Errors, ...]
    bench_s: float

    @property
    def calibration(self) -> Calibration:
        """The calibration with what was learned."""
        return self.passes[-1].calibration

    @property
    def before(self) -> Errors:
        """True errors with the calibration alone."""
        return self.truth[0]

    @property
    def after(self) -> Errors:
        """True errors in the last pass."""
        return self.truth[-1]


def calibrate_virtual(
    config: Config, seed: int, mesh: Mapping[str, Any] | None = None,
    pool: ProcessPoolExecutor | None = None,
) -> Calibration:  # fmt: skip
    """Return the calibration of the simulated rig of `config`. Raises IdentifyError, PlanFailed."""
    calibrator = Calibrator(config.motor, config.torque_sensor)
    for piece in run_points(config, build("calibrate", config, mesh), seed, None, pool):
        for point in split(piece.ticks, [piece.point]):
            calibrator.add(point)
    return calibrator.joint().to_calibration(config.motor, datetime.now(UTC), ["calibrate"])


def learn_virtual(
    config: Config,
    calibration: Calibration,
    seed: int,
    passes: int = PASSES,
    mesh: Mapping[str, Any] | None = None,
    pool: ProcessPoolExecutor | None = None,
    progress: Progress = lambda stage, fraction: None,
) -> Learned:
    """Learn on the simulated rig of `config` on top of `calibration`, as `motord learn` does.

    Raises PlanError, PlanFailed, AnalysisError, IdentifyError.
    """
    plan = build("learn", config, mesh)
    subject = Subject.of_config(config)
    learning = Learning(stairs=stairs(config.inverter))
    done: list[LearnPass] = []
    truth: list[Errors] = []
    ticks = 0
    for number, own_seed in enumerate(np.random.SeedSequence(seed).generate_state(passes), 1):
        name = f"learn-{number}"
        points: list[PointData] = []
        errors: Errors = {}
        for piece in run_points(config, plan, int(own_seed), calibration, pool):
            points += _captured(piece)
            errors[_place(piece)] = _true_percent(piece, config.motor.rated_torque_Nm)
            ticks += piece.ticks.size
            progress(name, len(errors) / len(plan.points))
        now = datetime.now(UTC)
        taken = learn(points, subject, calibration, [name], now, learning)
        done.append(finish(taken, now) if number == passes else taken)
        truth.append(errors)
        calibration = done[-1].calibration
        if done[-1].finished:
            break
    return Learned(tuple(done), tuple(truth), ticks / config.loop.rate_Hz)


def verify_virtual(
    config: Config,
    calibration: Calibration,
    seed: int,
    plan: Plan,
    pool: ProcessPoolExecutor | None = None,
) -> Errors:
    """Return the RMS errors of the true torque that `plan` finds with `calibration` in force."""
    return {
        _place(piece): _true_percent(piece, config.motor.rated_torque_Nm)
        for piece in run_points(config, plan, seed, calibration, pool)
    }


def learned_report(learned: Learned) -> LearnReport:
    """Return the content of a report with the errors of the true torque."""
    measured = learn_report(learned.passes[-1])
    return replace(
        measured,
        panels=(("Calibrated", learned.before), ("Learned", learned.after)),
        passes={place: tuple(e[place] for e in learned.truth) for place in learned.before},
        torque_meaning="true torque",
    )


def _captured(piece: MeshPiece) -> list[PointData]:
    """Return what was captured, apart from the memory that goes with the piece."""
    return [
        PointData(p.torque_Nm, p.speed_Hz, p.ticks.copy(), p.compensate)
        for p in split(piece.ticks, [piece.point])
    ]


def _place(piece: MeshPiece) -> tuple[float, float]:
    return float(piece.point["torque_Nm"]), float(piece.point["speed_Hz"])


def _true_percent(piece: MeshPiece, rated_Nm: float) -> float:
    bounds = (int(piece.point["t_start_ns"]), int(piece.point["t_end_ns"]))
    first, end = np.searchsorted(piece.truth["t_ns"], [bounds[0], bounds[1] + 1])
    true = true_torque_of(piece.point, piece.truth[first:end])
    return rms_error_percent(true.torque_Nm, rated_Nm, true.weights)
