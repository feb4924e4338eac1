"""Coast-downs, until the rotor turns back, as columns of a linear model of friction and cogging.

    J q'' = -F - b q' - S exp(-(q'/w_s)^2) + s sum_h (C_h cos h theta + D_h sin h theta)

with q the angle in the direction s of turning. Integrated twice it is linear in what is asked for,

    q = a + v t - (F/J) t^2/2 - (b/J) int q - (S/J) int int exp(-(q'/w_s)^2)
        + s sum_h ((C_h/J) int int cos h theta + (D_h/J) int int sin h theta)

and nothing is differentiated. a and v are of each coast-down, and projected out. The angle within
the integrals is that of the fit itself, in a few rounds that begin with a polynomial: the encoder's
rounding, integrated twice, would hide the cogging torque at high orders.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np
from numpy.polynomial import Polynomial

from motord.experiments.friction.two_step_fit import bases, partialled_out
from motord.identification import IdentifyError
from motord.identification.cluster_robust_ls import split

LEAST_SAMPLES = 50

LEAST_TURNS = 0.5
"""Shortest coast-down that is fitted."""

POLYNOMIAL_DEGREE = 5

BACK_COUNTS = 2
"""Counts by which the encoder may go back between samples before that is a turning back."""


@dataclass(frozen=True)
class CoastDown:
    """A coast-down: samples (n,); direction: 1 forwards, -1 backwards.

    angle_rad is that of the encoder, rounded to its counts, without jumps, positive forwards.
    """

    direction: int
    t_s: np.ndarray
    angle_rad: np.ndarray

    @classmethod
    def of(
        cls, run: str, index: int, t_ns: np.ndarray, angle_rad: np.ndarray, counts: int
    ) -> "CoastDown":
        """Return the part until the rotor turns back. Raises IdentifyError if it is too short."""
        name = f"{run}: coast-down {index + 1}"
        if t_ns.size < LEAST_SAMPLES:
            raise IdentifyError(f"{name}: {t_ns.size} samples only")
        t_s = (t_ns.astype(np.int64) - int(t_ns[0])) * 1e-9
        unwrapped_rad = np.unwrap(angle_rad.astype(float))
        direction = 1 if unwrapped_rad[-1] >= unwrapped_rad[0] else -1
        q_rad = direction * (unwrapped_rad - unwrapped_rad[0])
        behind = np.maximum.accumulate(q_rad) - q_rad > BACK_COUNTS * 2 * pi / counts
        end = int(np.argmax(behind)) if behind.any() else q_rad.size
        if end < LEAST_SAMPLES or q_rad[end - 1] < 2 * pi * LEAST_TURNS:
            turns = q_rad[max(end - 1, 0)] / (2 * pi)
            raise IdentifyError(f"{name}: the rotor coasted for {turns:.2g} turns only")
        return cls(direction, t_s[:end], unwrapped_rad[:end])

    @cached_property
    def q_rad(self) -> np.ndarray:
        """Return the angle in the direction of turning, from the first sample on."""
        return np.asarray(self.direction * (self.angle_rad - self.angle_rad[0]))

    def smooth_rad(self) -> np.ndarray:
        """Return a polynomial through q (n,), which the first round begins with."""
        return np.asarray(Polynomial.fit(self.t_s, self.q_rad, POLYNOMIAL_DEGREE)(self.t_s))


@dataclass(frozen=True)
class CoastDownRows:
    """Coast-downs of one direction; arrays (n, ...) have the rows of all, one after the other."""

    coasts: tuple[CoastDown, ...]

    @cached_property
    def first(self) -> np.ndarray:
        """Return the first row of each coast-down (g,)."""
        return np.cumsum([0, *self._sizes[:-1]])

    @cached_property
    def t_s(self) -> np.ndarray:
        """Return the time since the first sample of each (n,)."""
        return np.concatenate([one.t_s for one in self.coasts])

    @cached_property
    def q_rad(self) -> np.ndarray:
        """Return the angles in the direction of turning (n,), by the encoder."""
        return np.concatenate([one.q_rad for one in self.coasts])

    def smooth_rad(self) -> np.ndarray:
        """Return a polynomial through q of each (n,), which the first round begins with."""
        return np.concatenate([one.smooth_rad() for one in self.coasts])

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Return rows (n, ...) of each coast-down."""
        return split(values, self.first)

    def speed_rad_s(self, q_rad: np.ndarray) -> np.ndarray:
        """Return the speed (n,) of angles (n,)."""
        pairs = zip(self.split(q_rad), self.coasts, strict=True)
        return np.concatenate([np.gradient(q, one.t_s) for q, one in pairs])

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (n,) or (n, p) less what a + v t of each coast-down explains of them."""
        return partialled_out(self._nuisance, columns, self.first)

    def friction(self, q_rad: np.ndarray) -> np.ndarray:
        """Return the columns (n, 2) of F/J and b/J; q_rad (n,): the angle within the integrals."""
        return np.column_stack([-(self.t_s**2) / 2, -self.integral(q_rad - self._of_first(q_rad))])

    def cogging(self, orders: Sequence[int], q_rad: np.ndarray) -> np.ndarray:
        """Return the columns (n, 2 m) of C/J and D/J of each order.

        q_rad (n,): the angle within the integrals, taken to be straight between samples, of which
        there may be few in a wave.
        """
        direction = self.coasts[0].direction
        angle_rad = self._start_rad + direction * q_rad
        middle_rad = (angle_rad[1:] + angle_rad[:-1]) / 2
        way_rad = np.diff(angle_rad)
        columns = np.empty((2 * len(orders), angle_rad.size))
        for number, order in enumerate(orders):
            scale = direction * np.sinc(order * way_rad / (2 * pi))
            for wave, column in zip((np.cos, np.sin), columns[2 * number :], strict=False):
                means = self._once(scale * wave(order * middle_rad))
                column[:] = self.integral(means, direction * wave(order * angle_rad))
        return columns.T

    def stiffness(
        self, orders: Sequence[int], lines: np.ndarray, q_rad: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the slope of the cogging torque over q: its mean between rows (n - 1,), at rows.

        lines (2 m,): C/J and D/J of each order.
        """
        angle_rad = self._start_rad + self.coasts[0].direction * q_rad
        number, (c, d) = np.array(orders, int)[:, None], lines.reshape(-1, 2, 1).swapaxes(0, 1)

        def slope(at_rad: np.ndarray, way_rad: np.ndarray | float) -> np.ndarray:
            wave = d * np.cos(number * at_rad) - c * np.sin(number * at_rad)
            return np.asarray((number * np.sinc(number * way_rad / (2 * pi)) * wave).sum(axis=0))

        middle_rad = (angle_rad[1:] + angle_rad[:-1]) / 2
        return slope(middle_rad, np.diff(angle_rad)), slope(angle_rad, 0.0)

    def stribeck(self, speed_rad_s: np.ndarray, at_rad_s: float, scale: float = 0.0) -> np.ndarray:
        """Return the column (n, 1) of S/J; speed (n,) of the rotor.

        With `scale` (S/J) the columns (n, 2): that of w_s, too.
        """
        ratio = (speed_rad_s / at_rad_s) ** 2
        shapes = [np.exp(-ratio)]
        if scale:
            shapes.append(scale * shapes[0] * 2 * ratio / at_rad_s)
        return np.column_stack([-self.integral(self.integral(shape)) for shape in shapes])

    def windage(self, speed_rad_s: np.ndarray) -> np.ndarray:
        """Return the column (n,) of a torque with the square of the speed (n,), over J."""
        return -self.integral(self.integral(speed_rad_s**2))

    def integral(self, values: np.ndarray, derivative: np.ndarray | None = None) -> np.ndarray:
        """Return the integral (n,) of values (n,) from the first sample of each on.

        Trapezia, or cubics where the derivative (n,) is known.
        """
        means = (values[1:] + values[:-1]) / 2
        if derivative is not None:
            means -= self.steps_s * np.diff(derivative) / 12
        return self._once(means)

    def _once(self, means: np.ndarray) -> np.ndarray:
        """Return the integral (n,) of means (n - 1,) between rows, from each's first row on."""
        whole = np.empty(means.size + 1)
        whole[0] = 0.0
        np.cumsum(self.steps_s * means, out=whole[1:])
        return np.asarray(whole - self._of_first(whole))

    @cached_property
    def steps_s(self) -> np.ndarray:
        """Return the time between rows (n - 1,)."""
        return np.diff(self.t_s)

    @cached_property
    def _start_rad(self) -> np.ndarray:
        return np.repeat([one.angle_rad[0] for one in self.coasts], self._sizes)

    @cached_property
    def _sizes(self) -> list[int]:
        return [one.t_s.size for one in self.coasts]

    @cached_property
    def _nuisance(self) -> list[np.ndarray]:
        """Orthonormal columns that span a + v t, of each."""
        return bases(np.column_stack([np.ones_like(self.t_s), self.t_s]), self.first)

    def _of_first(self, values: np.ndarray) -> np.ndarray:
        """Return the value of each row's coast-down's first row (n,)."""
        return np.repeat(values[self.first], self._sizes)
