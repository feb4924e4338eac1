"""What departures of a bench leave of the torque, by order of the turn, per unit of their size.

T = sum_p i_p k_p + cogging torque is the torque of the model at the commanded currents, T' its
change with the angle at those currents. An encoder error e(theta) leaves -T' e; a wrong time
constant of the high-pass H leaves T dH / d(1/tau) d(1/tau) with dH / d(1/tau) = -H^2 / (j w); a
harmonic dk that the back-EMF lacks leaves sum_p i_p dk_p; and so on, linear in its size.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from motord.cached_arrays import cached_arrays
from motord.config import BackEmfHarmonic, MotorConfig
from motord.config.motor import PhaseOrder, back_emf_waves
from motord.experiments.calibration.estimate.current_tables import derivative_over_time
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    DELAY_SHARE,
    FIRST_COGGING,
    ZOH_SHARE,
    Regression,
)
from motord.experiments.calibration.estimate.turn_spectrum import TurnSpectrum

ENCODER_ORDERS = (0, 1, 2, 3, 4)
"""Orders of encoder errors that are looked for; 0 is its zero."""

BACK_EMF_ORDERS = (3, 5, 7, 9, 11, 13)
"""Electrical orders that the back-EMF may have besides its fundamental."""

SHAFT_ORDERS = (1, 2, 3, 4)
"""Orders that eccentric or tilted parts have."""

COGGING = "cogging"
"""Name of the effect of an order of the cogging torque that the model has not."""


@dataclass(frozen=True)
class Effect:
    """A departure: `name` as in its finding, `order` of the turn, electrical for a back-EMF.

    lines (points, terms, orders): what a unit of each of its parameters leaves at orders 1, 2, ...
    law (points, terms, 4): what it adds to Kirchhoff's law, in parts of i*_a, i*_b, i*_c and 1.
    """

    name: str
    order: int
    lines: np.ndarray
    law: np.ndarray


@dataclass(frozen=True)
class PointModel:
    """The model at an operating point, over the bins of the turn.

    gain (3,): delta epsilon alpha; i_A (bins, 3): what flows by the commands and the gains found;
    k (bins, 3); cogging_Nm, change_Nm_per_rad (bins,): T' above.
    """

    spectrum: TurnSpectrum
    orders: int
    gain: np.ndarray
    i_A: np.ndarray
    k: np.ndarray
    cogging_Nm: np.ndarray
    change_Nm_per_rad: np.ndarray

    @cached_property
    def torque_Nm(self) -> np.ndarray:
        """Torque (bins,)."""
        return np.asarray((self.i_A * self.k).sum(axis=1) + self.cogging_Nm)

    @property
    def torque_change_Nm_per_s(self) -> np.ndarray:
        """Derivative of the torque over time (bins,), currents included."""
        velocity_rad_s = self.spectrum.velocity_rad_s
        return derivative_over_time(self.torque_Nm[:, None], velocity_rad_s)[:, 0]

    @cached_property
    def amplitude_A(self) -> np.ndarray:
        """Amplitude of balanced phase currents of the same heat (bins,)."""
        return np.asarray(np.sqrt((self.i_A**2).sum(axis=1) * 2 / 3))

    def lines(self, torque_Nm: np.ndarray) -> np.ndarray:
        """Return the lines (n, orders) that torques (n, bins) have behind the high-pass."""
        lines = np.fft.rfft(torque_Nm, axis=1)[:, 1 : self.orders + 1]
        return np.asarray(2 / self.k.shape[0] * lines * self.spectrum.highpass[: self.orders])

    def waves(self, order: int) -> np.ndarray:
        """Return cos and sin of an order of the turn (2, bins); of order 0 1 alone."""
        return _waves(order, self.k.shape[0])[: 2 if order else 1]


def point_models(regression: Regression, theta: np.ndarray, orders: int) -> list[PointModel]:
    """Return the model at each point with parameters theta (p,)."""
    basis = regression.basis
    tables = np.column_stack([basis.back_emf, basis.cogging[:, : 2 * regression.orders]])
    slopes = derivative_over_time(tables, np.ones(len(tables)))  # over the angle, at 1 rad/s
    models = []
    for point in regression.points:
        command_A = point.spectrum.command_A
        bins = command_A.shape[0]
        at = np.arange(bins) * tables.shape[0] // bins
        i_A = command_A * theta[ALPHA] + theta[BETA]
        waves = theta[FIRST_COGGING:]
        models.append(
            PointModel(
                spectrum=point.spectrum,
                orders=orders,
                gain=theta[ALPHA],
                i_A=i_A,
                k=tables[at, :3],
                cogging_Nm=tables[at, 3:] @ waves,
                change_Nm_per_rad=(i_A * slopes[at, :3]).sum(axis=1) + slopes[at, 3:] @ waves,
            )
        )
    return models


def cogging_effects(models: Sequence[PointModel], orders: Sequence[int]) -> list[Effect]:
    """Return the effects of cogging torque at orders that the model has not."""
    highpass = np.array([point.spectrum.highpass[: point.orders] for point in models])
    found = []
    for order in orders:
        lines = np.zeros((len(models), 2, models[0].orders), complex)
        lines[:, :, order - 1] = highpass[:, order - 1, None] * np.array([1, -1j])
        found.append(_without_law(COGGING, order, lines))
    return found


def effects(
    models: Sequence[PointModel], motor: MotorConfig, cogging_orders: Sequence[int]
) -> list[Effect]:
    """Return the effects of all departures that these points can show."""
    found = []
    for name, order, torques_Nm in _departures(motor):
        lines = np.array([point.lines(torques_Nm(point)) for point in models])
        found.append(_without_law(name, order, lines))
    found.append(
        _without_law("highpass-time-constant", 0, np.array([_highpass(p) for p in models]))
    )
    found.append(_of_currents("current-sensor-crosstalk", models, _current_crosstalk))
    found.append(_of_currents("current-sensor-nonlinearity", models, _gain_curve))
    directions = np.array([point.spectrum.direction for point in models])
    if np.ptp(directions) > 0:
        moved = np.array([point.lines(_encoder_error(0, point)) for point in models])
        found.append(_without_law("backlash", 0, directions[:, None, None] * moved))
        for order in sorted({*SHAFT_ORDERS, *cogging_orders}):
            lines = np.array([point.lines(point.waves(order)) for point in models])
            against = -directions[:, None, None] * lines
            found.append(_without_law("friction-ripple", order, against))
    return found


Torques = Callable[[PointModel], np.ndarray]
"""Torques (terms, bins) at a point, of a unit of each parameter."""


def _departures(motor: MotorConfig) -> Iterator[tuple[str, int, Torques]]:
    """Yield name, order and torques of the departures that Kirchhoff's law does not show."""
    for order in ENCODER_ORDERS:
        name = f"encoder-error-order-{order}" if order else "encoder-zero"
        yield name, order, partial(_encoder_error, order)
    for order in BACK_EMF_ORDERS:
        yield "back-emf", order, partial(_harmonic, motor, order)
    electrical = [motor.pole_pairs * n for n in (1, 2, 4, 6)]
    for order in sorted({*SHAFT_ORDERS, *electrical}):
        yield "torque-sensor-crosstalk", order, partial(_torque_crosstalk, order)
    yield "back-emf-load", 0, lambda p: -(p.amplitude_A * (p.i_A * p.k).sum(axis=1))[None]
    yield "torque-age", 0, lambda p: -p.torque_change_Nm_per_s[None]
    yield "cogging-load", 0, lambda p: (p.amplitude_A * p.cogging_Nm)[None]


def _encoder_error(order: int, point: PointModel) -> np.ndarray:
    return np.asarray(-point.change_Nm_per_rad * point.waves(order))


def _torque_crosstalk(order: int, point: PointModel) -> np.ndarray:
    return np.asarray(point.torque_Nm * point.waves(order))


def _without_law(name: str, order: int, lines: np.ndarray) -> Effect:
    return Effect(name, order, lines, np.zeros((*lines.shape[:2], 4)))


def _of_currents(
    name: str,
    models: Sequence[PointModel],
    parts: Callable[[PointModel], tuple[np.ndarray, np.ndarray]],
) -> Effect:
    lines, law = [], []
    for point in models:
        torques_Nm, share = parts(point)
        lines.append(point.lines(torques_Nm))
        law.append(share)
    return Effect(name, 0, np.array(lines), np.array(law))


def _harmonic(motor: MotorConfig, order: int, point: PointModel) -> np.ndarray:
    """Return the torques of cos and sin of an electrical order of 1 V s/rad in the back-EMF."""
    turn = (motor.pole_pairs, motor.encoder_offset_rad, motor.phase_order)
    return np.array([(point.i_A * k).sum(axis=1) for k in _unit_emf(order, *turn, len(point.k))])


@cached_arrays(maxsize=16)
def _unit_emf(
    order: int, pole_pairs: int, offset_rad: float, phase_order: PhaseOrder, bins: int
) -> np.ndarray:
    """Return the back-EMF over speed of cos and sin of an electrical order (2, bins, 3)."""
    electrical_rad = pole_pairs * (2 * np.pi * np.arange(bins) / bins + offset_rad)
    unit = [
        BackEmfHarmonic(order=order, amplitude_V_s_per_rad=1.0, phase_rad=phase_rad)
        for phase_rad in (np.pi / 2, 0.0)
    ]
    return np.array([back_emf_waves([one], electrical_rad, phase_order) for one in unit])


@cached_arrays(maxsize=64)
def _waves(order: int, bins: int) -> np.ndarray:
    """Return cos and sin of an order of the turn (2, bins)."""
    turned_rad = order * (2 * np.pi * np.arange(bins) / bins)
    return np.array([np.cos(turned_rad), np.sin(turned_rad)])


def _current_crosstalk(point: PointModel) -> tuple[np.ndarray, np.ndarray]:
    """Return torques and law of 1 of each phase's current in the sensors of the two others."""
    pairs = [(p, q) for p in range(3) for q in range(3) if p != q]
    command_A = point.spectrum.command_A
    torques_Nm = [-point.gain[p] * command_A[:, q] * point.k[:, p] for p, q in pairs]
    law = [-point.gain[p] * np.eye(4)[q] for p, q in pairs]
    return np.array(torques_Nm), np.array(law)


def _gain_curve(point: PointModel) -> tuple[np.ndarray, np.ndarray]:
    """Return torques and law of gains that change by 1 per A and 1 per A^2, phase by phase.

    Of the square of a current the law shows the mean, of its cube what is like the current.
    """
    torques_Nm, law = [], []
    for power in (2, 3):
        for p in range(3):
            i_A = point.spectrum.command_A[:, p]
            square = i_A**2
            torques_Nm.append(point.gain[p] * square * i_A ** (power - 2) * point.k[:, p])
            like = np.mean(square**2) / max(np.mean(square), 1e-300)
            law.append(np.eye(4)[3] * np.mean(square) if power == 2 else np.eye(4)[p] * like)
            law[-1] = law[-1] * point.gain[p]
    return np.array(torques_Nm), np.array(law)


def _highpass(point: PointModel) -> np.ndarray:
    """Return the lines (1, orders) of 1/tau that is 1 / s larger than the bench file says."""
    turned = 2j * np.pi * point.spectrum.velocity_Hz * np.arange(1, point.orders + 1)
    gain = point.spectrum.highpass[: point.orders]
    return np.asarray(-point.lines(point.torque_Nm[None]) * gain / turned)


def model_columns(
    models: Sequence[PointModel], regression: Regression, gain: np.ndarray
) -> np.ndarray:
    """Return the lines (points, p, orders) of a unit of each parameter of the model itself.

    gain (3,): delta epsilon alpha, which the currents' age counts with.
    """
    columns = []
    for point in models:
        command_A, waves = point.spectrum.command_A, 2 * regression.orders
        at = np.arange(command_A.shape[0]) * regression.basis.cogging.shape[0]
        cogging = regression.basis.cogging[at // command_A.shape[0], :waves]
        velocity_rad_s = point.spectrum.velocity_rad_s
        own = unit_torques(command_A, velocity_rad_s, point.k, cogging, gain, regression.period_s)
        columns.append(point.lines(own.T))
    return np.array(columns)


def unit_torques(
    command_A: np.ndarray,
    velocity_rad_s: np.ndarray,
    k: np.ndarray,
    cogging: np.ndarray,
    gain: np.ndarray,
    period_s: float,
) -> np.ndarray:
    """Return the torques (bins, p) over the turn of a unit of each parameter of the model.

    command_A, k (bins, 3): commanded currents and back-EMF; velocity_rad_s (bins,); cogging
    (bins, 2 n): waves; gain (3,): delta epsilon alpha; period_s: of sampling.
    """
    rate = derivative_over_time(command_A, velocity_rad_s)
    second = derivative_over_time(rate, velocity_rad_s)
    k_rate = derivative_over_time(k, velocity_rad_s)
    age = DELAY_SHARE * period_s * (rate * k * gain).sum(axis=1)
    zoh = (second * k + 0.5 * rate * k_rate).sum(axis=1) * ZOH_SHARE * period_s**2
    return np.column_stack([command_A * k, k, age, zoh, cogging])
