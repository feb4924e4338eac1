"""The uncertainty budget of a calibration: Type A from the fit, Type B by propagation.

A departure of size e that the model has not moves its parameters by X^+ G e (`score_test`). Of e it
is known that it lies within +- a (the bench file's `[accuracy]`), variance a^2 / 3, and what the
data say of it: information S, score b. With the posterior e ~ N(m, V), V = (S + 3/a^2)^-1 and
m = V b, the contribution to the variance is X^+ G (V + m m') (X^+ G)'. So what the data show well
counts little, and what they cannot separate counts in full.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from motord.experiments.calibration.estimate.lack_of_fit.effects import COGGING
from motord.experiments.calibration.estimate.lack_of_fit.meanings import fundamental
from motord.experiments.calibration.estimate.lack_of_fit.score_test import EffectSensitivity
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    cogging_place,
)
from motord.experiments.calibration.estimate.result import CalibrationResult, triple
from motord.experiments.magnet_temperature import ReferredBackEmf
from motord.experiments.subject import Subject
from motord.uncertainty_budget import Contribution

Limits = Callable[[float, Subject], "float | np.ndarray"]
"""Half-widths of an effect's sizes, one or one of each term: of a limit of the bench file."""


@dataclass(frozen=True)
class Source:
    """A source of Type B: field of `[accuracy]`, its unit, names of the effects, their limits."""

    name: str
    field: str
    unit: str
    effects: tuple[str, ...]
    limits: Limits = lambda limit, _: limit

    def limit(self, bench: Subject) -> float:
        """Return the limit that the bench file has, stated or assumed."""
        return float(getattr(bench.accuracy, self.field))

    def half_widths(self, bench: Subject, terms: int) -> np.ndarray:
        """Return the half-widths (terms,) of an effect's sizes."""
        return np.full(terms, self.limits(self.limit(bench), bench), float)


def _percent(limit: float, _: Subject) -> float:
    return limit / 100


def _of_rated_torque(limit: float, bench: Subject) -> float:
    return limit / 100 * bench.motor.rated_torque_Nm


def _curve(limit: float, bench: Subject) -> np.ndarray:
    rated_A = bench.motor.rated_current_A()
    return np.repeat(limit / 100 / np.array([rated_A, rated_A**2]), 3)


def _rate(limit: float, bench: Subject) -> float:
    tau_s = bench.sensor.highpass_time_constant_s
    return limit / 100 / tau_s if tau_s else 0.0


SCALES = (
    Source("gain of the torque sensor", "torque_gain_percent", "%", (), _percent),
    Source("fundamental of the back-EMF", "back_emf_percent", "%", (), _percent),
    Source("common gain of the current sensors", "current_gain_percent", "%", (), _percent),
)
"""Gains of the whole; that of the current sensors counts only where delta epsilon is not seen."""

SOURCES = (
    Source("encoder's zero", "encoder_zero_rad", "rad", ("encoder-zero",)),
    Source("encoder once and twice a turn", "encoder_error_rad", "rad",
           ("encoder-error-order-1", "encoder-error-order-2")),
    Source("harmonics of the back-EMF", "back_emf_harmonics_percent", "% of the fundamental",
           ("back-emf",), lambda limit, bench: limit / 100 * fundamental(bench.motor)),
    Source("saturation", "saturation_percent", "% at rated current",
           ("back-emf-load", "cogging-load"),
           lambda limit, bench: limit / 100 / bench.motor.rated_current_A()),
    Source("time constant of the torque sensor", "torque_time_constant_percent", "%",
           ("highpass-time-constant",), _rate),
    Source("delay of the torque", "torque_age_s", "s", ("torque-age",)),
    Source("cross-talk of the torque sensor", "torque_crosstalk_percent", "%",
           ("torque-sensor-crosstalk",), _percent),
    Source("cross-talk of current sensors", "current_crosstalk_percent", "%",
           ("current-sensor-crosstalk",), _percent),
    Source("nonlinearity of current sensors", "current_linearity_percent", "%",
           ("current-sensor-nonlinearity",), _curve),
    Source("friction ripple", "friction_ripple_percent", "% of rated",
           ("friction-ripple",), _of_rated_torque),
    Source("cogging torque like offsets", "offset_like_cogging_percent", "% of rated",
           (COGGING,), _of_rated_torque),
)  # fmt: skip
"""Sources that the data show in part: each by the effects of `lack_of_fit.effects`."""


def budget(
    result: CalibrationResult,
    fitted: JointFit,
    sensitivities: Sequence[EffectSensitivity],
    bench: Subject,
    back_emf: ReferredBackEmf | None = None,
) -> tuple[Contribution, ...]:
    """Return what each source contributes: Type A first, then Type B as the bench file lists it.

    result: its harmonics in the succession of the fit's parameters. back_emf: if it was referred.
    """
    vector = _Linear.of(result, fitted)
    both_ways = any(one.name == "friction-ripple" for one in sensitivities)
    return (
        Contribution(
            source="scatter of the data",
            type="A",
            basis="data",
            alpha=triple(result.alpha_stderr),
            beta_A=triple(result.beta_stderr_A),
            delta_epsilon=result.delta_epsilon_stderr or 0.0,
            cogging_Nm=max((h.stderr_Nm or 0.0 for h in result.harmonics), default=0.0),
            degrees_of_freedom=_fewest(result),
        ),
        *(
            _contribution(source, vector.scaled(source, result, bench), bench)
            for source in (*SCALES, *(_of_temperature(back_emf) if back_emf else ()))
        ),
        *([] if both_ways else [_friction(bench)]),
        *(
            _contribution(source, vector.squares(source, sensitivities, bench), bench)
            for source in SOURCES
            if source.field != "friction_ripple_percent" or both_ways
        ),
    )


def _of_temperature(back_emf: ReferredBackEmf) -> tuple[Source, ...]:
    """Return the sources of a back-EMF that was referred to a temperature: gains of it."""
    return (
        Source("temperature of the magnets", "magnet_temperature_K", "K",
               (), lambda limit, _: back_emf.by_sensor(limit)),
        Source("temperature coefficient of the back-EMF", "back_emf_temperature_percent", "% of it",
               (), lambda limit, _: back_emf.by_coefficient(limit)),
    )  # fmt: skip


@dataclass(frozen=True)
class _Linear:
    """Derivative (v, p) of alpha, beta, delta epsilon and amplitudes by the fit's parameters.

    gain_shift (v,): by the common gain, where that is not seen.
    """

    derivative: np.ndarray
    gain_shift: np.ndarray

    @classmethod
    def of(cls, result: CalibrationResult, fitted: JointFit) -> "_Linear":
        size = fitted.solution.vector.size
        rows = np.zeros((7 + len(result.harmonics), size))
        rows[ALPHA, ALPHA] = rows[3:6, BETA] = np.eye(3)
        rows[6, -1] = 1.0
        for n, harmonic in enumerate(result.harmonics):
            along = np.sin(harmonic.phase_rad), np.cos(harmonic.phase_rad)
            rows[7 + n, cogging_place(n)] = along
        return cls(rows @ fitted.derivative, rows @ fitted.gain_shift)

    def scaled(self, source: Source, result: CalibrationResult, bench: Subject) -> np.ndarray:
        """Return the variances (v,) of a gain that scales the result, or that is assumed to be 1.

        A gain of the torque sensor scales offsets and cogging torque, one of the back-EMF offsets.
        """
        shift = self.gain_shift.copy()
        if source.field != "current_gain_percent":
            shift[3:6] -= result.beta_A
            shift[6] = result.delta_epsilon
        if source.field == "torque_gain_percent":
            shift[7:] -= [h.amplitude_Nm for h in result.harmonics]
        return np.asarray((source.half_widths(bench, 1) * shift) ** 2 / 3)

    def squares(
        self, source: Source, sensitivities: Sequence[EffectSensitivity], bench: Subject
    ) -> np.ndarray:
        """Return the variances (v,) that a source contributes; its effects are independent."""
        total = np.zeros(len(self.derivative))
        for one in sensitivities:
            if one.name in source.effects and source.limit(bench) > 0:
                half_widths = source.half_widths(bench, one.score.size)
                shift = self.derivative @ one.shift
                total += np.einsum("vt,tu,vu->v", shift, one.second_moment(half_widths), shift)
        return total


def _fewest(
    result: CalibrationResult,
) -> tuple[float | None, float | None, float | None, float | None]:
    """Return the fewest degrees of freedom of alpha, beta, delta epsilon and amplitudes."""
    groups: list[Sequence[float | None]] = [(), (), ()]
    if freedom := result.degrees_of_freedom:
        groups = [freedom.alpha, freedom.beta_A, (freedom.delta_epsilon,)]
    groups.append([h.degrees_of_freedom for h in result.harmonics])
    alpha, beta, delta_epsilon, cogging = (
        min((max(one, 1.0) for one in group if one is not None), default=None) for group in groups
    )
    return alpha, beta, delta_epsilon, cogging


def _friction(bench: Subject) -> Contribution:
    """Return what friction that ripples adds, where the rotor turned one way: it counts as cogging
    torque."""
    [source] = [one for one in SOURCES if one.field == "friction_ripple_percent"]
    squares = np.zeros(7 + 1)
    squares[7] = source.half_widths(bench, 1)[0] ** 2 / 3
    return _contribution(source, squares, bench)


def _contribution(source: Source, squares: np.ndarray, bench: Subject) -> Contribution:
    u = np.sqrt(squares)
    stated = source.field in bench.accuracy.model_fields_set
    return Contribution(
        source=source.name,
        type="B",
        basis="stated" if stated else "assumed",
        limit=source.limit(bench),
        unit=source.unit,
        alpha=triple(u[:3]),
        beta_A=triple(u[3:6]),
        delta_epsilon=float(u[6]),
        cogging_Nm=float(u[7:].max(initial=0.0)),
    )
