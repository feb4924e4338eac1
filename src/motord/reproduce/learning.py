"""Iterative learning in virtual time: passes over the mesh, each with what was learned before."""

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from motord.calibration import Calibration, TorqueSpeed
from motord.config import Config
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.hold_timing import zero_order_hold
from motord.experiments.ilc.analysis import LearnPass, finish, learn
from motord.experiments.ilc.estimate import Learning
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.identification.operating_points import PointData, split
from motord.identification.point_ripple import rms_error_percent
from motord.recording.captures import true_torque_of
from motord.reproduce.evaluate import BetweenTicks, Errors
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.schema import joined
from motord.virtual.mesh import MeshPiece, run_points

PASSES = 5
"""Passes of which the last one only measures."""


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


def learn_virtual(
    config: Config,
    calibration: Calibration,
    seed: int,
    passes: int = PASSES,
    mesh: Mapping[str, Any] | None = None,
    pool: ProcessPoolExecutor | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Learned:
    """Learn on the simulated rig of `config` on top of `calibration`, as `motord learn` does.

    Raises PlanError, PlanFailed, AnalysisError, IdentifyError.
    """
    plan, rig = build("learn", config, mesh), load_truth(config.bench.rig)
    subject = Subject.of_config(config)
    learning = Learning(hold=zero_order_hold(config.inverter, 1 / config.loop.rate_Hz))
    done: list[LearnPass] = []
    truth: list[Errors] = []
    ticks = 0
    for number, own_seed in enumerate(np.random.SeedSequence(seed).generate_state(passes), 1):
        name = f"learn-{number}"
        points: list[PointData] = []
        errors: Errors = {}
        for piece in run_points(config, plan, int(own_seed), calibration, pool):
            points += _captured(piece)
            errors[place_of(piece)] = true_error_percent(piece, rig, config.motor.rated_torque_Nm)
            ticks += piece.ticks.size
            progress((number - 1 + len(errors) / len(plan.points)) / passes)
        now = datetime.now(UTC)
        taken = learn(points, subject, calibration, [name], now, learning, EveryCapture())
        done.append(finish(taken, now) if number == passes else taken)
        truth.append(errors)
        calibration = done[-1].calibration
        if done[-1].finished:
            break
    return Learned(tuple(done), tuple(truth), ticks / config.loop.rate_Hz)


def _captured(piece: MeshPiece) -> list[PointData]:
    """Return what was captured, apart from the memory that goes with the piece."""
    return [
        PointData(p.torque_Nm, p.speed_Hz, joined([p.ticks]), p.compensate)
        for p in split(piece.ticks, [piece.point])
    ]


def place_of(piece: MeshPiece) -> TorqueSpeed:
    """Return the (torque_Nm, speed_Hz) of an operating point."""
    return float(piece.point["torque_Nm"]), float(piece.point["speed_Hz"])


def true_error_percent(piece: MeshPiece, rig: RigTruth, rated_Nm: float) -> float:
    """Return the RMS error of the true torque of an operating point, between the ticks as well."""
    bounds = (int(piece.point["t_start_ns"]), int(piece.point["t_end_ns"]))
    first, end = np.searchsorted(piece.truth["t_ns"], [bounds[0], bounds[1] + 1])
    true = true_torque_of(piece.point, BetweenTicks(rig).truth(piece.truth[first:end]))
    return rms_error_percent(true.torque_Nm, rated_Nm, true.weights)
