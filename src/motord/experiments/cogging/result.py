"""What a cogging run gives: harmonics, cogging torque, each speed, a calibration compared."""

from dataclasses import dataclass, field
from math import hypot
from typing import ClassVar

import numpy as np

from motord.config import MotorConfig
from motord.experiments.cogging.at_speed import SpeedCogging
from motord.experiments.cogging.eccentricity import Eccentricity
from motord.findings import Finding
from motord.identification.harmonics import synthesis
from motord.identification.orders import periods_per_slot_pitch
from motord.identification.rotor.left_out import LeftOut
from motord.identification.speed_differences import SpeedDifferences
from motord.intervals import coverage_factor, file_decimals, plus_minus


@dataclass(frozen=True)
class TorqueHarmonic:
    """amplitude_Nm sin(order theta + phase_rad), its standard error per component."""

    order: int
    amplitude_Nm: float
    phase_rad: float
    stderr_Nm: float


@dataclass(frozen=True)
class MeanHarmonic(TorqueHarmonic):
    """A harmonic of the mean over the speeds; allowed: by slots and poles.

    half_width_Nm, phase_half_width_rad: of the 95 % interval, by Student's t over the turns, and
    over the speeds where these differ.
    """

    phase_stderr_rad: float
    half_width_Nm: float
    phase_half_width_rad: float
    allowed: bool

    @property
    def cells(self) -> tuple[str, str, str]:
        """Order, amplitude (mNm) and, beyond three standard errors, phase (rad) as text."""
        significant = self.amplitude_Nm > 3 * self.stderr_Nm
        phase = plus_minus(self.phase_rad, self.phase_half_width_rad) if significant else ""
        amplitude = plus_minus(1e3 * self.amplitude_Nm, 1e3 * self.half_width_Nm)
        return str(self.order), amplitude, phase


@dataclass(frozen=True)
class SpeedResult:
    """One speed compared with the mean over the speeds.

    error_percent (counts,): cogging torque at this speed less the mean, % of the mean's peak (Poels
    2008, Figure 3.4).
    """

    JSON: ClassVar = (
        "speed_set_Hz=measured.speed_set_Hz", "speed_Hz=measured.speed_Hz",
        "direction=measured.direction", "turns=measured.turns", "speed_ripple_percent",
        "jerky=measured.jerky", "motion_left_counts=measured.motion_residual_counts", "noise_Nm",
        "worst_error_percent", "harmonics",
    )  # fmt: skip

    measured: SpeedCogging
    error_percent: np.ndarray

    @property
    def speed_ripple_percent(self) -> float:
        """(largest - smallest) / (2 mean) speed, %."""
        return 100 * self.measured.speed_ripple

    @property
    def noise_Nm(self) -> float:
        """Noise per component, the median over the orders."""
        return float(np.median(self.measured.noise_Nm))

    @property
    def harmonics(self) -> tuple[TorqueHarmonic, ...]:
        """The fitted orders as harmonics."""
        one = self.measured
        return tuple(
            TorqueHarmonic(int(order), float(abs(line)), float(np.angle(1j * line)), float(stderr))
            for order, line, stderr in zip(one.order, one.line_Nm, one.stderr_Nm, strict=True)
        )

    @property
    def worst_error_percent(self) -> float:
        """Largest difference from the mean, % of its peak."""
        return float(np.abs(self.error_percent).max())


@dataclass(frozen=True)
class DirectionDifference:
    """An order forwards less the same order backwards.

    Half of it turns its sign with the direction: ripple of the friction, or hysteresis. stderr_Nm
    per component; limit_Nm: what chance alone gives; phase_rad: phase forwards less backwards.
    """

    order: int
    forward_Nm: float
    backward_Nm: float
    phase_rad: float
    difference_Nm: float
    stderr_Nm: float
    limit_Nm: float

    @property
    def significant(self) -> bool:
        """Whether it is beyond what chance gives."""
        return self.difference_Nm > self.limit_Nm


@dataclass(frozen=True)
class MeasuredCogging:
    """Cogging torque over all speeds.

    order (n,), rising; line_Nm (n,): order h is Re(line exp(j h theta)); stderr_Nm (n,) per
    component; allowed (n,): by slots and poles, the others stand out of the noise; speeds: what
    each speed gave; directions: what both directions differ by, order by order, nothing if there is
    one; encoder: its errors once and twice a turn, whose loss stderr_Nm holds; differences: what
    speeds differ by beyond that, which intervals hold; left_out: what of the points was not used;
    findings: what is questionable; comparison: with a calibration's cogging torque.
    """

    JSON: ClassVar = (
        "main_order", "periods_per_slot_pitch", "harmonics", "degrees_of_freedom", "peak_Nm",
        "tau_cog_Nm=rounded_tau_cog_Nm", "speeds=speed_results", "directions", "left_out",
        "comparison",
    )  # fmt: skip

    motor: MotorConfig
    main_order: int
    order: np.ndarray
    line_Nm: np.ndarray
    stderr_Nm: np.ndarray
    allowed: np.ndarray
    speeds: tuple[SpeedCogging, ...]
    directions: tuple[DirectionDifference, ...] = ()
    encoder: tuple[Eccentricity, ...] = ()
    differences: SpeedDifferences = field(default_factory=SpeedDifferences)
    left_out: tuple[LeftOut, ...] = ()
    findings: tuple[Finding, ...] = ()
    comparison: "Comparison | None" = None

    @property
    def amplitude_Nm(self) -> np.ndarray:
        """Amplitudes (n,) of amplitude sin(order theta + phase)."""
        return np.asarray(np.abs(self.line_Nm))

    @property
    def half_width_Nm(self) -> np.ndarray:
        """Halves of the 95 % intervals of the amplitudes (n,)."""
        of_turns_Nm = coverage_factor(self.degrees_of_freedom) * self.stderr_Nm
        of_speeds_Nm = self.differences.gain.half_width * self.amplitude_Nm
        return np.asarray(np.hypot(of_turns_Nm, of_speeds_Nm))

    @property
    def phase_half_width_rad(self) -> np.ndarray:
        """Halves of the 95 % intervals of the phases (n,)."""
        of_turns_Nm = coverage_factor(self.degrees_of_freedom) * self.stderr_Nm
        of_turns_rad = of_turns_Nm / np.maximum(self.amplitude_Nm, 1e-300)
        half_rad = np.hypot(of_turns_rad, self.order * self.differences.shift_rad.half_width)
        return np.asarray(np.minimum(half_rad, np.pi))

    @property
    def phase_rad(self) -> np.ndarray:
        """Phases (n,) of amplitude sin(order theta + phase)."""
        return np.asarray(np.angle(1j * self.line_Nm))

    @property
    def tau_cog_Nm(self) -> np.ndarray:
        """Cogging torque at the encoder's points (counts,), of the allowed orders."""
        return synthesis(self.order[self.allowed], self.line_Nm[self.allowed], self.motor.counts)

    @property
    def rounded_tau_cog_Nm(self) -> np.ndarray:
        """`tau_cog_Nm` as it stands in files."""
        table_Nm = self.tau_cog_Nm
        return table_Nm.round(file_decimals(float(np.abs(table_Nm).max())))

    @property
    def periods_per_slot_pitch(self) -> int:
        """Periods of the main order within a slot pitch."""
        return periods_per_slot_pitch(self.motor.slots, self.motor.poles)

    @property
    def harmonics(self) -> tuple[MeanHarmonic, ...]:
        """The orders as harmonics."""
        size_Nm, apart = np.maximum(self.amplitude_Nm, 1e-300), self.differences
        stderr_Nm = np.hypot(self.stderr_Nm, apart.gain.stderr * size_Nm)
        stderr_rad = np.hypot(self.stderr_Nm / size_Nm, self.order * apart.shift_rad.stderr)
        stderr_rad, half_rad = np.minimum(stderr_rad, np.pi), self.phase_half_width_rad
        return tuple(
            MeanHarmonic(
                int(self.order[n]), float(self.amplitude_Nm[n]), float(self.phase_rad[n]),
                float(stderr_Nm[n]), float(stderr_rad[n]), float(self.half_width_Nm[n]),
                float(half_rad[n]), bool(self.allowed[n]),
            )
            for n in range(self.order.size)
        )  # fmt: skip

    @property
    def degrees_of_freedom(self) -> int:
        """Of the standard errors, which come from how the turns differ."""
        return max(sum(one.turns - 1 for one in self.speeds), 1)

    @property
    def speed_results(self) -> tuple[SpeedResult, ...]:
        """What each speed gave, compared with the mean."""
        return tuple(SpeedResult(one, self.error_percent(one)) for one in self.speeds)

    @property
    def peak_Nm(self) -> float:
        """Largest cogging torque within the turn."""
        return float(np.abs(self.tau_cog_Nm).max())

    @property
    def peak_to_peak_Nm(self) -> tuple[float, float]:
        """Largest less smallest cogging torque within the turn, and half of its 95 % interval."""
        torque_Nm, order = self.tau_cog_Nm, self.order[self.allowed]
        ends = np.array([[torque_Nm.argmax()], [torque_Nm.argmin()]]) / self.motor.counts
        high, low = np.exp(2j * np.pi * ends * order)
        stderr_Nm = float(np.linalg.norm(np.abs(high - low) * self.stderr_Nm[self.allowed]))
        of_turns_Nm = coverage_factor(self.degrees_of_freedom) * stderr_Nm
        whole_Nm = float(np.ptp(torque_Nm))
        return whole_Nm, hypot(of_turns_Nm, self.differences.gain.half_width * whole_Nm)

    def error_percent(self, speed: SpeedCogging) -> np.ndarray:
        """Return the cogging torque at a speed less the average (counts,), % of the peak.

        Poels 2008, Figure 3.4.
        """
        kept = np.isin(speed.order, self.order[self.allowed])
        own_Nm = synthesis(speed.order[kept], speed.line_Nm[kept], self.motor.counts)
        return np.asarray(100 * (own_Nm - self.tau_cog_Nm) / self.peak_Nm)


@dataclass(frozen=True)
class Comparison:
    """A calibration's cogging torque tau_cog_Nm (counts,), compared (Poels 2008, Figure 4.5).

    error_percent (counts,): calibrated less measured, % of the measured peak. order (m,): of the
    harmonics that stand out in both; magnitude_percent (m,): calibrated less measured, % of that
    harmonic; phase_points (m,): calibrated less measured, in encoder points.
    """

    JSON: ClassVar = ("calibration", "worst_error_percent=worst_percent", "harmonics")

    calibration: str
    label: str
    tau_cog_Nm: np.ndarray
    error_percent: np.ndarray
    order: np.ndarray
    magnitude_percent: np.ndarray
    phase_points: np.ndarray

    @property
    def harmonics(self) -> list[dict[str, float]]:
        """The harmonics that are compared."""
        return [
            {
                "order": int(order),
                "magnitude_error_percent": float(magnitude),
                "phase_error_points": float(points),
            }
            for order, magnitude, points in zip(
                self.order, self.magnitude_percent, self.phase_points, strict=True
            )
        ]

    @property
    def worst_percent(self) -> float:
        """Largest error in the time signal, % of the measured peak."""
        return float(np.abs(self.error_percent).max())
