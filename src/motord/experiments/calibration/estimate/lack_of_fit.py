"""Lack of fit: what the joint estimator leaves at each order of the turn, beyond noise, and why.

rest_h(p) is the line that the model leaves at order h of operating point p. Where the model holds,
sum_p |rest_h(p)|^2 / noise_h(p)^2 is a sum of P squares of two noises each, over P: F distributed.
Encoder errors come first, because one of order m makes neighbours h +- m of every order h: the
angle theta + e(theta) is read, so the torque misses T'(theta) e(theta), with T' the change of the
model's torque with the angle at the present currents.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from motord.experiments.calibration.estimate.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
    Regression,
)
from motord.experiments.calibration.estimate.turn_spectrum import SMOOTHED_ORDERS, TurnSpectrum

FALSE_SHARE = 0.002
"""Probability that noise is taken for an order, or an encoder error, over all that are tried."""

ENCODER_ORDERS = (0, 1, 2, 3, 4)
"""Orders of encoder errors that are looked for; 0 is its zero."""

SECOND_ORDER_SHARE = 0.15
"""Orders with less than this share of the largest line of an encoder error count as its."""

NOISE_FREEDOM = 2 * SMOOTHED_ORDERS
"""Degrees of freedom of the noise of one point and order."""


@dataclass(frozen=True)
class EncoderError:
    """An encoder that reads theta + amplitude_rad sin(order theta + phase_rad); order 0: its zero.

    p_value: the probability of so much by chance.
    """

    order: int
    amplitude_rad: float
    phase_rad: float
    stderr_rad: float
    p_value: float


@dataclass(frozen=True)
class LeftOrder:
    """An order at which the model leaves more than noise.

    rms_Nm, noise_Nm: over the operating points. power: of the torque, 0, 1 or 2, with which it
    grows best.
    """

    order: int
    rms_Nm: float
    noise_Nm: float
    power: int
    p_value: float


@dataclass(frozen=True)
class LackOfFit:
    """What a fit leaves. rest_Nm, noise_Nm (points, orders): lines and their standard errors.

    left_Nm (points, orders): lines that encoder errors do not account for; left: the orders at
    which these are more than noise.
    """

    torque_Nm: np.ndarray
    rest_Nm: np.ndarray
    noise_Nm: np.ndarray
    left_Nm: np.ndarray
    encoder: tuple[EncoderError, ...]
    left: tuple[LeftOrder, ...]

    @property
    def minor(self) -> tuple[int, ...]:
        """Orders at which no more is left than an encoder error makes in second order."""
        power = (np.abs(self.left_Nm) ** 2).mean(axis=0)
        largest = (np.abs(self.rest_Nm - self.left_Nm) ** 2).mean(axis=0).max()
        return tuple((np.flatnonzero(power <= SECOND_ORDER_SHARE**2 * largest) + 1).tolist())


def lack_of_fit(regression: Regression, theta: np.ndarray) -> LackOfFit:
    """Return what the parameters theta (p,) leave of the points' torque."""
    points = [point.spectrum for point in regression.points]
    highest = min(point.highest for point in points)
    coefficients = regression.coefficients(theta)
    lines = [point.residual(coefficients) for point in points]
    rest_Nm = np.array([rest[:highest] for rest, _ in lines])
    noise_Nm = _not_zero(np.array([noise[:highest] for _, noise in lines]))
    torque_Nm = np.array([point.torque_set_Nm for point in points])
    changes = [_change_with_angle(regression, point, theta) for point in points]
    encoder = _encoder_errors(points, changes, rest_Nm, noise_Nm)
    unexplained_Nm = rest_Nm.copy()
    for error in encoder:
        for row, (point, change) in enumerate(zip(points, changes, strict=True)):
            effects = _encoder_effects(point, change, error.order, highest)
            size = error.amplitude_rad * np.array(
                [np.sin(error.phase_rad), np.cos(error.phase_rad)][: len(effects)]
            )
            unexplained_Nm[row] -= size @ effects
    left = _left_orders(torque_Nm, unexplained_Nm, noise_Nm)
    return LackOfFit(torque_Nm, rest_Nm, noise_Nm, unexplained_Nm, encoder, left)


def _not_zero(noise_Nm: np.ndarray) -> np.ndarray:
    """Return the noise (points, orders), nowhere less than 1e-12 of the largest."""
    return np.asarray(np.maximum(noise_Nm, 1e-12 * max(float(noise_Nm.max()), 1e-300)))


def _change_with_angle(
    regression: Regression, point: TurnSpectrum, theta: np.ndarray
) -> np.ndarray:
    """Return dT/dtheta of the model at the commanded currents (bins,), Nm/rad."""
    basis, bins = regression.basis, point.command_A.shape[0]
    tables = np.column_stack([basis.back_emf, basis.cogging[:, : 2 * regression.orders]])
    at = np.arange(bins) * tables.shape[0] // bins
    slopes = np.column_stack([_slope(column)[at] for column in tables.T])
    of_currents = (slopes[:, :3] * point.command_A) @ theta[ALPHA]
    of_currents += slopes[:, :3] @ theta[BETA]
    return np.asarray(of_currents + slopes[:, 3:] @ theta[FIRST_COGGING:])


def _slope(table: np.ndarray) -> np.ndarray:
    """Return the derivative over the angle of a table over the turn (counts,)."""
    lines = np.fft.rfft(table)
    return np.asarray(np.fft.irfft(1j * np.arange(lines.size) * lines, table.size))


def _encoder_effects(
    point: TurnSpectrum, change_Nm_per_rad: np.ndarray, order: int, highest: int
) -> np.ndarray:
    """Return lines (2, highest) that encoder errors cos(m theta), sin(m theta) of 1 rad leave.

    Of order 0, which has no sine, (1, highest).
    """
    bins = change_Nm_per_rad.size
    angle_rad = order * 2 * np.pi * np.arange(bins) / bins
    waves = [np.cos(angle_rad), np.sin(angle_rad)][: 1 if order == 0 else 2]
    lines = np.fft.rfft(-change_Nm_per_rad * np.array(waves), axis=1)[:, 1 : highest + 1]
    return np.asarray(2 / bins * lines * point.highpass[:highest])


def _encoder_errors(
    points: list[TurnSpectrum],
    changes: list[np.ndarray],
    rest_Nm: np.ndarray,
    noise_Nm: np.ndarray,
) -> tuple[EncoderError, ...]:
    """Return the encoder errors that explain significantly more than noise of the rest.

    The largest is fitted first, then what it leaves is looked at for the others. Where the rest is
    larger than noise for another reason, that counts as noise.
    """
    found: list[EncoderError] = []
    rest_Nm, orders = rest_Nm.copy(), list(ENCODER_ORDERS)
    while orders:
        tried = []
        for order in orders:
            effects = np.array(
                [
                    _encoder_effects(point, change, order, rest_Nm.shape[1])
                    for point, change in zip(points, changes, strict=True)
                ]
            )
            tried.append(_fit_encoder_error(order, effects, rest_Nm, noise_Nm))
        best = min(tried, key=lambda one: one[0].p_value)
        error, explained_Nm = best
        if error.p_value > FALSE_SHARE / len(ENCODER_ORDERS):
            break
        found.append(error)
        rest_Nm = rest_Nm - explained_Nm
        orders.remove(error.order)
    return tuple(found)


def _fit_encoder_error(
    order: int, effects: np.ndarray, rest_Nm: np.ndarray, noise_Nm: np.ndarray
) -> tuple[EncoderError, np.ndarray]:
    """Fit the error of one order to the rest (points, h); effects (points, 1 or 2, h).

    Returns it, and what it explains of the rest. Order by order: the noise at an order is the
    measured one, or what the fit leaves there over the points, if that is more.
    """
    terms = effects.shape[1]
    scaled = np.moveaxis(effects, 1, 2) / noise_Nm[:, :, None]
    wanted = rest_Nm / noise_Nm
    dispersion = np.ones(rest_Nm.shape[1])
    for _ in range(3):
        x = (scaled / np.sqrt(dispersion)[None, :, None]).reshape(-1, terms)
        y = (wanted / np.sqrt(dispersion)).ravel()
        normal = (x.conj().T @ x).real
        right = (x.conj().T @ y).real
        solution = np.linalg.lstsq(normal, right, rcond=1e-12)[0]
        left = wanted - scaled @ solution
        dispersion = np.maximum((np.abs(left) ** 2).mean(axis=0), 1.0)
    # a line of noise 1 has 1/2 in its real part: the information is twice the normal matrix
    gained = 2 * float(right @ solution)
    freedom = 2 * wanted.size
    statistic = gained / terms
    variance = np.linalg.pinv(2 * normal)
    cosine, sine = (*solution, 0.0)[:2]
    amplitude = float(np.hypot(cosine, sine))
    direction = solution / max(amplitude, 1e-300)
    error = EncoderError(
        order=order,
        amplitude_rad=amplitude if order else float(cosine),
        phase_rad=float(np.arctan2(cosine, sine)) if order else np.pi / 2,
        stderr_rad=float(np.sqrt(direction @ variance @ direction)),
        p_value=float(stats.f.sf(statistic, terms, min(freedom, NOISE_FREEDOM * wanted.shape[0]))),
    )
    return error, scaled @ solution * noise_Nm


def _left_orders(
    torque_Nm: np.ndarray, rest_Nm: np.ndarray, noise_Nm: np.ndarray
) -> tuple[LeftOrder, ...]:
    """Return the orders at which the rest (points, h) is significantly more than noise."""
    points, orders = rest_Nm.shape
    squares = np.abs(rest_Nm) ** 2 / noise_Nm**2
    p_values = stats.f.sf(squares.mean(axis=0), 2 * points, NOISE_FREEDOM * points)
    found = []
    for column in np.flatnonzero(p_values < FALSE_SHARE / orders):
        y = rest_Nm[:, column] / noise_Nm[:, column]
        gains = []
        for power in (0, 1, 2):
            x = torque_Nm**power / noise_Nm[:, column]
            gains.append(float(np.abs(x @ y) ** 2 / max(x @ x, 1e-300)))
        found.append(
            LeftOrder(
                order=int(column) + 1,
                rms_Nm=float(np.sqrt((np.abs(rest_Nm[:, column]) ** 2).mean() / 2)),
                noise_Nm=float(np.sqrt((noise_Nm[:, column] ** 2).mean() / 2)),
                power=int(np.argmax(gains)),
                p_value=float(p_values[column]),
            )
        )
    return tuple(found)
