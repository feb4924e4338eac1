"""The thermal network that explains a heat-up and its cooling, by non-linear least squares.

Parameters are logarithms of heat capacities and conductances, the temperatures at the beginning
and, without a channel, that of the ambient. Residuals are whitened channel by channel (`noise`),
and the fit is repeated; the covariance is that of the whitened fit. Sensors that are late are
first-order filters, whose time constants are parameters where the readings show a lag.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares, nnls

from motord.experiments.thermal.course import (
    CopperResistance,
    ThermalCourse,
    check,
    freedom_of,
)
from motord.experiments.thermal.network import AMBIENT, LINKS, LumpedNetwork
from motord.experiments.thermal.noise import Autoregression
from motord.experiments.thermal.recursion import recur

PASSES = 3
"""How often the noise is taken from the residuals."""

UNDETERMINED = 1e-9
"""Least effect of a combination of parameters, in parts of that of the best determined one: those
that have none get a large standard error, not none."""

READINGS_MAX = 4000
"""Readings of a channel that are fitted; of more, means of successive ones."""

FLOOR = 1e-3
"""Least capacity or conductance to begin with, in parts of the largest."""


@dataclass(frozen=True)
class ThermalFit:
    """A fit: parameters (p,), lags last, and noise of each channel, in order.

    root (p, p): that of the covariance of the parameters, root @ root.T. freedom: degrees of.
    """

    course: ThermalCourse
    copper: CopperResistance
    parameters: np.ndarray
    root: np.ndarray
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
            return float(self.parameters[_first_lag(self.course) - 1])
        return float(np.nanmean(self.course.ambient.value_C))

    @property
    def lags_s(self) -> np.ndarray:
        """Lag of each sensor (n,); (0,) where lags are no parameters."""
        return self.parameters[_first_lag(self.course) :]

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
    def effects_K(self) -> np.ndarray:
        """Change of the temperatures of all channels by each parameter (n, p)."""
        return _jacobian(
            lambda x: np.concatenate(modelled(self.course, self.copper, x)), self.parameters
        )

    def by_channel(self, values: np.ndarray) -> list[np.ndarray]:
        """Return values (n,) or (n, p), rows of all channels, of each."""
        sizes = np.cumsum([each.t_s.size for each in self.course.readings.values()])
        return np.split(values, sizes[:-1])

    @cached_property
    def whitened_jacobian(self) -> np.ndarray:
        """Whitened change of the residuals by each parameter (n, p)."""
        columns = [whiten(self.noises, self.by_channel(one)) for one in self.effects_K.T]
        return -np.column_stack(columns)

    @cached_property
    def whitened_residual(self) -> np.ndarray:
        """Whitened residuals of all channels (n,)."""
        return whiten(self.noises, self.residuals_K)

    def of(self, derived: Callable[["ThermalFit"], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return what is derived of the fit (m,), and its standard errors (m,)."""

        def at(parameters: np.ndarray) -> np.ndarray:
            return derived(replace(self, parameters=parameters))

        return at(self.parameters), np.linalg.norm(
            _jacobian(at, self.parameters) @ self.root, axis=1
        )


def fit(course: ThermalCourse, copper: CopperResistance) -> ThermalFit:
    """Return the fit of a course. Raises IdentifyError for too little of it."""
    thin = {node: each.thinned(READINGS_MAX) for node, each in course.readings.items()}
    course = replace(course, readings=thin)
    check(course)
    parameters = _start(course, copper)
    freedom = freedom_of(course, parameters.size)
    noises = tuple(
        Autoregression.white(np.isfinite(each.value_C), 1.0) for each in course.readings.values()
    )
    fitted = _fitted(course, copper, parameters, noises, freedom)
    for _ in range(PASSES):
        fitted = _fitted(course, copper, fitted.parameters, _noises(fitted), freedom)
    return fitted


def with_lags(fit: ThermalFit) -> ThermalFit:
    """Return the fit with the lag of each sensor, s, as a further parameter."""
    parameters = np.r_[fit.parameters, np.zeros(len(fit.course.nodes))]
    freedom, noises = fit.freedom - len(fit.course.nodes), fit.noises
    for _ in range(PASSES):
        fit = _fitted(fit.course, fit.copper, parameters, noises, freedom)
        parameters, noises = fit.parameters, _noises(fit)
    return fit


def _fitted(
    course: ThermalCourse,
    copper: CopperResistance,
    begin: np.ndarray,
    noises: tuple[Autoregression, ...],
    freedom: int,
) -> ThermalFit:
    """Return the least squares of residuals that are whitened by `noises`."""
    found = least_squares(
        lambda x: _errors(course, copper, x, noises), begin, x_scale="jac", method="trf"
    )
    _, effects, directions = np.linalg.svd(found.jac, full_matrices=False)
    effects = np.maximum(effects, UNDETERMINED * effects[0])
    root = directions.T / effects * np.sqrt(float(found.fun @ found.fun) / freedom)
    return ThermalFit(course, copper, found.x, root, noises, freedom)


def _noises(fitted: ThermalFit) -> tuple[Autoregression, ...]:
    """Return the noise of each channel, from its residuals and what the fit took of it."""
    roots = fitted.by_channel(fitted.effects_K @ fitted.root)
    return tuple(
        Autoregression.of(left, root) for left, root in zip(fitted.residuals_K, roots, strict=True)
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
    heat_W = copper.heat_W(course.squares_A2, course.heated_C)
    if course.ambient is not None:
        ambient_C = course.ambient.at(course.middles_s)
    else:
        ambient_C = np.full(heat_W.size, parameters[_first_lag(course) - 1])
    found = network.temperatures_C(begin_C, heat_W, ambient_C, course.step_s)
    for n, lag_s in enumerate(parameters[_first_lag(course) :]):
        found[:, n] = _late(found[:, n], float(lag_s), course.step_s)
    ends_s = course.step_s * np.arange(found.shape[0])
    return tuple(
        np.interp(each.t_s, ends_s, found[:, n]) for n, each in enumerate(course.readings.values())
    )


def _first_lag(course: ThermalCourse) -> int:
    """Return how many parameters there are without lags, that of the ambient the last."""
    return 2 * len(course.nodes) + len(LINKS[course.nodes]) + (course.ambient is None)


def _late(course_C: np.ndarray, lag_s: float, step_s: float) -> np.ndarray:
    """Return what a sensor of that time constant shows of temperatures (k,), straight in between.

    Below zero it is as early, so that a lag of zero has an error to either side.
    """
    if lag_s == 0.0:
        return course_C
    keep = np.exp(-step_s / abs(lag_s))
    behind_K = np.zeros(course_C.size)
    behind_K[1:] = -np.diff(course_C) * (1 - keep) * abs(lag_s) / step_s
    recur(behind_K, np.array([keep]))
    return np.asarray(course_C + np.copysign(1.0, lag_s) * behind_K)


def whiten(noises: tuple[Autoregression, ...], columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return columns (n_i,) of each channel whitened (n,), at valid readings."""
    return np.concatenate(
        [noise.whitened(each) for noise, each in zip(noises, columns, strict=True)]
    )


def _errors(
    course: ThermalCourse,
    copper: CopperResistance,
    parameters: np.ndarray,
    noises: tuple[Autoregression, ...],
) -> np.ndarray:
    """Return the whitened residuals of all valid readings (n,)."""
    found, readings = modelled(course, copper, parameters), course.readings.values()
    return whiten(noises, [each.value_C - one for each, one in zip(readings, found, strict=True)])


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
    smooth = {node: each.thinned(400).at(t_s) for node, each in course.readings.items()}
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


def _integral(values: np.ndarray, step_s: float) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(values) * step_s])
