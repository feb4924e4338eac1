"""Departures from the network that residuals show, and what they do to the parameters.

    r = W (y - f),   d = c' r / c' c,   u(d) = s / |c|,   shift of the parameters = F^+ c' d

t-tests of an added variable in the linear form of the fit, by feasible generalised least squares:
c, the whitened effect of a departure of one unit on the readings, less what the parameters take of
it; of lags also what others take, as all sensors may have one. Where d is no chance (5 %),
d^2 - u(d)^2 is variance of the parameters by their shift, departure by departure: an effect that is
known to be there and is not corrected (GUM, F.2.4.5). So the intervals of constants hold it, also
where it is too small for a finding. Lags, which move short time constants by more than their first
order and all together, are fitted instead. W and s are of the noise that all departures together
leave of the residuals: an autoregression of the residuals themselves would take a part of what
departs for noise. F^+ is that of the fit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.polynomial import Legendre

from motord.experiments.thermal.estimate import (
    PASSES,
    UNDETERMINED,
    ThermalFit,
    whiten,
    with_lags,
)
from motord.experiments.thermal.network import AMBIENT
from motord.experiments.thermal.noise import Autoregression
from motord.intervals import coverage_factor

AMBIENT_DEGREES = (1, 2, 3)
"""Of the Legendre polynomials over time by which an ambient that is not measured may change."""

Kind = Literal["ambient", "cooling", "lag"]


@dataclass(frozen=True)
class Departure:
    """A departure with its standard error, and the parameters' shift (p,) that it makes.

    ambient: K from end to end or from trough to crest, of a polynomial of `degree`; cooling:
    conductance to the ambient without current, less that with it, in parts; lag: s, of `channel`.
    """

    kind: Kind
    value: float
    stderr: float
    shift: np.ndarray
    degree: int = 0
    channel: str = ""

    @property
    def ratio(self) -> float:
        """The departure in standard errors."""
        return abs(self.value) / self.stderr

    @property
    def is_beyond_chance(self) -> bool:
        """Whether it is there (5 %).

        No lag below zero, as no sensor is early: after a heat-up without cooling the noise makes
        such a one.
        """
        return (self.kind != "lag" or self.value > 0) and self.ratio > coverage_factor()

    @property
    def shift_beyond_chance(self) -> np.ndarray:
        """The shift (p,) of what the departure is beyond its standard error; none by chance."""
        return self.shift * (np.sqrt(1 - 1 / self.ratio**2) if self.is_beyond_chance else 0.0)


def departures(fit: ThermalFit) -> tuple[Departure, ...]:
    """Return the departures that the readings can show."""
    return tuple(_departures(fit))


def less_lags(fit: ThermalFit) -> tuple[ThermalFit, tuple[Departure, ...]]:
    """Return the fit, with lags as parameters if it shows one, and its departures."""
    shown = departures(fit)
    if any(one.kind == "lag" and one.is_beyond_chance for one in shown):
        fit = with_lags(fit)
        shown = departures(fit)
    return fit, shown


def with_departures(fit: ThermalFit, found: Sequence[Departure]) -> ThermalFit:
    """Return the fit with departures in the covariance of its parameters."""
    beyond = [one.shift_beyond_chance for one in found]
    return replace(fit, root=np.column_stack([fit.root, *beyond]))


def _departures(fit: ThermalFit) -> Iterator[Departure]:
    course, steps = fit.course, fit.course.squares_A2.size
    part = np.linspace(-1.0, 1.0, steps)
    ambients: dict[int, list[np.ndarray]] = {}
    if course.ambient is None:
        for degree in AMBIENT_DEGREES:
            around_K = Legendre.basis(degree)(part)
            ambients[degree] = _of_ambient(fit, around_K / np.ptp(around_K))
    cooling = _of_ambient(fit, _colder_than_ambient_K(fit))
    lags = [_of_lag(fit, place) for place in range(len(course.nodes) - fit.lags_s.size)]
    noise = _of_larger_model(fit, [*ambients.values(), cooling, *lags])
    for degree, columns in ambients.items():
        yield replace(_departure("ambient", fit, noise, columns), degree=degree)
    yield _departure("cooling", fit, noise, cooling)
    yield from _fitted_lags(fit)
    for n, (lag, each) in enumerate(zip(lags, course.readings.values(), strict=False)):
        others = [columns for place, columns in enumerate(lags) if place != n]
        yield replace(_departure("lag", fit, noise, lag, others), channel=each.channel)


def _of_larger_model(fit: ThermalFit, departing: Sequence[list[np.ndarray]]) -> ThermalFit:
    """Return the fit with the noise of residuals less departures (n_i,), fitted together."""
    columns = np.column_stack([fit.effects_K, *map(np.concatenate, departing)])
    left_K = np.concatenate(fit.residuals_K)
    for _ in range(PASSES):
        white = np.column_stack([whiten(fit.noises, fit.by_channel(one)) for one in columns.T])
        base, sizes, directions = np.linalg.svd(white, full_matrices=False)
        inverse = directions.T / np.maximum(sizes, UNDETERMINED * sizes[0])
        taken = base.T @ fit.whitened_residual
        left = fit.whitened_residual - base @ taken
        scale = np.linalg.norm(left) / np.sqrt(fit.freedom)
        roots = fit.by_channel(columns @ inverse * scale)
        residuals = fit.by_channel(left_K - columns @ (inverse @ taken))
        noises = tuple(map(Autoregression.of, residuals, roots))
        fit = replace(fit, noises=noises)
    return fit


def _of_ambient(fit: ThermalFit, around_K: np.ndarray) -> list[np.ndarray]:
    """Return what an ambient that is warmer by around_K (k,) makes of the readings (n_i,)."""
    course, steps = fit.course, around_K.size
    still = np.zeros(len(course.nodes))
    moved_K = fit.network.temperatures_C(still, np.zeros(steps), around_K, course.step_s)
    ends_s = course.step_s * np.arange(steps + 1)
    return [
        np.interp(each.t_s, ends_s, moved_K[:, n])
        for n, each in enumerate(course.readings.values())
    ]


def _of_lag(fit: ThermalFit, place: int) -> list[np.ndarray]:
    """Return what a sensor that is late by 1 s makes of the readings (n_i,), at least at first."""
    each, fitted_C = tuple(fit.course.readings.values())[place], fit.fitted_C[place]
    columns = [np.zeros(one.size) for one in fit.fitted_C]
    columns[place] = -np.gradient(fitted_C, each.t_s)
    return columns


def _fitted_lags(fit: ThermalFit) -> Iterator[Departure]:
    """Yield the lags that are parameters: they shift no other."""
    lags_s, none = fit.lags_s, np.zeros(fit.parameters.size)
    errors_s = np.linalg.norm(fit.root[none.size - lags_s.size :], axis=1)
    for each, lag_s, error_s in zip(fit.course.readings.values(), lags_s, errors_s, strict=False):
        yield Departure("lag", float(lag_s), float(error_s), none, channel=each.channel)


def _colder_than_ambient_K(fit: ThermalFit) -> np.ndarray:
    """Return the ambient less its neighbour while it cools (k,), 0 before.

    More conductance to the ambient takes as much heat as an ambient that is so much colder.
    """
    course, t_s = fit.course, fit.course.middles_s
    [node] = {one for link in fit.network.links if AMBIENT in link for one in link} - {AMBIENT}
    place = course.nodes.index(node)
    node_C = np.interp(t_s, tuple(course.readings.values())[place].t_s, fit.fitted_C[place])
    ambient_C = fit.ambient_C if course.ambient is None else course.ambient.at(t_s)
    return np.where(t_s < course.heating_s, 0.0, ambient_C - node_C)


def _departure(
    kind: Kind,
    fit: ThermalFit,
    noise: ThermalFit,
    columns: list[np.ndarray],
    others: Sequence[list[np.ndarray]] = (),
) -> Departure:
    """Return how much of columns (n_i,) the residuals have, with its standard error.

    noise: the fit with the noise that counts; others: columns of departures that may be there, too.
    """
    effect = whiten(fit.noises, columns)
    shift = np.linalg.lstsq(fit.whitened_jacobian, effect, rcond=UNDETERMINED)[0]
    wider = [whiten(noise.noises, one) for one in (columns, *others)]
    known = np.column_stack([noise.whitened_jacobian, *wider[1:]])
    both = np.column_stack([wider[0], noise.whitened_residual])
    column, residual = (both - known @ np.linalg.lstsq(known, both, rcond=UNDETERMINED)[0]).T
    square = float(column @ column)
    if not square > 0:
        return Departure(kind, 0.0, np.inf, 0 * shift)
    value = float(column @ residual) / square
    left = residual - value * column
    scale = np.sqrt(float(left @ left) / fit.freedom)
    return Departure(kind, value, float(scale / np.sqrt(square)), -shift * value)
