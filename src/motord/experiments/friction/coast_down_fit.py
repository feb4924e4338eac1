"""The linear fit of coast-downs of one direction, and which orders of cogging torque it has."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from motord.config import MotorConfig
from motord.experiments.friction.coast_down import CoastDown
from motord.experiments.friction.two_step_fit import OWN, TwoStepFit, bases, partialled_out
from motord.identification import IdentifyError
from motord.identification.cluster_robust_ls import Regressors
from motord.identification.orders import allowed_orders

SHAFT_ORDERS = (1, 2)
"""Orders of gravity on a rotor that is out of balance, and of a shaft out of line."""

BACK_EMF_ORDERS = (1, 3, 5, 7)
"""Electrical orders at which current offsets pull: those of the back-EMF."""

SAMPLES_PER_PERIOD = 2.5
"""Samples that the highest order needs in a period at the highest speed."""

RELAXATION = 0.5
"""Relaxation factor of the iteration over the fitted angles: with 1 it oscillates."""

ROUNDS_PER_ORDER = 3
ROUNDS_MAX = 40

SETTLED_RAD = 1e-5
"""Change of the fitted angles from one round to the next below which they have settled."""

STRIBECK_SPEEDS = 12
"""Values of w_s that are tried before the search."""

LEAST_STRIBECK = 0.05
"""Least w_s that is tried before cogging torque is known, in parts of the highest speed."""

STRIBECK_ROUNDS = 3


@dataclass(frozen=True)
class CoastDownFit:
    """Coast-downs of one direction, fitted without a Stribeck part.

    q_rad, speeds_rad_s: (n,) of each, by the fit; values, columns of all, one after the other;
    first (g,): the first row of each.
    """

    coasts: tuple[CoastDown, ...]
    orders: np.ndarray
    q_rad: tuple[np.ndarray, ...]
    values: np.ndarray
    columns: np.ndarray
    first: np.ndarray
    fit: TwoStepFit

    @classmethod
    def of(
        cls,
        coasts: tuple[CoastDown, ...],
        orders: Sequence[int],
        q_rad: Sequence[np.ndarray],
        at_rad_s: float = 0.0,
    ) -> "CoastDownFit":
        """Fit Coulomb and viscous friction and the torque at `orders`; q_rad: within integrals.

        at_rad_s: w_s of a Stribeck part that is fitted, too.
        """
        pairs, order = list(zip(coasts, q_rad, strict=True)), np.array(orders, int)
        values = np.concatenate([one.projected(one.q_rad) for one in coasts])
        columns = np.concatenate([one.projected(one.twice(order, q)) for one, q in pairs])
        if at_rad_s:
            parts = [one.stribeck(np.gradient(q, one.t_s), at_rad_s) for one, q in pairs]
            more = [one.projected(part) for one, part in zip(coasts, parts, strict=True)]
            columns = np.hstack([columns, np.concatenate(more)])
        first = np.cumsum([0, *(one.t_s.size for one in coasts[:-1])])
        fit = TwoStepFit.of(columns, first, values)
        group = cls(coasts, order, tuple(q_rad), values, columns, first, fit)
        fitted = tuple(
            (1 - RELAXATION) * q + RELAXATION * (one.q_rad - residual)
            for (one, q), residual in zip(pairs, group.split(fit.common.residual), strict=True)
        )
        return replace(group, q_rad=fitted)

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Return values (n,), rows of all coast-downs, of each."""
        return np.split(values, self.first[1:])

    def settled(self, at_rad_s: float) -> "CoastDownFit":
        """Return the fit with its own angle within the integrals."""
        group = self
        for _ in range(ROUNDS_MAX):
            new = CoastDownFit.of(group.coasts, group.orders.tolist(), group.q_rad, at_rad_s)
            pairs = zip(group.q_rad, new.q_rad, strict=True)
            if max(float(np.abs(after - before).max()) for before, after in pairs) < SETTLED_RAD:
                return new
            group = new
        raise IdentifyError(
            "the fit does not settle: near the stop speed the cogging torque nearly holds the "
            "rotor; raise stop_speed_Hz"
        )

    def speeds_rad_s(self) -> list[np.ndarray]:
        """Return the speed (n,) over each coast-down, by the fit."""
        pairs = zip(self.coasts, self.q_rad, strict=True)
        return [np.asarray(np.gradient(q, one.t_s)) for one, q in pairs]

    def gain(self, order: int) -> float:
        """Return by how much the Bayesian information criterion falls with one more order."""
        pairs = zip(self.coasts, self.q_rad, strict=True)
        more = np.concatenate(
            [c.projected(c.twice(np.array([order]), q)[:, OWN:]) for c, q in pairs]
        )
        return self.gain_with(more)

    def gain_with(self, more: np.ndarray) -> float:
        """Return by how much the Bayesian information criterion falls with two more parameters.

        more (n, 1) or (n, 2): their columns; a Stribeck part has one, and its speed is searched.
        Each coast-down has Coulomb and viscous friction of its own here: what friction differs by
        from one to the next is no white noise, and other columns would seem to explain it.
        """
        n = self.values.size
        ratio = self._squares / self.residual_squares(more)
        return float(n * np.log(ratio) - 2 * np.log(n))

    def residual_squares(self, more: np.ndarray | None = None) -> float:
        """Return the residual sum of squares with own friction, and with more columns (n, m)."""
        columns = self.columns if more is None else np.hstack([self.columns, more])
        common, values = partialled_out(self._bases, columns[:, OWN:], self.values, self.first)
        _, residual = Regressors.of(common, self.first).solved(values)
        return float(residual @ residual)

    @cached_property
    def _squares(self) -> float:
        return self.residual_squares()

    @cached_property
    def _bases(self) -> list[np.ndarray]:
        return bases(self.columns[:, :OWN], self.first)

    def with_stribeck(
        self, speeds_rad_s: Sequence[np.ndarray], at_rad_s: float, scale: float = 0.0
    ) -> TwoStepFit:
        """Fit a Stribeck part of w_s `at_rad_s`, too; with `scale` (S/J) w_s is free around it."""
        columns = [self.columns, self.stribeck(speeds_rad_s, at_rad_s, scale)]
        return TwoStepFit.of(np.hstack(columns), self.first, self.values)

    def stribeck(
        self, speeds_rad_s: Sequence[np.ndarray], at_rad_s: float, scale: float = 0.0
    ) -> np.ndarray:
        """Return the columns of a Stribeck part (n, 1), with `scale` (n, 2)."""
        pairs = zip(self.coasts, speeds_rad_s, strict=True)
        more = [one.projected(one.stribeck(speed, at_rad_s, scale)) for one, speed in pairs]
        return np.concatenate(more)

    def best_stribeck(self, speeds_rad_s: Sequence[np.ndarray], tried: np.ndarray) -> float:
        """Return the w_s that fits best, near the best of those `tried` (n,), rising."""

        def misfit(at_rad_s: float) -> float:
            return self.residual_squares(self.stribeck(speeds_rad_s, at_rad_s))

        best = int(np.argmin([misfit(float(at)) for at in tried]))
        bounds = tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)]
        return float(minimize_scalar(misfit, bounds=bounds, method="bounded").x)


def fitted(
    coasts: tuple[CoastDown, ...], motor: MotorConfig
) -> tuple[CoastDownFit, list[np.ndarray]]:
    """Return the fit with as many of the orders that there may be as the data need, and speeds.

    The orders are taken best first; the fit is without a Stribeck part, the speeds with it.
    """
    fastest = max(float((np.diff(one.q_rad[::10])).max()) / 10 for one in coasts)
    highest = int(2 * np.pi / (SAMPLES_PER_PERIOD * fastest))
    left = {
        *SHAFT_ORDERS,
        *(motor.pole_pairs * order for order in BACK_EMF_ORDERS),
        *allowed_orders(motor.slots, 2 * motor.pole_pairs, highest),
    }
    left = {order for order in left if order <= highest}
    taken: list[int] = []
    group = CoastDownFit.of(coasts, taken, [one.smooth_rad() for one in coasts])
    for _ in range(STRIBECK_ROUNDS):
        at_rad_s = _apparent_stribeck(CoastDownFit.of(coasts, taken, group.q_rad))
        group = CoastDownFit.of(coasts, taken, group.q_rad, at_rad_s)
    while left:
        gains = {order: group.gain(order) for order in sorted(left)}
        best = max(gains, key=gains.__getitem__)
        if gains[best] <= 0:
            break
        left.remove(best)
        taken = sorted([*taken, best])
        for _ in range(ROUNDS_PER_ORDER):
            group = CoastDownFit.of(coasts, taken, group.q_rad, at_rad_s)
    group = group.settled(at_rad_s)
    plain = CoastDownFit.of(coasts, taken, group.q_rad) if at_rad_s else group
    return plain, group.speeds_rad_s()


def stribeck_speeds(low_rad_s: float, high_rad_s: float) -> np.ndarray:
    """Return the w_s that are tried (n,), rising: from the least speed to half of the highest.

    Speeds may be so near each other that half of the highest is below the least.
    """
    return np.geomspace(low_rad_s, max(high_rad_s / 2, 1.2 * low_rad_s), STRIBECK_SPEEDS)


def _apparent_stribeck(group: CoastDownFit) -> float:
    """Return w_s of the Stribeck part that fits best before any cogging torque, 0 if none helps.

    It may not be real; without it, a real one would be taken for cogging torque.
    """
    speeds = group.speeds_rad_s()
    low, high = min(float(s.min()) for s in speeds), max(float(s.max()) for s in speeds)
    tried = stribeck_speeds(max(low, LEAST_STRIBECK * high), high)
    best = group.best_stribeck(speeds, tried)
    return best if group.gain_with(group.stribeck(speeds, best)) > 0 else 0.0
