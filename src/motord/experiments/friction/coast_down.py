"""A coast-down of a recording: its samples until the rotor turns back."""

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

    def smooth_rad(self) -> np.ndarray:
        """Return a polynomial through q (n,), which the first round begins with."""
        return np.asarray(Polynomial.fit(self.t_s, self.q_rad, POLYNOMIAL_DEGREE)(self.t_s))
