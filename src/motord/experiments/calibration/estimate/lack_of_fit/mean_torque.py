"""Mean torque of the points against that of their currents: does position fit the back-EMF?

Ripple alone does not show it: by an angle that is far off other gains explain it, and look right.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from motord.config import AccuracyConfig, MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.checks import COMMON_GAIN_PERCENT, NoFitError
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.findings import Finding, Severity, listed
from motord.identification import IdentifyError
from motord.identification.operating_points import Samples
from motord.identification.torque.torque_of_currents import (
    MIN_FREEDOM,
    SHOWN_PART,
    MeanTorque,
    Slope,
    slope_of,
)
from motord.intervals import coverage_factor


class MeanTorques:
    """Takes operating points one by one, where the torque sensor passes the mean."""

    def __init__(self, motor: MotorConfig, sensor: TorqueSensorConfig) -> None:
        self._back_emf, self._rated_Nm = motor.back_emf_table(), motor.rated_torque_Nm
        self._passes_mean = sensor.passes_mean
        self._points: list[MeanTorque] = []

    def add(self, samples: Samples) -> None:
        """Take a point."""
        if not self._passes_mean:
            return
        back_emf = samples.back_emf_factor * self._back_emf[samples.count[samples.whole]]
        phases_Nm = (samples.i_A[samples.whole] * back_emf).mean(axis=0)
        measured_Nm = float(samples.torque_Nm[samples.whole].mean())
        self._points.append(MeanTorque(measured_Nm, phases_Nm, samples.velocity_Hz))

    def findings(
        self, accuracy: AccuracyConfig, result: CalibrationResult | None = None
    ) -> Iterator[Finding]:
        """Yield a finding where the currents do not make the torque that is measured.

        result: its gains count; without, those of the sensors as they are.
        """
        if len(self._points) < 2:
            return
        gain, gain_percent = _gain(result)
        measured_Nm = np.array([one.measured_Nm for one in self._points])
        made_Nm = np.array([one.phases_Nm for one in self._points]) @ gain
        if max(np.ptp(measured_Nm), np.ptp(made_Nm)) < SHOWN_PART * self._rated_Nm:
            return
        velocity_Hz = np.array([one.velocity_Hz for one in self._points])
        slope = slope_of(measured_Nm, made_Nm, velocity_Hz)
        # where the measured one is far smaller, they differ by a unit, not by saturation
        part = min(2 * abs(slope.ratio), 1.0) if slope.measured_smaller else 1.0
        largest = part * np.abs(made_Nm).max() / self._rated_Nm
        stated_percent = (
            accuracy.torque_gain_percent
            + accuracy.back_emf_percent
            + accuracy.current_gain_percent
            + 2 * largest * _saturation_percent(accuracy, result)
        )
        limit_percent = stated_percent + gain_percent + _chance_percent(slope, accuracy)
        off_percent = 100 * (1 - slope.ratio)
        if off_percent > limit_percent:
            others = [] if result is None else result.findings
            serious = [one.name for one in others if one.severity == "serious"]
            yield _finding(slope, off_percent, limit_percent, serious)

    def explained(self, error: IdentifyError, accuracy: AccuracyConfig) -> IdentifyError | None:
        """Return a refusal with what the mean torques say, the likelier cause first; None without.

        Where the fit is none that is the mean torque, also where it is no more than a warning.
        """
        for one in self.findings(accuracy):
            if isinstance(error, NoFitError):
                return IdentifyError(f"{one.meaning}; {one.action} ({error.fact})")
            if one.severity == "serious":
                return IdentifyError(f"{error}; {one.meaning}; {one.action}")
        return None


def _chance_percent(slope: Slope, accuracy: AccuracyConfig) -> float:
    """Return by how much the slope may be off by scatter, and by friction that it may hold."""
    percent = 100 * slope.half_width
    if slope.freedom < MIN_FREEDOM:  # the zero may change from point to point
        percent += 100 * accuracy.torque_zero_Nm / slope.span_Nm
    return percent + COMMON_GAIN_PERCENT * slope.with_friction


def _gain(result: CalibrationResult | None) -> tuple[np.ndarray, float]:
    """Return the gains (3,) of the sensed currents, and by how much (%) they may be off in common.

    The common gain counts where it is known well enough for a wrong angle not to look like it.
    """
    if result is None:
        return np.ones(3), 0.0
    stderr = result.delta_epsilon_stderr
    if stderr is None:
        return result.alpha, 0.0
    freedom = result.degrees_of_freedom.delta_epsilon if result.degrees_of_freedom else None
    half_width_percent = 100 * coverage_factor(freedom) * stderr
    if half_width_percent > COMMON_GAIN_PERCENT:
        return result.alpha, 0.0
    return result.delta_epsilon * result.alpha, half_width_percent


def _saturation_percent(accuracy: AccuracyConfig, result: CalibrationResult | None) -> float:
    """Return what the back-EMF may lose at the rated current (%), also by what was found.

    It falls with the current: the slope at a torque loses twice of what the torque does.
    """
    found = [] if result is None else result.findings
    losses = [abs(one.value) for one in found if one.name == "back-emf-load"]
    return max([accuracy.saturation_percent, *losses])


def _finding(
    slope: Slope, off_percent: float, limit_percent: float, others: Sequence[str]
) -> Finding:
    """Return the finding. others: serious ones of the ripple, which the same cause may have."""
    currents = "that currents, position and back-EMF make"
    measured = "that the sensor shows"
    one, other = (measured, currents) if slope.measured_smaller else (currents, measured)
    angle_deg = np.degrees(np.arccos(np.clip(slope.ratio, -1, 1)))
    may_be_friction = slope.with_friction and slope.ratio > 0
    far = off_percent - limit_percent > COMMON_GAIN_PERCENT or bool(others)
    severity: Severity = "serious" if far and not may_be_friction else "warning"
    likely = f"; {listed(others)} may be of the same cause, and not what it says" if others else ""
    return Finding(
        "torque-of-currents", off_percent, limit_percent, "%", severity,
        f"the mean torque {one} changes from point to point by {slope.ratio:.3g} times the one "
        f"{other}: position or phase of the back-EMF is wrong ({angle_deg:.0f} deg electrical "
        "would do that), or scale, sign or order of torque or currents, or amplitude of the "
        f"back-EMF{likely}",
        "align (`motord plan start align`), measure the back-EMF, and check [torque_sensor]: "
        "gain_Nm_per_V, and highpass_time_constant_s of a sensor that does not pass the mean",
    )  # fmt: skip
