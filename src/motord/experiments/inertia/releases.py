"""Releases of the bar: found in a recording, and each read."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import ndimage

from motord.experiments.inertia.springs import SpringSetup
from motord.identification.rotor.free_decay import Decay, fit_decay
from motord.identification.rotor.log_decrement import (
    FivePeriods,
    FreeOscillation,
    find_free_oscillation,
    five_periods,
)
from motord.identification.turning import unwrap_counts

STILL_S = 0.1
"""How long a bar is still before it is let go."""

STILL_COUNTS = 2
"""Counts that a bar may move by and be still."""


@dataclass(frozen=True)
class Release:
    """One release: its oscillation, five periods of that, and the fit of its whole decay.

    label: its recording, and its number there.
    """

    JSON: ClassVar = (
        "index", "period_s=five.period_s", "decrement=five.decrement",
        "damping_ratio=five.damping_ratio", "frequency_rad_s=decay.frequency_rad_s",
        "frequency_stderr_rad_s=decay.frequency_stderr_rad_s",
        "cubic_per_rad2=decay.cubic_per_rad2", "viscous_per_s=decay.viscous_per_s",
        "coulomb_rad_s2=decay.coulomb_rad_s2",
    )  # fmt: skip

    index: int
    oscillation: FreeOscillation
    five: FivePeriods
    decay: Decay
    label: str = ""


def find_releases(t_ns: np.ndarray, count: np.ndarray, counts: int) -> list[slice]:
    """Return the samples of each segment that begins with a still bar and goes on until the next.

    t_ns, count (n,); counts: of the encoder's turn. A segment need not be an oscillation: the bar
    may have been pulled. Without any standstill, all samples are one segment.
    """
    if not len(t_ns):
        return []
    t_s = (np.asarray(t_ns, np.int64) - int(t_ns[0])) * 1e-9
    stretches, _ = ndimage.label(_still(t_s, unwrap_counts(count, counts)))
    still = [part for (part,) in ndimage.find_objects(stretches)]
    if not still:
        return [slice(0, t_s.size)]
    begins = [
        max(part.start, int(np.searchsorted(t_s, t_s[part.stop - 1] - STILL_S))) for part in still
    ]
    stops = [*begins[1:], t_s.size]
    return [
        slice(begin, stop)
        for begin, part, stop in zip(begins, still, stops, strict=True)
        if stop > part.stop
    ]


def _still(t_s: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return (n,) whether a sample belongs to STILL_S during which the position hardly changes."""
    size = max(int(np.searchsorted(t_s, STILL_S)), 2)
    if position.size < size:
        return np.zeros(position.size, bool)
    windows = np.lib.stride_tricks.sliding_window_view(position, size)
    calm = np.ptp(windows, axis=1) <= STILL_COUNTS
    return np.asarray(np.convolve(calm, np.ones(size)) > 0.5)


def read_release(
    index: int,
    t_ns: np.ndarray,
    count: np.ndarray,
    counts: int,
    setup: SpringSetup,
    cogging_Nm: np.ndarray | None = None,
) -> Release:
    """Return a release from its samples (n,). Raises IdentifyError.

    counts: of the encoder's turn; cogging_Nm (3, n): as `waves_of` gives it.
    """
    oscillation = find_free_oscillation(t_ns, count, counts)
    decay = fit_decay(oscillation, setup.stiffness_Nm, cogging_Nm)
    return Release(index, oscillation, five_periods(oscillation), decay)


def waves_of(table_Nm: np.ndarray) -> np.ndarray:
    """Return order, cosine and sine (3, n) of the cogging torque table_Nm (counts,)."""
    lines = np.fft.rfft(table_Nm) * (2 / table_Nm.size)
    order = np.arange(lines.size)
    there = (np.abs(lines) > 1e-3 * np.abs(lines).max()) & (order > 0)
    return np.array([order[there], lines[there].real, -lines[there].imag], float)
