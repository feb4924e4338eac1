"""What a back-EMF run gives: the back-EMF of the phases, its harmonics and its table."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from motord.config import SEQUENCE, MotorConfig
from motord.experiments.back_emf.between_speeds import Delay, correlated_freedom, with_known_error
from motord.experiments.back_emf.encoder_error import EncoderError
from motord.experiments.back_emf.trends import CaptureTrend, moved_by_clocks
from motord.experiments.magnet_temperature import ReferredBackEmf
from motord.findings import Finding
from motord.identification.harmonics import synthesis
from motord.identification.rotor.left_out import LeftOut
from motord.intervals import coverage_factor, file_decimals, plus_minus


@dataclass(frozen=True)
class PhaseHarmonic:
    """An order of one phase: amplitude sin(order theta + phase), theta = 2 pi count / counts.

    degrees_of_freedom: of the standard errors.
    """

    order: int
    amplitude_V_s_per_rad: float
    phase_rad: float
    stderr_V_s_per_rad: float
    degrees_of_freedom: float


@dataclass(frozen=True)
class ElectricalHarmonic(PhaseHarmonic):
    """An electrical order of the phases' mean, in the convention of `[motor] back_emf`.

    degrees_of_freedom: of the amplitude's standard error, phase_degrees_of_freedom of the phase's.
    """

    phase_stderr_rad: float
    phase_degrees_of_freedom: float
    in_table: bool


@dataclass(frozen=True)
class MeasuredBackEmf:
    """k of the phases. Lines: phase p is Re(sum_h line[h, p] exp(j order[h] theta)), V s/rad.

    order (n,): per turn, rising; line (n, 3); stderr (n, 3): of amplitude; across_stderr (n, 3): of
    the phase times the amplitude, without the error of the age; scatter_stderr (n, 3): of the
    amplitude, without what all phases lose alike; mean_stderr (n, 2): both of the mean of the
    phases, without the error of the age; freedom (n, 2): their degrees of freedom;
    phase_freedom (n, 3): those of the phases' amplitudes; kept (n,): part of the table, the others
    are noise. offset_V (3,); delay_s: by how much the voltages are older than the recording says,
    by clocks that run alike, None where the speeds are too much alike to identify it. noise_V (3,).
    speeds_Hz, turns: of each segment.
    encoder: its errors once and twice a turn, trends: of the amplitudes, both in their stderr.
    left_out: what of the points was not used; referred: where k was referred to one temperature of
    the magnets; findings: what is questionable.
    """

    JSON: ClassVar = (
        "speeds_Hz", "turns", "harmonics", "phases", "offset_V", "noise_V",
        "delay_s=age.age_s", "delay_stderr_s=age.stderr_s",
        "delay_degrees_of_freedom=age.freedom", "left_out", "degrees_of_freedom",
        "k_V_s_per_rad=rounded_table",
    )  # fmt: skip

    motor: MotorConfig
    order: np.ndarray
    line: np.ndarray
    stderr: np.ndarray
    scatter_stderr: np.ndarray
    across_stderr: np.ndarray
    mean_stderr: np.ndarray
    freedom: np.ndarray
    phase_freedom: np.ndarray
    kept: np.ndarray
    offset_V: np.ndarray
    delay_s: Delay | None
    noise_V: np.ndarray
    speeds_Hz: tuple[float, ...]
    turns: tuple[int, ...]
    encoder: tuple[EncoderError, ...] = ()
    trends: tuple[CaptureTrend, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    referred: ReferredBackEmf | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def fundamental(self) -> float:
        """Mean amplitude of the phases' fundamental (V s/rad)."""
        first = int(np.flatnonzero(self.order == self.motor.pole_pairs)[0])
        return float(np.abs(self.line[first]).mean())

    @property
    def age(self) -> Delay | None:
        """Age of the voltages beyond the recorded, with what clocks that run apart make of it."""
        if self.delay_s is None:
            return None
        age_s, stderr_s, freedom = self.delay_s
        _, moved_s = moved_by_clocks(self.trends)
        return Delay(age_s, *with_known_error(stderr_s, freedom, moved_s))

    @property
    def mean_rad_s(self) -> float:
        """Mean speed."""
        return 2 * np.pi * float(np.mean(self.speeds_Hz))

    @property
    def turned_stderr_rad(self) -> np.ndarray:
        """Standard errors (n,) of the phases by the age."""
        return np.asarray(
            self.order * (self.delay_s.stderr_s * self.mean_rad_s if self.delay_s else 0.0)
        )

    @property
    def moved_stderr_rad(self) -> np.ndarray:
        """Standard errors (n,) of the phases by clocks that run apart."""
        moved_rad, _ = moved_by_clocks(self.trends)
        return np.asarray(self.order * (moved_rad if self.delay_s else 0.0))

    @property
    def phase_stderr(self) -> np.ndarray:
        """Standard errors (n, 3) of the phases times the amplitudes."""
        turned = (
            np.abs(self.line) * np.hypot(self.turned_stderr_rad, self.moved_stderr_rad)[:, None]
        )
        return np.asarray(np.hypot(self.across_stderr, turned))

    @property
    def delay_us(self) -> str:
        """That age with half of its 95 % interval, as text; "" where it was not fitted."""
        if self.age is None:
            return ""
        half_width_s = coverage_factor(self.age.freedom) * self.age.stderr_s
        return plus_minus(1e6 * self.age.age_s, 1e6 * half_width_s)

    @property
    def degrees_of_freedom(self) -> int:
        """Of what the turns show: turns of each point but one."""
        return max(sum(self.turns) - len(self.turns), 1)

    @property
    def rounded_table(self) -> np.ndarray:
        """`table()` as it stands in files."""
        table = self.table()
        return table.round(file_decimals(float(np.abs(table).max())))

    @property
    def electrical(self) -> np.ndarray:
        """Places of the orders that are multiples of the pole pairs."""
        return np.flatnonzero(self.order % self.motor.pole_pairs == 0)

    @property
    def balanced(self) -> np.ndarray:
        """Mean of the phases, each turned back to phase a, at the electrical orders."""
        harmonic = self.order[self.electrical] // self.motor.pole_pairs
        sequence = SEQUENCE[self.motor.phase_order]
        back = np.exp(2j * np.pi / 3 * sequence * np.outer(harmonic, np.arange(3)))
        return np.asarray((self.line[self.electrical] * back).mean(axis=1))

    @property
    def harmonics(self) -> tuple[ElectricalHarmonic, ...]:
        """The electrical orders of the phases' mean."""
        return tuple(
            self._harmonic(place, line)
            for place, line in zip(self.electrical, self.balanced, strict=True)
        )

    def _harmonic(self, place: int, line: complex) -> ElectricalHarmonic:
        order = int(self.order[place])
        turned = order * self.motor.encoder_offset_rad
        stderr, across = (float(one) for one in self.mean_stderr[place])
        across_rad = across / max(float(np.abs(line)), 1e-300)
        phase_stderr_rad, phase_freedom = with_known_error(
            float(np.hypot(across_rad, self.turned_stderr_rad[place])),
            self._phase_freedom(place, across_rad),
            float(self.moved_stderr_rad[place]),
        )
        return ElectricalHarmonic(
            order=order // self.motor.pole_pairs,
            amplitude_V_s_per_rad=float(np.abs(line)),
            phase_rad=float(np.angle(1j * line * np.exp(-1j * turned))),
            stderr_V_s_per_rad=stderr,
            degrees_of_freedom=float(self.freedom[place, 0]),
            phase_stderr_rad=min(phase_stderr_rad, np.pi),
            phase_degrees_of_freedom=phase_freedom,
            in_table=bool(self.kept[place]),
        )

    def _phase_freedom(self, place: int, across_rad: float) -> float:
        """Return the degrees of freedom of the error across the line together with the age's.

        Both rest on the same scatter between speeds: estimates of variance that are fully
        correlated, for which Welch and Satterthwaite's has the square of the sum.
        """
        freedom = float(self.freedom[place, 1])
        if self.delay_s is None:
            return freedom
        turned = float(self.turned_stderr_rad[place]), self.delay_s.freedom
        return correlated_freedom((across_rad, freedom), turned)

    @property
    def phases(self) -> dict[str, list[PhaseHarmonic]]:
        """Each phase's own orders per turn, of those that are kept."""
        return {
            "abc"[phase]: [
                PhaseHarmonic(
                    int(self.order[place]),
                    float(np.abs(self.line[place, phase])),
                    float(np.angle(1j * self.line[place, phase])),
                    float(self.stderr[place, phase]),
                    float(self.phase_freedom[place, phase]),
                )
                for place in np.flatnonzero(self.kept)
            ]
            for phase in range(3)
        }

    def table(self) -> np.ndarray:
        """Return k at encoder angles 2 pi n / counts, shape (counts, 3), of the kept orders."""
        return synthesis(self.order[self.kept], self.line[self.kept], self.motor.counts)
