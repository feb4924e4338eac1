"""What is found of a profile that was played: each cycle, and the means over them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, pi, sqrt
from typing import ClassVar

import numpy as np

from motord.findings import Finding
from motord.identification.disturbances.noise_floor import NoiseFloor
from motord.intervals import IntervalEstimate, coverage_factor, expanded_uncertainty

TRACKED_PERCENT = 95.0
"""Share of the time within the tolerance below which that is a finding."""


NOISY = 0.5
"""Share of noise in the torque error's mean square from which on a note says so."""


@dataclass(frozen=True)
class TrackingError:
    """How a quantity follows what was asked for; in its unit.

    max: largest error, either way, at max_at_s of the profile's time; within_percent: share of the
    time within the tolerance.
    """

    rms: float
    max: float
    max_at_s: float
    within_percent: float


@dataclass(frozen=True)
class TorqueMoments:
    """Means over a cycle of the torque, squared, of its error, and of their product.

    By them a zero and a scale that are off move the RMS of the error. noise: the variance of the
    sensor's white noise, which is taken off the mean square; square_Nm2: this with the noise.
    drift_Nm2: mean square of what a sensor that does not pass the mean adds slowly to the torque
    of the currents: its drift, or torque that these do not show.
    """

    torque_Nm2: float
    error_Nm: float
    error_torque_Nm2: float
    square_Nm2: float
    noise: NoiseFloor
    drift_Nm2: float = 0.0

    @property
    def rms_Nm(self) -> float:
        """RMS of the error without noise; 0 where the noise is all there is."""
        return sqrt(max(self.square_Nm2 - self.noise.variance, 0.0))

    def stderr_of_rms_Nm(self, relative: float, zero_Nm: float) -> float:
        """Return the standard uncertainty of the RMS by scale (in parts), zero, noise and drift.

        As much as 95 % of each raise it at most, which is more than they lower it, and not its
        derivative: that of a small error with a mean of zero is 0. What noise and drift may have
        added lowers it by more than the same raises it.
        """
        k, rms_Nm = coverage_factor(), self.rms_Nm
        scale, zero_Nm = k * relative, k * zero_Nm
        by_noise = k * self.noise.stderr + self.drift_Nm2
        by_scale = 2 * scale * abs(self.error_torque_Nm2) + scale**2 * self.torque_Nm2
        by_zero = 2 * zero_Nm * abs(self.error_Nm) + zero_Nm**2
        raised_Nm = [hypot(rms_Nm, sqrt(by_Nm2)) - rms_Nm for by_Nm2 in (by_scale, by_zero)]
        more_Nm = hypot(rms_Nm, sqrt(by_noise)) - rms_Nm
        less_Nm = rms_Nm - sqrt(max(rms_Nm**2 - by_noise, 0.0))
        return hypot(*raised_Nm, max(more_Nm, less_Nm)) / k


@dataclass(frozen=True)
class Spans:
    """Means over n short spans of what was asked for and of what was measured (n,), in its unit.

    low, high (n,): range of the measured within the span.
    """

    wanted: np.ndarray
    measured: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Measured less asked for (n,)."""
        return np.asarray(self.measured - self.wanted)


@dataclass(frozen=True)
class CycleSeries:
    """Means over short spans of a cycle, for pictures; t_s (n,): of the spans."""

    t_s: np.ndarray
    speed_Hz: Spans
    torque_Nm: Spans


@dataclass(frozen=True)
class Cycle:
    """A cycle: tracking, mechanical energy and means over its time.

    absorbed_J: where torque and motion were against each other.
    """

    JSON: ClassVar = (
        "cycle", "run", "duration_s", "speed_rms_Hz=speed.rms", "speed_max_Hz=speed.max",
        "speed_max_at_s=speed.max_at_s", "speed_within_percent=speed.within_percent",
        "torque_rms_Nm=torque.rms", "torque_max_Nm=torque.max", "torque_max_at_s=torque.max_at_s",
        "torque_within_percent=torque.within_percent", "energy_J", "absorbed_J",
        "energy_wanted_J", "torque_mean_Nm", "speed_mean_Hz", "turns",
    )  # fmt: skip

    cycle: int
    run: str
    duration_s: float
    speed: TrackingError
    torque: TrackingError
    moments: TorqueMoments
    energy_J: float
    absorbed_J: float
    energy_wanted_J: float
    torque_mean_Nm: float
    speed_mean_Hz: float
    turns: float
    series: CycleSeries

    @property
    def power_mean_W(self) -> float:
        """Mean mechanical power."""
        return self.energy_J / self.duration_s


@dataclass(frozen=True)
class ProfileTracking:
    """A profile that was played once or more.

    torque_uncertainty: standard uncertainty of the torque's scale, in parts (Type B), None if it
    is not known; torque_source: text of where the torque is from; signal_findings: of signals
    and of points without a good take; torque_zero_Nm: standard uncertainty of the zero (Type B).
    """

    JSON: ClassVar = (
        "file", "sha256", "speed_tolerance_Hz", "torque_tolerance_Nm",
        "speed_rms_Hz", "torque_rms_Nm", "energy_J", "power_mean_W", "torque_mean_Nm",
        "speed_mean_Hz", "speed_max_Hz", "torque_max_Nm", "speed_within_percent",
        "torque_within_percent", "cycles", "notes",
    )  # fmt: skip

    file: str
    sha256: str
    speed_tolerance_Hz: float
    torque_tolerance_Nm: float
    torque_uncertainty: float | None
    torque_source: str
    cycles: tuple[Cycle, ...]
    signal_findings: tuple[Finding, ...] = ()
    torque_zero_Nm: float = 0.0

    @cached_property
    def speed_rms_Hz(self) -> IntervalEstimate:
        """RMS of the speed error."""
        return _mean([one.speed.rms for one in self.cycles])

    @cached_property
    def torque_rms_Nm(self) -> IntervalEstimate:
        """RMS of the torque error, less the sensor's white noise."""
        values_Nm, scale = [one.torque.rms for one in self.cycles], self.torque_uncertainty
        if scale is None:
            return _mean(values_Nm, None)
        common = [one.moments.stderr_of_rms_Nm(scale, self.torque_zero_Nm) for one in self.cycles]
        found = _mean(values_Nm, common=float(np.mean(common)))
        return found if found.low is None else replace(found, low=max(found.low, 0.0))

    @cached_property
    def energy_J(self) -> IntervalEstimate:
        """Mechanical energy of a cycle."""
        zero_J = 2 * pi * self._turns * self.torque_zero_Nm
        return _mean([one.energy_J for one in self.cycles], self.torque_uncertainty, zero_J)

    @cached_property
    def power_mean_W(self) -> IntervalEstimate:
        """Mean mechanical power."""
        duration_s = float(np.mean([one.duration_s for one in self.cycles]))
        zero_W = 2 * pi * self._turns / duration_s * self.torque_zero_Nm
        return _mean([one.power_mean_W for one in self.cycles], self.torque_uncertainty, zero_W)

    @cached_property
    def torque_mean_Nm(self) -> IntervalEstimate:
        """Mean torque."""
        means_Nm = [one.torque_mean_Nm for one in self.cycles]
        return _mean(means_Nm, self.torque_uncertainty, self.torque_zero_Nm)

    @property
    def _turns(self) -> float:
        """Turns of a cycle, forwards less backwards."""
        return float(np.mean([one.turns for one in self.cycles]))

    @cached_property
    def speed_mean_Hz(self) -> IntervalEstimate:
        """Mean speed."""
        return _mean([one.speed_mean_Hz for one in self.cycles])

    @property
    def speed_max_Hz(self) -> float:
        """Largest speed error of all cycles."""
        return max(one.speed.max for one in self.cycles)

    @property
    def torque_max_Nm(self) -> float:
        """Largest torque error of all cycles."""
        return max(one.torque.max for one in self.cycles)

    @property
    def speed_within_percent(self) -> float:
        """Share of the time with the speed within its tolerance."""
        return float(np.mean([one.speed.within_percent for one in self.cycles]))

    @property
    def torque_within_percent(self) -> float:
        """Share of the time with the torque within its tolerance."""
        return float(np.mean([one.torque.within_percent for one in self.cycles]))

    @property
    def notes(self) -> list[str]:
        """What is worth knowing of the result, in sentences."""
        lines = [f"torque: {self.torque_source}"]
        if len(self.cycles) == 1:
            lines.append(
                "one cycle shows no scatter: an interval is that of the torque's scale, zero "
                "and of the noise alone; set repeats to 3 or more"
            )
        lines += self._noise_notes()
        return lines

    def _noise_notes(self) -> Iterator[str]:
        noise_Nm2 = float(np.mean([one.moments.noise.variance for one in self.cycles]))
        square_Nm2 = float(np.mean([one.moments.square_Nm2 for one in self.cycles]))
        if noise_Nm2 > NOISY * square_Nm2:
            yield (
                f"{100 * min(noise_Nm2 / square_Nm2, 1.0):.0f} % of the torque error's mean square "
                f"is white noise of {sqrt(noise_Nm2):.2g} Nm RMS, which its RMS is without; the "
                "largest error and the share of the time within the tolerance have it"
            )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is questionable, and where the bench did not follow."""
        return (*self._untracked(), *self.signal_findings)

    def _untracked(self) -> Iterator[Finding]:
        for name, within, tolerance, action in (
            (
                "speed", self.speed_within_percent, f"{self.speed_tolerance_Hz:g} Hz",
                "where torque is below friction and cogging torque nothing holds the speed; "
                "else set [brake] right, or let the profile change more slowly",
            ),
            (
                "torque", self.torque_within_percent, f"{self.torque_tolerance_Nm:g} Nm",
                "calibrate and play it with compensate = on, if it is ripple",
            ),
        ):  # fmt: skip
            if within < TRACKED_PERCENT:
                yield Finding(
                    f"{name}-off-the-profile", within, TRACKED_PERCENT, "%", "note",
                    f"the {name} was within {tolerance} of the profile for this share of the time",
                    action,
                )  # fmt: skip


def _mean(
    values: list[float], relative: float | None = 0.0, common: float = 0.0
) -> IntervalEstimate:
    """Return the mean with its interval; relative: standard uncertainty of their scale, if known.

    common: standard uncertainty of what is added to all of them alike, such as by a zero.
    What repeats from cycle to cycle does not show in their scatter: without it there is none.
    """
    mean = float(np.mean(values))
    n, common = len(values), hypot((relative or 0.0) * mean, common)
    scatter = float(np.std(values, ddof=1)) / sqrt(n) if n > 1 else 0.0
    half = expanded_uncertainty(scatter, n - 1, common)
    if relative is None or half == 0.0:
        return IntervalEstimate(mean)
    return IntervalEstimate(mean, hypot(scatter, common), mean - half, mean + half)
