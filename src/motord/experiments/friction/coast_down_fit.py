"""The linear fit of coast-downs of one direction, and which orders of cogging torque it has."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from motord.config import MotorConfig
from motord.experiments.friction.coast_down_rows import CoastDown, CoastDownRows
from motord.experiments.friction.linearisation import Linearisation
from motord.experiments.friction.two_step_fit import (
    OWN,
    TwoStepFit,
    orthonormal,
)
from motord.identification import IdentifyError
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

    q_rad, values (n,), columns (n, p): rows of all coast-downs; q_rad: angles by the fit. around:
    what they are linearised around; None while the angles of the fit have not settled.
    """

    rows: CoastDownRows
    orders: np.ndarray
    q_rad: np.ndarray
    values: np.ndarray
    columns: np.ndarray
    fit: TwoStepFit
    around: Linearisation | None = None

    @classmethod
    def of(
        cls, rows: CoastDownRows, orders: Sequence[int], q_rad: np.ndarray, at_rad_s: float = 0.0
    ) -> "CoastDownFit":
        """Fit Coulomb and viscous friction and the torque at `orders`; q_rad: within integrals.

        at_rad_s: w_s of a Stribeck part that is fitted, too.
        """
        parts = [rows.friction(q_rad), rows.cogging(orders, q_rad)]
        if at_rad_s:
            parts.append(rows.stribeck(rows.speed_rad_s(q_rad), at_rad_s))
        columns, values = rows.projected(np.hstack(parts)), rows.projected(rows.q_rad)
        fit = TwoStepFit.of(columns, rows.first, values)
        fitted_rad = rows.q_rad - fit.common.residual
        relaxed_rad = (1 - RELAXATION) * q_rad + RELAXATION * fitted_rad
        return cls(rows, np.array(orders, int), relaxed_rad, values, columns, fit)

    def settled(self, at_rad_s: float) -> "CoastDownFit":
        """Return the fit with its own angle within the integrals."""
        group = self
        for _ in range(ROUNDS_MAX):
            new = CoastDownFit.of(group.rows, group.orders.tolist(), group.q_rad, at_rad_s)
            if float(np.abs(new.q_rad - group.q_rad).max()) < SETTLED_RAD:
                return new
            group = new
        raise IdentifyError(
            "the fit does not settle: near the stop speed the cogging torque nearly holds the "
            "rotor; raise stop_speed_Hz"
        )

    def linearised(self, at_rad_s: float) -> "CoastDownFit":
        """Return the fit without a Stribeck part of w_s `at_rad_s`, to first order around this."""
        rows, orders, residual_rad = self.rows, self.orders.tolist(), self.fit.common.residual
        q_rad = rows.q_rad - residual_rad
        around = Linearisation.around(rows, orders, q_rad, self.fit.solution, at_rad_s)
        parts = [rows.friction(q_rad), rows.cogging(orders, q_rad), q_rad[:, None]]
        changes = around.changes(np.hstack(parts))
        columns = around.projected(changes[:, :-1])
        values = around.projected(changes[:, -1] + residual_rad)
        fit = TwoStepFit.of(columns, rows.first, values)
        return CoastDownFit(rows, self.orders, q_rad, values, columns, fit, around)

    @property
    def common(self) -> np.ndarray:
        """Columns (n, p - 2) that the coast-downs have in common."""
        return self.columns[:, OWN:]

    def explained_by(self, columns: np.ndarray) -> np.ndarray:
        """Return what columns (n, m) of the model explain of the values (n, m)."""
        if self.around is None:
            return self.rows.projected(columns)
        return self.around.projected(self.around.changes(columns))

    def speed_rad_s(self) -> np.ndarray:
        """Return the speed (n,) by the fit."""
        return self.rows.speed_rad_s(self.q_rad)

    def gain(self, order: int) -> float:
        """Return by how much the Bayesian information criterion falls with one more order."""
        return self.gain_with(self.explained_by(self.rows.cogging([order], self.q_rad)))

    def gain_with(self, more: np.ndarray) -> float:
        """Return by how much the Bayesian information criterion falls with two more parameters.

        more (n, 1) or (n, 2): their columns; a Stribeck part has one, and its speed is searched.
        Each coast-down has Coulomb and viscous friction of its own here: what friction differs by
        from one to the next is no white noise, and other columns would seem to explain it.
        """
        n = self.values.size
        residual = self._with_own_friction[1]
        ratio = float(residual @ residual) / self.residual_squares(more)
        return float(n * np.log(ratio) - 2 * np.log(n))

    def residual_squares(self, more: np.ndarray) -> float:
        """Return the residual sum of squares with own friction and with more columns (n, m).

        What own friction and the common columns explain of these is left out (Frisch, Waugh and
        Lovell): of many columns that are tried, each costs no fit of the others.
        """
        common, residual = self._with_own_friction
        free = self.fit.own.partialled_out(more)
        q = orthonormal(free - common @ (common.T @ free), more)
        left = residual - q @ (q.T @ residual)
        return float(left @ left)

    @cached_property
    def _with_own_friction(self) -> tuple[np.ndarray, np.ndarray]:
        """Return orthonormal columns of what is common less own friction, and the residual."""
        common, values = (self.fit.own.partialled_out(x) for x in (self.common, self.values))
        q = orthonormal(common, self.common)
        return q, values - q @ (q.T @ values)

    def with_stribeck(
        self, speed_rad_s: np.ndarray, at_rad_s: float, scale: float = 0.0
    ) -> TwoStepFit:
        """Fit a Stribeck part of w_s `at_rad_s`, too; with `scale` (S/J) w_s is free around it."""
        columns = np.hstack([self.columns, self.stribeck(speed_rad_s, at_rad_s, scale)])
        return TwoStepFit.with_common(self.fit.own, columns[:, OWN:], self.values)

    def stribeck(self, speed_rad_s: np.ndarray, at_rad_s: float, scale: float = 0.0) -> np.ndarray:
        """Return the columns of a Stribeck part (n, 1), with `scale` (n, 2)."""
        return self.explained_by(self.rows.stribeck(speed_rad_s, at_rad_s, scale))

    def windage(self, speed_rad_s: np.ndarray) -> np.ndarray:
        """Return the column of a torque with the square of the speed (n, 1)."""
        return self.explained_by(self.rows.windage(speed_rad_s)[:, None])

    def best_stribeck(self, speed_rad_s: np.ndarray, tried: np.ndarray) -> float:
        """Return the w_s that fits best, near the best of those `tried` (n,), rising."""

        def misfit(at_rad_s: float) -> float:
            return self.residual_squares(self.stribeck(speed_rad_s, at_rad_s))

        best = int(np.argmin([misfit(float(at)) for at in tried]))
        bounds = tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)]
        return float(minimize_scalar(misfit, bounds=bounds, method="bounded").x)


def fitted(coasts: tuple[CoastDown, ...], motor: MotorConfig) -> tuple[CoastDownFit, np.ndarray]:
    """Return the fit with as many of the orders that there may be as the data need, and the speed.

    The orders are taken best first; the fit is without a Stribeck part, the speed (n,) with it.
    """
    fastest = max(float((np.diff(one.q_rad[::10])).max()) / 10 for one in coasts)
    highest = int(2 * np.pi / (SAMPLES_PER_PERIOD * fastest))
    left = {
        *SHAFT_ORDERS,
        *(motor.pole_pairs * order for order in BACK_EMF_ORDERS),
        *allowed_orders(motor.slots, 2 * motor.pole_pairs, highest),
    }
    left = {order for order in left if order <= highest}
    rows, taken = CoastDownRows(coasts), list[int]()
    group = CoastDownFit.of(rows, taken, rows.smooth_rad())
    for _ in range(STRIBECK_ROUNDS):
        at_rad_s = _apparent_stribeck(CoastDownFit.of(rows, taken, group.q_rad))
        group = CoastDownFit.of(rows, taken, group.q_rad, at_rad_s)
    while left:
        gains = {order: group.gain(order) for order in sorted(left)}
        best = max(gains, key=gains.__getitem__)
        if gains[best] <= 0:
            break
        left.remove(best)
        taken = sorted([*taken, best])
        for _ in range(ROUNDS_PER_ORDER):
            group = CoastDownFit.of(rows, taken, group.q_rad, at_rad_s)
    group = group.settled(at_rad_s)
    return group.linearised(at_rad_s), group.speed_rad_s()


def stribeck_speeds(low_rad_s: float, high_rad_s: float) -> np.ndarray:
    """Return the w_s that are tried (n,), rising: from the least speed to half of the highest.

    Speeds may be so near each other that half of the highest is below the least.
    """
    return np.geomspace(low_rad_s, max(high_rad_s / 2, 1.2 * low_rad_s), STRIBECK_SPEEDS)


def _apparent_stribeck(group: CoastDownFit) -> float:
    """Return w_s of the Stribeck part that fits best before any cogging torque, 0 if none helps.

    It may not be real; without it, a real one would be taken for cogging torque.
    """
    speed = group.speed_rad_s()
    low, high = float(speed.min()), float(speed.max())
    tried = stribeck_speeds(max(low, LEAST_STRIBECK * high), high)
    best = group.best_stribeck(speed, tried)
    return best if group.gain_with(group.stribeck(speed, best)) > 0 else 0.0
