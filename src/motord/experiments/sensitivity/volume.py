"""The volume of errors: RMS error over gain, offset and cogging factor, and where it is too much.

Poels 2008, Table 4.1, Figures 4.3 and 4.4.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.sensitivity.curves import RippleModel, gains_of, offsets_of


@dataclass(frozen=True)
class Intervals:
    """The intervals of Table 4.1, and the steps in them.

    alpha_a: gain of phase a; beta_a_A: offset of phase a; cogging: factor of the cogging torque.
    """

    alpha_a: tuple[float, float] = (0.8, 1.2)
    beta_a_A: tuple[float, float] = (-1.0, 1.0)
    cogging: tuple[float, float] = (0.65, 1.35)
    steps: int = 41

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the values of each of the three."""
        a, b, f = (
            np.linspace(*ends, self.steps) for ends in (self.alpha_a, self.beta_a_A, self.cogging)
        )
        return a, b, f


@dataclass(frozen=True)
class Volume:
    """RMS error in percent over alpha_a (na,), beta_a_A (nb,) and cogging (nf,): (na, nb, nf)."""

    alpha_a: np.ndarray
    beta_a_A: np.ndarray
    cogging: np.ndarray
    rms_percent: np.ndarray


def volume(model: RippleModel, torque_Nm: float, intervals: Intervals = Intervals()) -> Volume:
    """Return the RMS error over the intervals (Poels 2008, Figure 4.3)."""
    alpha_a, beta_a_A, cogging = intervals.axes
    a, b, f = np.meshgrid(alpha_a, beta_a_A, cogging, indexing="ij")
    rms = model.rms_percent(torque_Nm, gains_of(a), offsets_of(b), f)
    return Volume(alpha_a, beta_a_A, cogging, rms)


@dataclass(frozen=True)
class Surface:
    """Where the RMS error reaches a limit, seen from the ideal: (n, m) points of a closed surface.

    Cut off at the edges of the intervals, where `inside` (n, m) is True.
    """

    alpha_a: np.ndarray
    beta_a_A: np.ndarray
    cogging: np.ndarray
    inside: np.ndarray


def limit_surface(
    model: RippleModel,
    torque_Nm: float,
    limit_percent: float = 1.0,
    intervals: Intervals = Intervals(),
    rows: int = 25,
    columns: int = 48,
) -> Surface:
    """Return the surface of RMS error `limit_percent` (Poels 2008, Figure 4.4).

    Along each direction from the ideal, in parts of the half-intervals, the error rises steadily:
    halving finds where it reaches the limit.
    """
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij"
    )
    way = (
        np.cos(azimuth) * np.sin(polar) * (intervals.alpha_a[1] - intervals.alpha_a[0]) / 2,
        np.sin(azimuth) * np.sin(polar) * (intervals.beta_a_A[1] - intervals.beta_a_A[0]) / 2,
        np.cos(polar) * (intervals.cogging[1] - intervals.cogging[0]) / 2,
    )
    low, high = np.zeros_like(polar), _to_the_edges(way, intervals)
    inside = _along(model, torque_Nm, way, high) < limit_percent
    edge = high.copy()
    for _ in range(24):
        middle = (low + high) / 2
        below = _along(model, torque_Nm, way, middle) < limit_percent
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    far = np.where(inside, edge, low)
    return Surface(1 + far * way[0], far * way[1], 1 + far * way[2], inside)


def _to_the_edges(way: tuple[np.ndarray, ...], intervals: Intervals) -> np.ndarray:
    """Return how far the edges of the intervals are along each direction."""
    ideal = (1.0, 0.0, 1.0)
    ends = (intervals.alpha_a, intervals.beta_a_A, intervals.cogging)
    far = np.full(way[0].shape, np.inf)
    for w, centre, (low, high) in zip(way, ideal, ends, strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            edge = np.where(w > 0, (high - centre) / w, (low - centre) / w)
        far = np.minimum(far, np.where(np.abs(w) > 1e-12, edge, np.inf))
    return far


def _along(
    model: RippleModel, torque_Nm: float, way: tuple[np.ndarray, ...], far: np.ndarray
) -> np.ndarray:
    """Return the RMS error at `far` along each direction."""
    alpha_a, beta_a_A, cogging = 1 + far * way[0], far * way[1], 1 + far * way[2]
    return model.rms_percent(torque_Nm, gains_of(alpha_a), offsets_of(beta_a_A), cogging)
