"""Releases together: the inertia by several readings of the same swings, and its budget."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from motord.experiments.inertia.error_budget import Budget, Curves, budget, curves
from motord.experiments.inertia.free_decay import Decay, fit_decay, mean_frequency
from motord.experiments.inertia.results import Improvement, improvements
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.swings import FivePeriods, Swing, find_swing, five_periods
from motord.identification import IdentifyError

WORDS = {"wave": "waves in the springs", "heavy": "m/3", "unloaded": "4m/\u03c0\u00b2"}
"""Models of the effective mass in words."""

REPORTS_WAY = "five periods, damped, m/3"
"""How Poels 2008 reads the swings."""


DISTURBED = 1.25
"""How much worse than those that fit best (a quarter of them) a release may fit and be used."""

COGGING_UNCERTAINTY = 0.01
"""Standard uncertainty of a known cogging torque, in parts of it."""


@dataclass(frozen=True)
class Release:
    """One release as it was read: swing, five periods of it, and the fit of its whole decay."""

    index: int
    swing: Swing
    five: FivePeriods
    decay: Decay


@dataclass(frozen=True)
class InertiaReading:
    """The inertia by one way of reading the swings; std: of one release."""

    label: str
    inertia_kg_m2: float
    std_kg_m2: float


@dataclass(frozen=True)
class Oscillation:
    """The motor's inertia by oscillation.

    stator: it was in place, and its cogging torque known. budget: of the fitted decays with the
    chosen effective mass; readings: other ways of reading the swings; improvements: what changes
    of the set-up would bring. disturbed: releases that were left out, as they fit worse.
    """

    setup: SpringSetup
    stator: bool
    releases: tuple[Release, ...]
    frequency_rad_s: float
    frequency_stderr_rad_s: float
    budget: Budget
    readings: tuple[InertiaReading, ...]
    curves: Curves
    improvements: tuple[Improvement, ...]
    disturbed: tuple[Release, ...] = ()

    @property
    def inertia_kg_m2(self) -> float:
        """The motor's moment of inertia."""
        return self.budget.inertia_kg_m2

    @property
    def damping_ratio(self) -> float:
        """Mean damping ratio, from the decrement."""
        return float(np.mean([release.five.damping_ratio for release in self.releases]))


def read_release(
    index: int,
    t_ns: np.ndarray,
    count: np.ndarray,
    counts: int,
    setup: SpringSetup,
    cogging_Nm: np.ndarray | None = None,
) -> Release:
    """Return a release from its samples (n,). Raises IdentifyError naming it.

    counts: of the encoder's turn; cogging_Nm (3, n): as `waves_of` gives it.
    """
    try:
        swing = find_swing(t_ns, count, counts)
        decay = fit_decay(swing, setup.stiffness_Nm, cogging_Nm)
    except IdentifyError as error:
        raise IdentifyError(f"release {index + 1}: {error}") from None
    return Release(index, swing, five_periods(swing), decay)


def combine(
    releases: Sequence[Release], setup: SpringSetup, cogging_Nm: np.ndarray | None = None
) -> Oscillation:
    """Return the inertia from all releases. Raises IdentifyError if there are none.

    cogging_Nm (3, n): what they were read with. A release that fits clearly worse than others is
    left out: somebody touched the bar, or a computer stalled.
    """
    if not releases:
        raise IdentifyError("no good release in there")
    releases, disturbed = _apart(releases)
    frequency_rad_s, stderr_rad_s = mean_frequency([release.decay for release in releases])
    if cogging_Nm is not None:
        uncertain = _uncertain_cogging(releases[0], setup, cogging_Nm)
        stderr_rad_s = hypot(stderr_rad_s, uncertain * frequency_rad_s)
    found = budget(setup, frequency_rad_s, stderr_rad_s)
    if found.inertia_kg_m2 <= 0:
        raise IdentifyError(
            "bar and springs alone have more inertia than what swings; check bar_inertia_kg_m2, "
            "springs and levers_m in [plans.inertia-oscillation]"
        )
    damping = np.array([release.five.damping_ratio for release in releases])
    return Oscillation(
        setup=setup,
        stator=cogging_Nm is not None,
        releases=tuple(releases),
        frequency_rad_s=frequency_rad_s,
        frequency_stderr_rad_s=stderr_rad_s,
        budget=found,
        readings=_readings(releases, setup),
        curves=curves(setup, frequency_rad_s),
        improvements=improvements(
            setup,
            found.inertia_kg_m2,
            stderr_rad_s / frequency_rad_s,
            float(damping.mean()),
            float(damping.std(ddof=1)) if damping.size > 1 else 0.05 * float(damping[0]),
        ),
        disturbed=tuple(disturbed),
    )


def _apart(releases: Sequence[Release]) -> tuple[list[Release], list[Release]]:
    """Return those that fit as well as the best, and the others."""
    misfit_rad = np.array([np.std(release.decay.residual_rad) for release in releases])
    worst_rad = DISTURBED * float(np.percentile(misfit_rad, 25))
    good = [r for r, misfit in zip(releases, misfit_rad, strict=True) if misfit <= worst_rad]
    return good, [r for r, misfit in zip(releases, misfit_rad, strict=True) if misfit > worst_rad]


def _readings(releases: Sequence[Release], setup: SpringSetup) -> tuple[InertiaReading, ...]:
    heavy = setup.counting("heavy")
    five = [release.five for release in releases]
    cubic = [release.decay.cubic_per_rad2 for release in releases]
    words = WORDS[setup.effective_mass]
    undamped = [f.frequency_rad_s(damped=False) for f in five]
    damped = [f.frequency_rad_s() for f in five]
    small = [f.frequency_rad_s(cubic_per_rad2=c) for f, c in zip(five, cubic, strict=True)]
    ways = (
        ("five periods, damping neglected, m/3", heavy, undamped),
        (REPORTS_WAY, heavy, damped),
        (f"five periods, damped, {words}", setup, damped),
        (f"five periods, damped, at small amplitude, {words}", setup, small),
        (f"whole decay fitted, {words}", setup, [r.decay.frequency_rad_s for r in releases]),
    )
    readings = []
    for label, counted, frequencies_rad_s in ways:
        values = np.array([counted.inertia_kg_m2(w) for w in frequencies_rad_s])
        std = float(values.std(ddof=1)) if values.size > 1 else 0.0
        readings.append(InertiaReading(label, float(values.mean()), std))
    return tuple(readings)


def waves_of(table_Nm: np.ndarray) -> np.ndarray:
    """Return order, cosine and sine (3, n) of the cogging torque table_Nm (counts,)."""
    lines = np.fft.rfft(table_Nm) * (2 / table_Nm.size)
    order = np.arange(lines.size)
    there = (np.abs(lines) > 1e-3 * np.abs(lines).max()) & (order > 0)
    return np.array([order[there], lines[there].real, -lines[there].imag], float)


def _uncertain_cogging(release: Release, setup: SpringSetup, cogging_Nm: np.ndarray) -> float:
    """Return by how much the frequency is uncertain, in parts, as the cogging torque is."""
    changed = fit_decay(release.swing, setup.stiffness_Nm, cogging_Nm * (1 + COGGING_UNCERTAINTY))
    return abs(changed.frequency_rad_s / release.decay.frequency_rad_s - 1)
