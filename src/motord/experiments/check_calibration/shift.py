"""By how much a calibration's parameters would have to move to fit turns that it was not made of.

What the calibration's model, with the sensed currents, leaves of the torque of each operating point
is taken to lines at the orders of the turn, and fitted by the model's columns, made of the
commanded currents: instruments, without the noise of the sensed ones.

In a star the phase currents add up to nothing (Kirchhoff's law), which shows the ratios of the
gains from the currents alone, more sharply than the torque does; a calibration of a star has them
from it. Errors are those of leaving out one turn after the other (jackknife).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from motord.calibration import Calibration, Harmonic
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.lack_of_fit.effects import model_columns, point_models
from motord.experiments.calibration.estimate.lack_of_fit.findings import MODEL_ACCURACY
from motord.experiments.calibration.estimate.least_squares.kirchhoff import alpha_of_law
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    DELAY,
    ZOH,
    Regression,
)
from motord.experiments.calibration.estimate.turn_products import accumulate
from motord.experiments.captures_left_out import CapturesLeftOut, prepared
from motord.experiments.check_calibration.line_fit import LineFit
from motord.experiments.signal_findings import require_reliable, signal_findings
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.operating_points import (
    PointData,
    Samples,
    require_currents,
    require_turns,
)
from motord.identification.orders import resolved_cogging_order
from motord.identification.torque.torque_sensor import without_highpass
from motord.identification.variance_components import VarianceComponents
from motord.identification.zero_sequence import is_missing, restored

GAIN_ACCURACY = 5e-4
"""Part by which a gain may differ between calibration and check without having drifted: warmer, at
another current (half of a rectangular distribution)."""

MIN_TURNS = 2
"""Whole turns that each operating point needs."""

MIN_ALL_TURNS = 8
"""Whole turns over all points that a test needs."""

UNSEEN = 1e-6
"""Part of a direction that may lie in what the turns do not show."""


@dataclass(frozen=True)
class LawShift:
    """change (3,): of the logarithms of the gains, less their mean; with its errors."""

    change: np.ndarray
    errors: VarianceComponents

    def along(self, contrast: np.ndarray) -> tuple[float, float, float]:
        """Return a contrast (3,) of the changes, its standard error and degrees of freedom."""
        return float(contrast @ self.change), *self.errors.along(contrast)


def law_shift(regression: Regression, gain: np.ndarray) -> LawShift:
    """Return the change from gains (3,) by all turns of a regression that has the law."""
    laws = regression.sums(gain).law()
    count, total = len(laws), laws.sum(axis=0)
    without = np.log([alpha_of_law(total - one) for one in laws])
    apart = without - without.mean(axis=0)
    jackknife = (count - 1) / count * apart.T @ apart
    doubt = np.full((1, 1), 2 / (count - 1))
    scatter = VarianceComponents(jackknife[None], np.ones(1), doubt, ("turns",))
    return LawShift(
        change=np.log(alpha_of_law(total)) - np.log(gain) + np.log(gain).mean(),
        errors=scatter
        + VarianceComponents.known(GAIN_ACCURACY**2 / 3 * np.eye(3), "gain accuracy"),
    )


@dataclass(frozen=True)
class ParameterShift:
    """change (p,) of the parameters theta (p,), as in `normal_equations`, with its errors.

    seen (p, p): projection on what the turns show; misfit: see `LineFit`. orders: of the cogging
    torque, in the succession of theta; turns: whole ones, of each point. law: what Kirchhoff's law
    says of the gains in a star; None where it says nothing. findings: of signals.
    """

    theta: np.ndarray
    change: np.ndarray
    errors: VarianceComponents
    seen: np.ndarray
    misfit: float
    orders: tuple[int, ...]
    turns: tuple[int, ...]
    law: LawShift | None = None
    findings: tuple[Finding, ...] = ()

    def along(self, direction: np.ndarray) -> tuple[float, float, float] | None:
        """Return the change along a direction (p,), its standard error and degrees of freedom.

        None where the turns do not show it. Ratios of gains are by Kirchhoff's law, if it holds.
        """
        of_gains = direction[ALPHA] * self.theta[ALPHA]
        common = abs(of_gains.sum()) > UNSEEN * np.abs(of_gains).max()
        if self.law is not None and not common and not direction[ALPHA.stop :].any():
            return self.law.along(of_gains)
        hidden = direction - self.seen @ direction
        if np.abs(hidden).max() > UNSEEN * np.abs(direction).max():
            return None
        return float(direction @ self.change), *self.errors.along(direction)


def parameter_shift(
    points: Iterable[PointData],
    calibration: Calibration,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    left_out: CapturesLeftOut,
) -> ParameterShift:
    """Return by how much the calibration would have to move. Raises IdentifyError."""
    with left_out.explaining():
        recorded = _recorded(points, motor.counts, left_out)
    has_law = motor.connection == "star" and not any(map(is_missing, recorded))
    samples = [without_sensor(one, calibration, motor, sensor) for one in recorded]
    with left_out.explaining():
        _check_turns(samples)
    fewest = min(end - first for one in samples for first, end in one.turns)
    highest = resolved_cogging_order(fewest, motor.counts)
    theta, harmonics = parameters_of(calibration, highest)
    basis = Basis.of(motor, tuple(one.order for one in harmonics))
    direct = sensor.model_copy(update={"highpass_time_constant_s": 0.0})
    products = [accumulate(one, basis, direct) for one in samples]
    regression = Regression(products, basis, len(harmonics), kirchhoff=has_law)
    fit = _fit(regression, theta, motor)
    return ParameterShift(
        theta=theta,
        change=fit.change,
        errors=fit.errors,
        seen=fit.seen,
        misfit=fit.misfit,
        orders=basis.orders,
        turns=tuple(len(one.turns) for one in samples),
        findings=signal_findings((one.label, one.faults) for one in recorded),
        law=law_shift(regression, theta[ALPHA]) if has_law else None,
    )


def parameters_of(calibration: Calibration, highest: int) -> tuple[np.ndarray, list[Harmonic]]:
    """Return theta (p,) of a calibration, and its cogging torque up to order `highest`, in it."""
    harmonics = [one for one in calibration.tau_cog_harmonics if one.order <= highest]
    waves = [h.amplitude_Nm * part(h.phase_rad) for h in harmonics for part in (np.sin, np.cos)]
    gain = calibration.delta_epsilon * np.array(calibration.alpha)
    return np.concatenate([gain, calibration.beta_A, [0.0, 0.0], waves]), harmonics


def _fit(regression: Regression, theta: np.ndarray, motor: MotorConfig) -> LineFit:
    """Return the fit of what parameters theta (p,) leave."""
    groups_Nm = regression.residual_lines(theta)
    highest = groups_Nm[0].shape[1]
    models = point_models(regression, theta, highest)
    return LineFit(
        groups_Nm=groups_Nm,
        columns=model_columns(models, regression, theta[ALPHA]),
        prior=np.eye(theta.size)[[DELAY, ZOH]],
        model_Nm=MODEL_ACCURACY * motor.rated_torque_Nm / 3**0.5,
        lowest_order=min(motor.pole_pairs, highest),
    )


def without_sensor(
    samples: Samples, calibration: Calibration, motor: MotorConfig, sensor: TorqueSensorConfig
) -> Samples:
    """Return a point with its torque without the high-pass, and currents of all phases.

    Raises IdentifyError where there are no currents.
    """
    require_currents(samples)
    if motor.connection == "star" and is_missing(samples):
        samples = restored(samples, calibration.delta_epsilon * np.array(calibration.alpha))
    torque_Nm = without_highpass(samples.t_s, samples.torque_Nm, sensor)
    return replace(samples, torque_Nm=torque_Nm)


def _recorded(points: Iterable[PointData], counts: int, left_out: CapturesLeftOut) -> list[Samples]:
    """Return the samples of the points that can be used.

    Raises IdentifyError where none can of a torque, or with a current scaled: it separates what the
    others show together alone, as the common gain and the cogging torque that is made up for.
    """
    found: dict[tuple[float, str], list[Samples]] = {}
    for point in points:
        alike = found.setdefault((point.torque_Nm, str(point.induced)), [])
        alike += prepared([point], counts, left_out, _usable)
    for (torque_Nm, _), alike in found.items():
        if not alike and any(found.values()):
            raise IdentifyError(
                f"without the point at {torque_Nm:g} Nm the others do not separate gains from "
                "cogging torque; repeat the check"
            )
    return [samples for alike in found.values() for samples in alike]


def _usable(samples: Samples) -> Samples:
    """Return samples that a check can use. Raises IdentifyError for others."""
    return require_turns(require_reliable(require_currents(samples)), MIN_TURNS)


def _check_turns(samples: Sequence[Samples]) -> None:
    """Raise IdentifyError where the turns are too few."""
    if not samples:
        raise IdentifyError("there is no good operating point in the recording; repeat the check")
    turns = sum(len(one.turns) for one in samples)
    if turns < MIN_ALL_TURNS:
        raise IdentifyError(
            f"{turns} whole turns in all are too few to test a calibration, at least "
            f"{MIN_ALL_TURNS} are needed; repeat the check with more turns"
        )
