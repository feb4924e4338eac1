"""The thermal network that explains a heat-up and its cooling, by non-linear least squares.

Parameters are logarithms of heat capacities and conductances, the temperatures at the beginning
and, without a channel, that of the ambient. Residuals are whitened channel by channel (`noise`),
and the fit is repeated; the covariance is that of the whitened fit.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares, nnls

from motord.experiments.thermal.course import CopperResistance, Readings, ThermalCourse
from motord.experiments.thermal.network import AMBIENT, LINKS, LumpedNetwork
from motord.experiments.thermal.noise import Autoregression
from motord.identification import IdentifyError

PASSES = 3
"""How often the noise is taken from the residuals."""

LEAST_READINGS = 30
"""Valid readings of a channel that are needed."""

LEAST_RISE_K = 1.0
"""Rise of the first node below which nothing is found."""

READINGS_MAX = 4000
"""Readings of a channel that are fitted; of more, means of successive ones."""

FLOOR = 1e-3
"""Least capacity or conductance to begin with, in parts of the largest."""


@dataclass(frozen=True)
class ThermalFit:
    """A fit: parameters (p,), covariance (p, p), noise and residuals of each channel, in order."""

    course: ThermalCourse
    copper: CopperResistance
    parameters: np.ndarray
    covariance: np.ndarray
    noises: tuple[Autoregression, ...]
    freedom: int

    @cached_property
    def network(self) -> LumpedNetwork:
        """The network."""
        return network_of(self.course, self.parameters)

    @property
    def ambient_C(self) -> float:
        """Temperature of the ambient, the mean while it is measured."""
        if self.course.ambient is None:
            return float(self.parameters[-1])
        return float(np.nanmean(self.course.ambient.value_C))

    @cached_property
    def fitted_C(self) -> tuple[np.ndarray, ...]:
        """Temperatures of each channel at its readings."""
        return modelled(self.course, self.copper, self.parameters)

    @cached_property
    def residuals_K(self) -> tuple[np.ndarray, ...]:
        """Readings less the fit, of each channel."""
        return tuple(
            each.value_C - fitted
            for each, fitted in zip(self.course.readings.values(), self.fitted_C, strict=True)
        )

    @cached_property
    def feedback_W_per_K(self) -> float:
        """By how much the loss of the heat-up rises with the temperature of the winding."""
        return self.copper.ohm * self.copper.per_K * self.course.heating_A2

    @cached_property
    def whitened_jacobian(self) -> np.ndarray:
        """Whitened change of the residuals by each parameter (n, p)."""
        return _jacobian(
            lambda x: _errors(self.course, self.copper, x, self.noises), self.parameters
        )

    @cached_property
    def whitened_residual(self) -> np.ndarray:
        """Whitened residuals of all channels (n,)."""
        return _errors(self.course, self.copper, self.parameters, self.noises)

    def of(self, derived: Callable[["ThermalFit"], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return what is derived of the fit (m,), and its standard errors (m,)."""

        def at(parameters: np.ndarray) -> np.ndarray:
            return derived(replace(self, parameters=parameters))

        jacobian = _jacobian(at, self.parameters)
        variances = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return at(self.parameters), np.sqrt(np.maximum(variances, 0.0))


def fit(course: ThermalCourse, copper: CopperResistance) -> ThermalFit:
    """Return the fit of a course. Raises IdentifyError for too little of it."""
    _check(course)
    thin = {node: each.thinned(READINGS_MAX) for node, each in course.readings.items()}
    course = replace(course, readings=thin)
    parameters = _start(course, copper)
    noises = tuple(Autoregression.white(1.0) for _ in course.readings)
    for _ in range(PASSES + 1):
        errors = _errors_of(course, copper, noises)
        found = least_squares(errors, parameters, x_scale="jac", method="trf")
        parameters = found.x
        freedom = found.fun.size - parameters.size
        square = float(found.fun @ found.fun) / freedom
        covariance = square * np.linalg.pinv(found.jac.T @ found.jac, rcond=1e-14, hermitian=True)
        fitted = ThermalFit(course, copper, parameters, covariance, noises, freedom)
        noises = _noises(fitted)
    return fitted


def _noises(fitted: ThermalFit) -> tuple[Autoregression, ...]:
    """Return the noise of each channel, from its residuals and what the fit took of it."""
    course, copper = fitted.course, fitted.copper
    sizes = np.cumsum([each.t_s.size for each in course.readings.values()])[:-1]
    jacobian = _jacobian(lambda x: np.concatenate(modelled(course, copper, x)), fitted.parameters)
    root = np.linalg.cholesky(fitted.covariance + 1e-18 * np.eye(fitted.parameters.size))
    taken = np.split(jacobian @ root, sizes)
    return tuple(
        Autoregression.of(left, part) for left, part in zip(fitted.residuals_K, taken, strict=True)
    )


def network_of(course: ThermalCourse, parameters: np.ndarray) -> LumpedNetwork:
    """Return the network of parameters."""
    nodes, links = course.nodes, LINKS[course.nodes]
    sizes = np.exp(np.clip(parameters[: len(nodes) + len(links)], -30, 30))
    return LumpedNetwork(nodes, sizes[: len(nodes)], sizes[len(nodes) :])


def modelled(
    course: ThermalCourse, copper: CopperResistance, parameters: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the temperatures at the readings of each channel."""
    network = network_of(course, parameters)
    first = len(course.nodes) + len(network.links)
    begin_C = parameters[first : first + len(course.nodes)]
    middles_s = course.middles_s
    heated = next(iter(course.readings.values()))
    heat_W = copper.heat_W(course.squares_A2, heated.at(middles_s))
    if course.ambient is not None:
        ambient_C = course.ambient.at(middles_s)
    else:
        ambient_C = np.full(middles_s.size, parameters[-1])
    found = network.temperatures_C(begin_C, heat_W, ambient_C, course.step_s)
    ends_s = course.step_s * np.arange(found.shape[0])
    return tuple(
        np.interp(each.t_s, ends_s, found[:, n]) for n, each in enumerate(course.readings.values())
    )


def _check(course: ThermalCourse) -> None:
    for each in course.readings.values():
        valid = int(np.isfinite(each.value_C).sum())
        if valid < LEAST_READINGS:
            raise IdentifyError(
                f"{each.channel}: {valid} valid readings, {LEAST_READINGS} needed; raise rate_Hz "
                "of its [[channels]], or heat longer"
            )
    heated = next(iter(course.readings.values()))
    rise_K = float(np.nanmax(heated.value_C) - heated.at(np.zeros(1))[0])
    if rise_K < LEAST_RISE_K:
        raise IdentifyError(
            f"{heated.channel} rose by {rise_K:.2g} K, {LEAST_RISE_K:g} K needed; is it the right "
            "channel? raise torque_Nm or current_A, or heating_max_s"
        )


def _residuals(
    course: ThermalCourse, copper: CopperResistance, parameters: np.ndarray
) -> list[np.ndarray]:
    found = modelled(course, copper, parameters)
    readings = course.readings.values()
    return [each.value_C - one for each, one in zip(readings, found, strict=True)]


def whiten(noises: tuple[Autoregression, ...], columns: list[np.ndarray]) -> list[np.ndarray]:
    """Return columns (n_i,) of each channel whitened."""
    return [
        noise.whitened(each[:, None])[:, 0] for noise, each in zip(noises, columns, strict=True)
    ]


def _errors(
    course: ThermalCourse,
    copper: CopperResistance,
    parameters: np.ndarray,
    noises: tuple[Autoregression, ...],
) -> np.ndarray:
    """Return the whitened residuals of all channels (n,), those that there are."""
    every = np.concatenate(whiten(noises, _residuals(course, copper, parameters)))
    return np.asarray(every[np.isfinite(every)])


def _errors_of(
    course: ThermalCourse, copper: CopperResistance, noises: tuple[Autoregression, ...]
) -> Callable[[np.ndarray], np.ndarray]:
    return lambda parameters: _errors(course, copper, parameters, noises)


def _jacobian(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return the derivatives (m, p) by central differences."""
    columns = []
    for n in range(at.size):
        step = np.zeros(at.size)
        step[n] = 1e-4 * max(1.0, abs(at[n]) * 0.01)
        columns.append((function(at + step) - function(at - step)) / (2 * step[n]))
    return np.stack(columns, axis=1)


def _start(course: ThermalCourse, copper: CopperResistance) -> np.ndarray:
    """Return parameters to begin with: the heat balance of each node, integrated, is linear.

    int P dt = C_i (T_i - T_i(0)) + sum_j G_ij int (T_i - T_j) dt
    """
    nodes, links = course.nodes, LINKS[course.nodes]
    t_s = course.step_s * np.arange(course.squares_A2.size + 1)
    smooth = {node: _smoothed(each, t_s) for node, each in course.readings.items()}
    at_rest = min(float(one[0]) for one in smooth.values())
    ambient = np.full(t_s.size, at_rest) if course.ambient is None else course.ambient.at(t_s)
    level = {**smooth, AMBIENT: ambient}
    middle = 0.5 * (smooth[nodes[0]][1:] + smooth[nodes[0]][:-1])
    heat_J = _integral(copper.heat_W(course.squares_A2, middle), course.step_s)
    rows, wanted = [], []
    for n, node in enumerate(nodes):
        columns = np.zeros((t_s.size, len(nodes) + len(links)))
        columns[:, n] = level[node] - level[node][0]
        for m, link in enumerate(links, start=len(nodes)):
            if node in link:
                other = link[1 - link.index(node)]
                apart = level[node] - level[other]
                columns[:, m] = _integral(0.5 * (apart[1:] + apart[:-1]), course.step_s)
        rows.append(columns)
        wanted.append(heat_J if n == 0 else np.zeros(t_s.size))
    matrix = np.concatenate(rows)
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-12)
    sizes, _ = nnls(matrix / scale, np.concatenate(wanted), maxiter=1000)
    sizes = sizes / scale
    for part in (slice(0, len(nodes)), slice(len(nodes), None)):
        sizes[part] = np.maximum(sizes[part], FLOOR * max(float(sizes[part].max()), 1e-9))
    begin_C = [float(one[0]) for one in smooth.values()]
    fitted = [] if course.ambient is not None else [at_rest]
    return np.array([*np.log(sizes), *begin_C, *fitted])


def _smoothed(readings: Readings, t_s: np.ndarray) -> np.ndarray:
    return readings.thinned(400).at(t_s)


def _integral(values: np.ndarray, step_s: float) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(values) * step_s])
