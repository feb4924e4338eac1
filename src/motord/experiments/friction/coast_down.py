"""A coast-down as columns of a linear model: what friction and cogging torque do to the angle.

    J q'' = -F - b q' - S exp(-(q'/w_s)^2) + s sum_h (C_h cos h theta + D_h sin h theta)

with q the angle in the direction s of turning. Integrated twice it is linear in what is asked for,

    q = a + v t - (F/J) t^2/2 - (b/J) int q - (S/J) int int exp(-(q'/w_s)^2)
        + s sum_h ((C_h/J) int int cos h theta + (D_h/J) int int sin h theta)

and nothing is differentiated. a and v are of each coast-down, and projected out. The angle within
the integrals is that of the fit itself, in a few rounds that begin with a polynomial: the encoder's
rounding, integrated twice, would hide the cogging torque at high orders.
"""

from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np
from numpy.polynomial import Polynomial

from motord.identification import IdentifyError

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

    @cached_property
    def _nuisance(self) -> np.ndarray:
        """Orthonormal columns that span a + v t."""
        columns = np.column_stack([np.ones_like(self.t_s), self.t_s])
        return np.asarray(np.linalg.qr(columns)[0])

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (n,) or (n, p) less what a + v t explains of them."""
        return np.asarray(columns - self._nuisance @ (self._nuisance.T @ columns))

    def smooth_rad(self) -> np.ndarray:
        """Return a polynomial through q (n,), which the first round begins with."""
        return np.asarray(Polynomial.fit(self.t_s, self.q_rad, POLYNOMIAL_DEGREE)(self.t_s))

    def twice(self, orders: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
        """Return the columns (n, 2 + 2 m) of F/J, b/J and C/J, D/J of each order.

        q_rad (n,): the angle within the integrals, taken to be straight between samples, of which
        there may be few in a wave.
        """
        angle_rad = self.angle_rad[0] + self.direction * q_rad
        middle_rad = (angle_rad[1:] + angle_rad[:-1]) / 2
        columns = [-(self.t_s**2) / 2, -integral(self.t_s, q_rad - q_rad[0])]
        for order in orders:
            scale = self.direction * np.sinc(order * np.diff(angle_rad) / (2 * pi))
            for wave in (np.cos, np.sin):
                means = once(self.t_s, scale * wave(order * middle_rad))
                columns.append(integral(self.t_s, means, self.direction * wave(order * angle_rad)))
        return np.column_stack(columns)

    def stribeck(self, speed_rad_s: np.ndarray, at_rad_s: float, scale: float = 0.0) -> np.ndarray:
        """Return the column (n, 1) of S/J; speed (n,) of the rotor.

        With `scale` (S/J) the columns (n, 2): that of w_s, too.
        """
        ratio = (speed_rad_s / at_rad_s) ** 2
        shapes = [np.exp(-ratio)]
        if scale:
            shapes.append(scale * shapes[0] * 2 * ratio / at_rad_s)
        twice = [-integral(self.t_s, integral(self.t_s, shape)) for shape in shapes]
        return np.column_stack(twice)

    def windage(self, speed_rad_s: np.ndarray) -> np.ndarray:
        """Return the column (n,) of a torque with the square of the speed (n,), over J."""
        return -integral(self.t_s, integral(self.t_s, speed_rad_s**2))


def once(t_s: np.ndarray, means: np.ndarray) -> np.ndarray:
    """Return the integral (n,) from the first sample on of means (n - 1,) between samples."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t_s) * means)])


def integral(
    t_s: np.ndarray, values: np.ndarray, derivative: np.ndarray | None = None
) -> np.ndarray:
    """Return the integral (n,) of values (n,) from the first sample on.

    Trapezia, or cubics where the derivative (n,) is known.
    """
    means = (values[1:] + values[:-1]) / 2
    if derivative is not None:
        means = means - np.diff(t_s) * np.diff(derivative) / 12
    return once(t_s, means)
