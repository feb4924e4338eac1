"""What a drive keeps of a wave over a turn: a table that it interpolates, or some harmonics.

A layout has `fit`, which gives what comes nearest to a wave in the mean square over a turn of the
drive's angle, `keeps`, which of the orders 0 to n // 2 of a wave (n,) are stored, and `resolution`,
the number of angles in a turn between which what is read has no steps or corners. What it gives has
`read`, which is the drive's own arithmetic.
"""

from dataclasses import dataclass
from math import radians, tau
from typing import Literal

import numpy as np

Interpolation = Literal["linear", "hold"]
"""Between two entries; or an entry until the next one begins."""


@dataclass(frozen=True)
class StoredTable:
    """Entries (length,), integers or floats of 32 bits, in units of `scale`."""

    entries: np.ndarray
    scale: float
    interpolation: Interpolation

    @property
    def values(self) -> np.ndarray:
        """The entries (length,) in the unit of the wave."""
        return np.asarray(self.entries * self.scale, dtype=float)

    def read(self, turns: np.ndarray) -> np.ndarray:
        """Return what the drive reads at its own angles (n,), turns from 0 to 1."""
        values, length = self.values, self.entries.size
        left = np.minimum((turns * length).astype(int), length - 1)
        if self.interpolation == "hold":
            return np.asarray(values[left])
        right = values[(left + 1) % length]
        return np.asarray(values[left] + (turns * length - left) * (right - values[left]))


@dataclass(frozen=True)
class TableLayout:
    """A table of `length` entries of `bits` with a common scale; None: floats of 32 bits."""

    length: int
    interpolation: Interpolation
    bits: int | None = None

    @property
    def resolution(self) -> int:
        """Number of entries."""
        return self.length

    @property
    def to_text(self) -> str:
        """What it is, as text."""
        kind = f"integers of {self.bits} bits" if self.bits else "floats of 32 bits"
        between = "linear between them" if self.interpolation == "linear" else "held to the next"
        return f"{self.length} {kind} over a turn, {between}"

    def keeps(self, wave: np.ndarray) -> np.ndarray:
        """Return which orders are stored: those below half the number of entries (Nyquist)."""
        return 2 * np.arange(wave.size // 2 + 1) < self.length

    def fit(self, wave: np.ndarray) -> StoredTable:
        """Return the least-squares fit of a wave (n,), rounded; orders above Nyquist left out.

        c_k = t_k conj(H_k) / sum_m |H_(k + m length)|^2 with H the interpolation's spectrum:
        sinc^2(k / length) between two entries, sinc(k / length) exp(-j pi k / length) for a hold.
        """
        spectrum = np.fft.rfft(wave) / wave.size
        spectrum = spectrum[self.keeps(wave)]
        x = np.arange(spectrum.size) / self.length
        if self.interpolation == "linear":
            spectrum *= 3 * np.sinc(x) ** 2 / (2 + np.cos(tau * x))
        else:
            spectrum *= np.sinc(x) * np.exp(0.5j * tau * x)
        return self._stored(np.fft.irfft(spectrum * self.length, self.length))

    def _stored(self, values: np.ndarray) -> StoredTable:
        """Return values (length,) with the rounding of the drive."""
        if self.bits is None:
            return StoredTable(values.astype(np.float32), 1.0, self.interpolation)
        peak = float(np.abs(values).max())
        scale = float(np.float32(peak / (2 ** (self.bits - 1) - 1))) or 1.0
        kind = np.int8 if self.bits <= 8 else np.int16
        return StoredTable(np.rint(values / scale).astype(kind), scale, self.interpolation)


@dataclass(frozen=True)
class Term:
    """amplitude sin(2 pi order turns + phase), floats of 32 bits; an order of 0 is none."""

    order: int = 0
    amplitude: float = 0.0
    phase_deg: float = 0.0


@dataclass(frozen=True)
class StoredTerms:
    """Harmonics, largest first."""

    terms: tuple[Term, ...]

    def read(self, turns: np.ndarray) -> np.ndarray:
        """Return the sum of the harmonics at the drive's angles (n,), turns."""
        total = np.zeros(turns.size)
        for one in self.terms:
            total += one.amplitude * np.sin(tau * one.order * turns + radians(one.phase_deg))
        return total


@dataclass(frozen=True)
class HarmonicLayout:
    """The `count` largest harmonics of at most the order `highest`."""

    count: int
    highest: int

    @property
    def resolution(self) -> int:
        """Twice the highest order."""
        return 2 * self.highest

    @property
    def to_text(self) -> str:
        """What it is, as text."""
        return f"the {self.count} largest harmonics up to order {self.highest}"

    def keeps(self, wave: np.ndarray) -> np.ndarray:
        """Return which orders are stored."""
        orders = np.arange(wave.size // 2 + 1)
        sizes = np.abs(np.fft.rfft(wave)) * ((orders > 0) & (orders <= self.highest))
        largest = np.argsort(sizes)[-self.count :]
        return np.isin(orders, largest[sizes[largest] > 1e-9 * sizes.max()])

    def fit(self, wave: np.ndarray) -> StoredTerms:
        """Return the largest harmonics of a wave (n,), which are its least-squares fit."""
        spectrum = 2 * np.fft.rfft(wave) / wave.size
        orders = np.flatnonzero(self.keeps(wave))
        orders = orders[np.argsort(-np.abs(spectrum[orders]))]
        phases_deg = np.rad2deg(np.angle(1j * spectrum[orders]) % tau).astype(np.float32)
        found = zip(orders, np.abs(spectrum[orders]).astype(np.float32), phases_deg, strict=True)
        return StoredTerms(tuple(Term(int(n), float(r), float(phi)) for n, r, phi in found))


Stored = StoredTable | StoredTerms
DriveLayout = TableLayout | HarmonicLayout
