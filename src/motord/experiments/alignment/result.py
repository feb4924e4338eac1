"""The result of an alignment: what belongs into `[motor]`, how well it is known, what to mind."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from motord.config import MotorConfig
from motord.experiments.alignment.estimate import Alignment, align
from motord.experiments.alignment.rests import REQUIRED
from motord.experiments.subject import AnalysisError, Subject
from motord.identification.operating_points import good_points
from motord.recording.reader import Run, bounds_of

PLAN = "align"

POORLY_POINTS = 2.0
"""95 % limit of the zero, in encoder points, beyond which it is worth more stops."""

GAIN_APART = 0.1
"""Difference of a phase's sensed from its commanded current that is worth a word."""


@dataclass(frozen=True)
class AlignmentResult:
    """An alignment, with the `[motor]` of the bench file that it was taken with."""

    JSON: ClassVar[dict[str, str]] = {
        "fields": "fields",
        "told": "configured",
        "encoder_offset_stderr_rad": "alignment.offset_stderr_rad",
        "encoder_offset_stderr_points": "offset_stderr_points",
        "pole_pairs": "alignment.pole_pairs",
        "friction_Nm": "alignment.friction_Nm",
        "friction_rad": "alignment.friction_rad",
        "friction_points": "friction_points",
        "torque_sensor": "torque_sensor",
        "current_gain": "alignment.gains",
        "rests": "rests",
        "rests_left_out": "alignment.left_out",
        "notes": "notes",
    }

    alignment: Alignment
    motor: MotorConfig

    @property
    def fields(self) -> dict[str, str | int | float]:
        """What belongs into `[motor]` of the bench file."""
        return {
            "phase_order": self.alignment.phase_order,
            "encoder_direction": self.alignment.direction,
            "encoder_offset_rad": round(self.alignment.offset_rad, 6),
        }

    @property
    def configured(self) -> dict[str, str | int | float]:
        """What the bench file says of the same."""
        return {name: getattr(self.motor, name) for name in self.fields}

    @property
    def torque_sensor(self) -> dict[str, bool | float]:
        """Whether the torque sensor shows the direction, and how much of its variance that is."""
        explained, reversed_explained = self.alignment.answer.explained
        return {
            "shows_direction": self.alignment.sign_seen,
            "explained": explained,
            "explained_reversed": reversed_explained,
        }

    @property
    def rests(self) -> int:
        """Number of stops at which the rotor was still."""
        return int(self.alignment.rests.still.size)

    @property
    def offset_stderr_points(self) -> float:
        """Standard error of the zero in encoder points."""
        return self.points(self.alignment.offset_stderr_rad)

    @property
    def friction_points(self) -> float:
        """How far friction takes a single stop off, in encoder points."""
        return self.points(self.alignment.friction_rad)

    def points(self, angle_rad: float) -> float:
        """Return an angle in encoder points."""
        return angle_rad * self.motor.counts / (2 * np.pi)

    @property
    def off_points(self) -> float | None:
        """How far the configured zero is off, in encoder points; None in another direction."""
        motor, found = self.motor, self.alignment
        if (motor.phase_order, motor.encoder_direction) != (found.phase_order, found.direction):
            return None
        turn_rad = 2 * np.pi / motor.pole_pairs
        off_rad = motor.encoder_offset_rad - found.offset_rad
        return self.points((off_rad + turn_rad / 2) % turn_rad - turn_rad / 2)

    @property
    def notes(self) -> list[str]:
        """What is worth knowing of the result, in sentences."""
        off = self.off_points
        if off is None:
            notes = ["the bench file has it otherwise: torque would not be what is asked for"]
        elif abs(off) > 0.5 + 1.96 * self.offset_stderr_points:
            notes = [f"the bench file's zero is {off:+.1f} encoder points off"]
        else:
            notes = [f"the bench file has it right, its zero within {abs(off):.2f} encoder points"]
        if not self.alignment.sign_seen:
            notes.append(
                "the torque sensor does not show the rotor's swings, so it does not say which way "
                "is forwards: it was taken as that in which the encoder counts up by the bench "
                "file; does the sensor work?"
            )
        for phase, gain in zip("abc", self.alignment.gains, strict=True):
            if abs(gain - 1) > GAIN_APART:
                notes.append(
                    f"phase {phase}: sensed current is {gain:.2f} times the commanded one; are its "
                    "scales right?"
                )
        if 1.96 * self.offset_stderr_points > POORLY_POINTS:
            notes.append(
                "the zero is not known well: take more stops (rests, turns), or two currents, "
                "which tell cogging from the rest"
            )
        if self.alignment.left_out > self.alignment.rests.still.size // 4:
            notes.append(
                f"{self.alignment.left_out} of {self.alignment.rests.still.size} stops are left "
                "out, as the rotor still moved: a longer hold_s or more brake would use them"
            )
        return notes


def found_alignment(runs: Sequence[Run], subject: Subject) -> AlignmentResult:
    """Return the alignment over all sweeps of the runs. Raises AnalysisError, IdentifyError."""
    sweeps = [ticks for run in runs for ticks in _sweeps(run)]
    if not sweeps:
        names = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{names}: the plan was ended before a sweep was over: start it anew")
    return AlignmentResult(align(sweeps, subject.motor), subject.motor)


def _sweeps(run: Run) -> list[np.ndarray]:
    name = str(run.metadata.get("plan", {}).get("name", ""))
    if name != PLAN:
        said = f"is of the plan {name}" if name else "names no plan"
        raise AnalysisError(f"{run.path}: {said}; needed: {PLAN}")
    points = good_points(run.operating_points())
    return [run.ticks(REQUIRED, **bounds_of(point)) for point in points]
