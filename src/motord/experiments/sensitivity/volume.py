"""The volume of errors: RMS error over gain, offset and cogging factor, and where it is too much.

Poels 2008, Table 4.1, Figures 4.3 and 4.4.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.sensitivity.curves import RippleModel, gains_of, offsets_of

INTERVALS = {"alpha_a": (0.8, 1.2), "beta_a_A": (-1.0, 1.0), "cogging": (0.65, 1.35)}
"""The intervals of Table 4.1: gain and offset of phase a, factor of the cogging torque."""


@dataclass(frozen=True)
class Volume:
    """RMS error in percent over alpha_a (na,), beta_a_A (nb,) and cogging (nf,): (na, nb, nf)."""

    alpha_a: np.ndarray
    beta_a_A: np.ndarray
    cogging: np.ndarray
    rms_percent: np.ndarray


def volume(model: RippleModel, torque_Nm: float, steps: int = 41) -> Volume:
    """Return the RMS error over the intervals (Poels 2008, Figure 4.3)."""
    alpha_a, beta_a_A, cogging = (np.linspace(*ends, steps) for ends in INTERVALS.values())
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
    a, b, f = (high - low for low, high in INTERVALS.values())
    way = (
        np.cos(azimuth) * np.sin(polar) * a / 2,
        np.sin(azimuth) * np.sin(polar) * b / 2,
        np.cos(polar) * f / 2,
    )
    low, high = np.zeros_like(polar), _to_the_edges(way)
    inside = _along(model, torque_Nm, way, high) < limit_percent
    edge = high.copy()
    for _ in range(24):
        middle = (low + high) / 2
        below = _along(model, torque_Nm, way, middle) < limit_percent
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    far = np.where(inside, edge, low)
    return Surface(1 + far * way[0], far * way[1], 1 + far * way[2], inside)


def _to_the_edges(way: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return how far the edges of the intervals are along each direction."""
    far = np.full(way[0].shape, np.inf)
    for w, centre, (low, high) in zip(way, (1.0, 0.0, 1.0), INTERVALS.values(), strict=True):
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
