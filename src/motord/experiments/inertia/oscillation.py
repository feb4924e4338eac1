"""The inertia from all releases, by several methods, and its uncertainty budget."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from math import hypot
from typing import ClassVar

import numpy as np

from motord.experiments.inertia.error_budget import (
    Budget,
    Curves,
    Improvement,
    budget,
    curves,
    improvements,
)
from motord.experiments.inertia.releases import Release
from motord.experiments.inertia.springs import SpringSetup
from motord.findings import Finding, listed
from motord.identification import IdentifyError
from motord.identification.rotor.free_decay import fit_decay, mean_frequency
from motord.intervals import coverage_factor

FEW_RELEASES = 4
"""Releases below which their scatter says little."""

EFFECTIVE_MASS_LABELS = {
    "wave": "waves in the springs",
    "heavy": "m/3",
    "unloaded": "4m/\u03c0\u00b2",
}
"""Models of the effective mass."""

POELS2008_METHOD = "five periods, damped, m/3"
"""The method of Poels 2008."""

DISTURBED = 1.25
"""How much worse than those that fit best (a quarter of them) a release may fit and be used."""

COGGING_UNCERTAINTY = 0.01
"""Standard uncertainty of a known cogging torque, in parts of it."""


@dataclass(frozen=True)
class InertiaReading:
    """The inertia by one method; std: of one release."""

    label: str
    inertia_kg_m2: float
    std_kg_m2: float


@dataclass(frozen=True)
class Oscillation:
    """The motor's inertia by oscillation.

    stator: it was in place, and its cogging torque known. budget: of the fitted decays with the
    chosen effective mass; readings: by other methods; improvements: what changes
    of the set-up would bring. disturbed: releases that were left out, as they fit worse.
    more_findings: findings of signals, and of releases that cannot be used.
    """

    experiment = "inertia-oscillation"
    JSON: ClassVar = (
        "experiment", "inertia_kg_m2", "uncertainty_kg_m2",
        "interval_95_kg_m2=budget.interval_kg_m2", "monte_carlo=budget.monte_carlo",
        "effective_mass=setup.effective_mass", "effective_mass_factor",
        "stiffness_Nm_per_rad=setup.stiffness_Nm", "frequency_rad_s", "frequency_stderr_rad_s",
        "damping_ratio", "budget=budget.shares", "disturbed=disturbed_indices", "readings",
        "improvements", "releases",
    )  # fmt: skip

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
    more_findings: tuple[Finding, ...] = ()

    @property
    def inertia_kg_m2(self) -> float:
        """The motor's moment of inertia."""
        return self.budget.inertia_kg_m2

    @property
    def uncertainty_kg_m2(self) -> float:
        """Its standard uncertainty (GUM)."""
        return self.budget.uncertainty_kg_m2

    @property
    def half_width_kg_m2(self) -> float:
        """Half of the 95 % interval."""
        return coverage_factor() * self.uncertainty_kg_m2

    @property
    def effective_mass_factor(self) -> np.ndarray:
        """Part of each spring's mass that swings (n,)."""
        return self.setup.factors(self.frequency_rad_s)

    @property
    def disturbed_indices(self) -> list[int]:
        """Numbers of the releases that were left out."""
        return [release.index for release in self.disturbed]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is questionable about the oscillations."""
        return (*_few(len(self.releases)), *_left_out(self), *self.more_findings)

    @property
    def damping_ratio(self) -> float:
        """Mean damping ratio, from the decrement."""
        return float(np.mean([release.five.damping_ratio for release in self.releases]))


def combine(
    releases: Sequence[Release], setup: SpringSetup, cogging_Nm: np.ndarray | None = None
) -> Oscillation:
    """Return the inertia from all releases. Raises IdentifyError if there are none.

    cogging_Nm (3, n): what they were read with. A release that fits clearly worse than others is
    left out: somebody touched the bar, or a computer stalled.
    """
    if not releases:
        raise IdentifyError("there is no good release in the recordings")
    releases, disturbed = _without_disturbed(releases)
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
            setup, found.inertia_kg_m2, stderr_rad_s / frequency_rad_s, *_damping(releases)
        ),
        disturbed=tuple(disturbed),
    )


def _damping(releases: Sequence[Release]) -> tuple[float, float]:
    """Return mean and standard deviation of the damping ratio; of one release 5 % are assumed."""
    ratio = np.array([release.five.damping_ratio for release in releases])
    return float(ratio.mean()), float(ratio.std(ddof=1) if ratio.size > 1 else 0.05 * ratio[0])


def _without_disturbed(releases: Sequence[Release]) -> tuple[list[Release], list[Release]]:
    """Return those that fit as well as the best, and the others."""
    disturbed = _misfits_rad(releases) > _most_rad(releases)
    return list(compress(releases, ~disturbed)), list(compress(releases, disturbed))


def _misfits_rad(releases: Sequence[Release]) -> np.ndarray:
    return np.array([np.std(release.decay.residual_rad) for release in releases])


def _most_rad(releases: Sequence[Release]) -> float:
    """Return the misfit above which one of the releases counts as disturbed."""
    return DISTURBED * float(np.percentile(_misfits_rad(releases), 25))


def _readings(releases: Sequence[Release], setup: SpringSetup) -> tuple[InertiaReading, ...]:
    heavy = replace(setup, effective_mass="heavy")
    five = [release.five for release in releases]
    cubic = [release.decay.cubic_per_rad2 for release in releases]
    model = EFFECTIVE_MASS_LABELS[setup.effective_mass]
    undamped = [f.frequency_rad_s(damped=False) for f in five]
    damped = [f.frequency_rad_s() for f in five]
    small = [f.frequency_rad_s(cubic_per_rad2=c) for f, c in zip(five, cubic, strict=True)]
    methods = (
        ("five periods, damping neglected, m/3", heavy, undamped),
        (POELS2008_METHOD, heavy, damped),
        (f"five periods, damped, {model}", setup, damped),
        (f"five periods, damped, at small amplitude, {model}", setup, small),
        (f"whole decay fitted, {model}", setup, [r.decay.frequency_rad_s for r in releases]),
    )
    readings = []
    for label, counted, frequencies_rad_s in methods:
        values = np.array([counted.inertia_kg_m2(w) for w in frequencies_rad_s])
        std = float(values.std(ddof=1)) if values.size > 1 else 0.0
        readings.append(InertiaReading(label, float(values.mean()), std))
    return tuple(readings)


def _uncertain_cogging(release: Release, setup: SpringSetup, cogging_Nm: np.ndarray) -> float:
    """Return by how much the frequency is uncertain, in parts, as the cogging torque is."""
    changed = fit_decay(
        release.oscillation, setup.stiffness_Nm, cogging_Nm * (1 + COGGING_UNCERTAINTY)
    )
    return abs(changed.frequency_rad_s / release.decay.frequency_rad_s - 1)


def _few(releases: int) -> Iterator[Finding]:
    if releases < FEW_RELEASES:
        yield Finding(
            "few-releases", releases, FEW_RELEASES, "releases", "warning",
            "what differs from release to release is hardly in the uncertainty",
            "let go more often",
        )  # fmt: skip


def _left_out(found: Oscillation) -> Iterator[Finding]:
    if found.disturbed:
        worst_rad = float(_misfits_rad(found.disturbed).max())
        limit_rad = _most_rad((*found.releases, *found.disturbed))
        yield Finding(
            "releases-left-out", worst_rad, limit_rad, "rad", "note",
            f"{listed([one.label for one in found.disturbed])}: left out, as a decay fits worse "
            "there than in the others: somebody touched the bar, or ticks were missed",
            "let go again, without touching the bar",
        )  # fmt: skip
