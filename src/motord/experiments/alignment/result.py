"""The result of an alignment: what belongs into the bench file, how well it is known, findings."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from motord.config import AccuracyConfig, MotorConfig, PhaseOrder
from motord.experiments.alignment.rests import Rests
from motord.experiments.alignment.rests_checks import TorqueResponse, least_explained
from motord.findings import Finding
from motord.intervals import coverage_factor

POORLY_POINTS = 2.0
"""95 % limit of the zero, in encoder points, beyond which it is worth more stops."""

ENCODER_ERROR_ORDERS = (1, 2)
"""Orders of the turn of the encoder's own error, each within `[accuracy] encoder_error_rad`."""

GAIN_ERROR_LIMIT = 0.1
"""Difference of a phase's sensed from its commanded current, in parts, that is a finding."""


@dataclass(frozen=True)
class Alignment:
    """What was found, for `[motor]` and `[accuracy]` of the bench file, and how well.

    motor, accuracy: of the bench file that it was taken with; bench_file: into which the result
    was written. more_findings: findings of signals, and of sweeps left out.
    offset_rad is known to a whole electrical turn; it is the one nearest to zero. friction_Nm: RMS
    of the residual torque where the rotor rests; friction_rad: how far that takes a single rest
    off, part of which is in the standard error. angle_rad (n,): mechanical, of the rests used;
    deviation_rad (n,): how far each is from where the vector alone would hold it; residual_rad
    (n,): of the fit. degrees_of_freedom: of offset_stderr_rad.
    """

    JSON: ClassVar = (
        "fields", "accuracy_fields", "told=configured", "encoder_offset_rad=offset_rad",
        "encoder_offset_stderr_rad=offset_stderr_rad",
        "encoder_offset_stderr_points=offset_stderr_points", "degrees_of_freedom", "pole_pairs",
        "friction_Nm", "friction_rad", "friction_points", "torque_sensor", "current_gain=gains",
        "rests=rests.size", "rests_left_out=left_out", "agreement",
    )  # fmt: skip

    motor: MotorConfig
    phase_order: PhaseOrder
    direction: int
    offset_rad: float
    offset_stderr_rad: float
    pole_pairs: float
    friction_Nm: float
    friction_rad: float
    gains: tuple[float, float, float]
    torque_response: TorqueResponse
    rests: Rests
    left_out: int
    angle_rad: np.ndarray
    deviation_rad: np.ndarray
    residual_rad: np.ndarray
    degrees_of_freedom: int
    accuracy: AccuracyConfig = field(default_factory=AccuracyConfig)
    bench_file: Path | None = None
    more_findings: tuple[Finding, ...] = ()

    @property
    def direction_seen(self) -> bool:
        """Whether the torque sensor showed which direction is forwards."""
        return self.torque_response.direction != 0

    @property
    def fields(self) -> dict[str, str | int | float]:
        """What belongs into `[motor]` of the bench file."""
        return {
            "phase_order": self.phase_order,
            "encoder_direction": self.direction,
            "encoder_offset_rad": round(self.offset_rad, 6),
        }

    @property
    def accuracy_fields(self) -> dict[str, float]:
        """What belongs into `[accuracy]`, to three digits."""
        return {"encoder_zero_rad": float(f"{self.zero_limit_rad:.3g}")}

    @property
    def zero_limit_rad(self) -> float:
        """Half-width a of the rectangular distribution of the zero's error.

        a / sqrt(3) is its combined standard uncertainty: the standard error, and the encoder's own
        error, as far as it does not average out over the angles of the rests.
        """
        means = [np.exp(1j * order * self.angle_rad).mean() for order in ENCODER_ERROR_ORDERS]
        encoder_rad = self.accuracy.encoder_error_rad * float(np.linalg.norm(means))
        return float(np.hypot(np.sqrt(3) * self.offset_stderr_rad, encoder_rad))

    @property
    def configured(self) -> dict[str, str | int | float]:
        """What the bench file says of the same."""
        return {name: getattr(self.motor, name) for name in self.fields}

    @property
    def torque_sensor(self) -> dict[str, bool | float]:
        """Whether the torque sensor shows the direction, and how much of its variance that is."""
        explained, reversed_explained = self.torque_response.explained
        return {
            "shows_direction": self.direction_seen,
            "explained": explained,
            "explained_reversed": reversed_explained,
        }

    @property
    def offset_stderr_points(self) -> float:
        """Standard error of the zero in encoder points."""
        return self.points(self.offset_stderr_rad)

    @property
    def offset_half_width_rad(self) -> float:
        """Half of the zero's 95 % interval."""
        return coverage_factor(self.degrees_of_freedom) * self.offset_stderr_rad

    @property
    def offset_half_width_points(self) -> float:
        """The same in encoder points."""
        return self.points(self.offset_half_width_rad)

    @property
    def friction_points(self) -> float:
        """How far friction takes a single stop off, in encoder points."""
        return self.points(self.friction_rad)

    def points(self, angle_rad: float) -> float:
        """Return an angle in encoder points."""
        return angle_rad * self.motor.counts / (2 * np.pi)

    @property
    def zero_error_points(self) -> float | None:
        """How far the configured zero is off, in encoder points; None in another direction."""
        motor = self.motor
        if (motor.phase_order, motor.encoder_direction) != (self.phase_order, self.direction):
            return None
        turn_rad = 2 * np.pi / motor.pole_pairs
        off_rad = motor.encoder_offset_rad - self.offset_rad
        return self.points((off_rad + turn_rad / 2) % turn_rad - turn_rad / 2)

    @property
    def agreement(self) -> str:
        """How the bench file compares, in a sentence."""
        off = self.zero_error_points
        if off is None:
            return "the bench file has it otherwise: torque would not be what is asked for"
        if abs(off) > self.zero_error_limit_points:
            return f"the bench file's zero is {off:+.1f} encoder points off"
        return f"the bench file has it right, its zero within {abs(off):.2f} encoder points"

    @property
    def zero_error_limit_points(self) -> float:
        """How far the configured zero may be off without a finding, in encoder points."""
        return 0.5 + self.offset_half_width_points

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the bench file has otherwise, and what is questionable about the result."""
        return (*self._of_bench_file(), *self._of_data(), *self.more_findings)

    def _of_bench_file(self) -> Iterator[Finding]:
        off, limit = self.zero_error_points, self.zero_error_limit_points
        if off is None or abs(off) > limit:
            half_turn = self.motor.counts / self.motor.pole_pairs / 2
            file = self.bench_file
            written = file and f"{file.name} has it now: start the daemon anew"
            yield Finding(
                "bench-file-differs", half_turn if off is None else abs(off), limit,
                "encoder points", "serious", self.agreement,
                written
                or "write what was found into the bench file: motord analyse align --write FILE",
            )  # fmt: skip

    def _of_data(self) -> Iterator[Finding]:
        if not self.direction_seen:
            explained, reversed_explained = self.torque_response.explained
            yield Finding(
                "direction-not-seen", explained, least_explained(reversed_explained),
                "of the variance", "warning",
                "the torque sensor does not show the rotor's oscillations, and so not which "
                "direction is forwards: it was taken as that in which the encoder counts up by the "
                "bench file",
                "does the sensor work?",
            )  # fmt: skip
        for phase, gain in zip("abc", self.gains, strict=True):
            if abs(gain - 1) > GAIN_ERROR_LIMIT:
                yield Finding(
                    f"current-scale-{phase}", abs(gain - 1), GAIN_ERROR_LIMIT, "of the command",
                    "warning",
                    f"phase {phase}: sensed current is {gain:.2f} times the commanded one",
                    "are its scales right?",
                )  # fmt: skip
        doubt = self.offset_half_width_points
        if doubt > POORLY_POINTS:
            yield Finding(
                "zero-not-known-well", doubt, POORLY_POINTS, "encoder points", "warning",
                "the zero is not known well",
                "take more stops (rests, turns), or two currents, which separate cogging torque",
            )  # fmt: skip
        if self.left_out > self.rests.size // 4:
            yield Finding(
                "stops-left-out", self.left_out, self.rests.size // 4, "stops", "note",
                f"{self.left_out} of {self.rests.size} stops are left out: the rotor still moved",
                "a longer hold_s or more brake would use them",
            )  # fmt: skip
