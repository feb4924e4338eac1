"""Phase order, encoder direction and zero from recordings of `align`: result, JSON, report."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from motord.config import MotorConfig
from motord.experiments.alignment.estimate import Alignment, align
from motord.experiments.alignment.report import AlignReport
from motord.experiments.alignment.rests import REQUIRED
from motord.experiments.calibration.content import facts
from motord.experiments.subject import AnalysisError, Subject
from motord.identification.operating_points import good_points
from motord.recording.reader import Run

SCHEMA = "motord.align/1"
PLAN = "align"

POORLY_POINTS = 2.0
"""95 % limit of the zero, in encoder points, beyond which it is worth more stops."""

GAIN_APART = 0.1
"""Difference of a phase's sensed from its commanded current that is worth a word."""


def found_alignment(runs: Sequence[Run], subject: Subject) -> Alignment:
    """Return the alignment over all sweeps of the runs. Raises AnalysisError, IdentifyError."""
    sweeps = [ticks for run in runs for ticks in _sweeps(run)]
    if not sweeps:
        names = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{names}: the plan was ended before a sweep was over: start it anew")
    return align(sweeps, subject.motor)


def _sweeps(run: Run) -> list[np.ndarray]:
    name = str(run.metadata.get("plan", {}).get("name", ""))
    if name != PLAN:
        said = f"is of the plan {name}" if name else "names no plan"
        raise AnalysisError(f"{run.path}: {said}; needed: {PLAN}")
    points = good_points(run.operating_points())
    return [
        run.ticks(REQUIRED, from_ns=int(point["t_start_ns"]), to_ns=int(point["t_end_ns"]))
        for point in points
    ]


def fields(found: Alignment) -> dict[str, str | int | float]:
    """Return what belongs into `[motor]` of the bench file."""
    return {
        "phase_order": found.phase_order,
        "encoder_direction": found.direction,
        "encoder_offset_rad": round(found.offset_rad, 6),
    }


def align_json(subject: Subject, runs: Sequence[str], found: Alignment) -> dict[str, Any]:
    """Return the result as it is written."""
    motor = subject.motor
    return {
        "schema": SCHEMA,
        "bench": subject.bench,
        "motor": {
            "name": motor.name,
            "serial": motor.serial,
            "pole_pairs": motor.pole_pairs,
            "counts": motor.counts,
        },
        "runs": list(runs),
        "fields": fields(found),
        "told": _told(motor),
        "encoder_offset_stderr_rad": found.offset_stderr_rad,
        "encoder_offset_stderr_points": points_of(found.offset_stderr_rad, motor),
        "pole_pairs": found.pole_pairs,
        "friction_Nm": found.friction_Nm,
        "friction_rad": found.friction_rad,
        "friction_points": points_of(found.friction_rad, motor),
        "torque_sensor": {
            "shows_direction": found.sign_seen,
            "explained": found.answer.explained[0],
            "explained_reversed": found.answer.explained[1],
        },
        "current_gain": list(found.gains),
        "rests": int(found.rests.still.size),
        "rests_left_out": found.left_out,
        "notes": notes(found, motor),
    }


def points_of(angle_rad: float, motor: MotorConfig) -> float:
    """Return an angle in encoder points."""
    return angle_rad * motor.counts / (2 * np.pi)


def _told(motor: MotorConfig) -> dict[str, Any]:
    return {name: getattr(motor, name) for name in
            ("phase_order", "encoder_direction", "encoder_offset_rad")}  # fmt: skip


def off_points(found: Alignment, motor: MotorConfig) -> float | None:
    """Return how far the told zero is off in encoder points; None if it is of another direction."""
    if (motor.phase_order, motor.encoder_direction) != (found.phase_order, found.direction):
        return None
    turn_rad = 2 * np.pi / motor.pole_pairs
    off_rad = motor.encoder_offset_rad - found.offset_rad
    return points_of((off_rad + turn_rad / 2) % turn_rad - turn_rad / 2, motor)


def notes(found: Alignment, motor: MotorConfig) -> list[str]:
    """Return what is worth knowing of the result, in words."""
    off = off_points(found, motor)
    if off is None:
        words = ["the bench file has it otherwise: torque would not be what is asked for"]
    elif abs(off) > 0.5 + 1.96 * points_of(found.offset_stderr_rad, motor):
        words = [f"the bench file's zero is {off:+.1f} encoder points off"]
    else:
        words = [f"the bench file has it right, its zero within {abs(off):.2f} encoder points"]
    if not found.sign_seen:
        words.append(
            "the torque sensor does not show the rotor's swings, so it does not say which way is "
            "forwards: it was taken as that in which the encoder counts up as told; does the "
            "sensor work?"
        )
    for phase, gain in zip("abc", found.gains, strict=True):
        if abs(gain - 1) > GAIN_APART:
            words.append(
                f"phase {phase}: sensed current is {gain:.2f} times the commanded one; are its "
                "scales right?"
            )
    if 1.96 * points_of(found.offset_stderr_rad, motor) > POORLY_POINTS:
        words.append(
            "the zero is not known well: take more stops (rests, turns), or two currents, which "
            "tell cogging from the rest"
        )
    if found.left_out > found.rests.still.size // 4:
        words.append(
            f"{found.left_out} of {found.rests.still.size} stops are left out, as the rotor still "
            "moved: a longer hold_s or more brake would use them"
        )
    return words


def align_report(subject: Subject, runs: Sequence[str], found: Alignment) -> AlignReport:
    """Return the content of the report."""
    motor, rests = subject.motor, found.rests
    still = rests.still
    return AlignReport(
        title="Phase order, encoder direction and zero",
        lead=f"{motor.name} on bench {subject.bench}",
        facts=facts(None, subject, runs),
        fields=tuple((name, str(value)) for name, value in fields(found).items()),
        told=tuple(str(value) for value in _told(motor).values()),
        stderr_points=points_of(found.offset_stderr_rad, motor),
        pole_pairs=found.pole_pairs,
        friction_Nm=found.friction_Nm,
        friction_points=points_of(found.friction_rad, motor),
        counts=motor.counts,
        vector_turns=rests.electrical_rad / (2 * np.pi),
        encoder_turns=rests.encoder_rad / (2 * np.pi),
        amplitude_A=np.abs(rests.vector_A),
        way=rests.way,
        still=still,
        electrical_deg=np.degrees(found.angle_rad * motor.pole_pairs) % 360,
        apart_points=points_of(1.0, motor) * found.apart_rad,
        left_points=points_of(1.0, motor) * found.left_rad,
        motion_Nm=found.answer.motion_Nm,
        torque_Nm=found.answer.torque_Nm,
        explained=found.answer.explained[0],
        notes=tuple(notes(found, motor)),
    )
