"""The content of a report on the moment of inertia: results in the words of the page."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np

from motord.experiments.calibration.content import facts
from motord.experiments.inertia.error_budget import Curves, Share
from motord.experiments.inertia.oscillation import REPORTS_WAY, Oscillation, Release
from motord.experiments.inertia.plots import Periods, Pushes, Swings, thinned
from motord.experiments.inertia.plots_budget import Bar, Range, SensitivityCurve
from motord.experiments.inertia.report import (
    AccelerationReport,
    InertiaReport,
    OscillationReport,
    Value,
)
from motord.experiments.inertia.results import DIFFERENCE, explanations
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.torque_step import Acceleration
from motord.experiments.subject import Subject

PERIODS_FROM, PERIODS_TO = 0.2, 1.6
"""Spring constants over which the period is drawn, in parts of the set-up's own."""


def inertia_report(
    subject: Subject,
    runs: Sequence[str],
    *,
    oscillation: Oscillation | None = None,
    acceleration: Acceleration | None = None,
    truth_kg_m2: float | None = None,
) -> InertiaReport:
    """Return the content of a report; truth_kg_m2 is the inertia of a simulated rotor."""
    rows = list(facts(None, subject, runs))
    if oscillation is not None:
        rows.append(("set-up", _words(oscillation.setup)))
    return InertiaReport(
        lead=f"{subject.motor.name} on bench {subject.bench}",
        facts=tuple(rows),
        oscillation=None if oscillation is None else _oscillation(oscillation),
        acceleration=None if acceleration is None else _acceleration(acceleration),
        truth_kg_m2=truth_kg_m2,
    )


def _words(setup: SpringSetup) -> str:
    levers = ", ".join(f"{1e3 * lever_m:g}" for lever_m in setup.levers_m)
    return (
        f"{setup.stiffness_N_per_m.size} springs of {setup.stiffness_N_per_m.min():g} to "
        f"{setup.stiffness_N_per_m.max():g} N/m and {1e3 * setup.mass_kg.mean():.3g} g, levers "
        f"{levers} mm, bar {setup.bar_inertia_kg_m2:g} kg m\u00b2, effective mass: "
        f"{setup.effective_mass}"
    )


def _oscillation(found: Oscillation) -> OscillationReport:
    b = found.budget
    frequencies = np.array([release.decay.frequency_rad_s for release in found.releases])
    scatter = float(frequencies.std(ddof=1) / frequencies.mean()) if frequencies.size > 1 else 0.0
    return OscillationReport(
        value=Value(b.inertia_kg_m2, b.uncertainty_kg_m2, b.interval_kg_m2),
        damping_ratio=found.damping_ratio,
        period_s=float(np.mean([release.five.period_s for release in found.releases])),
        repeatability=scatter,
        disturbed=len(found.disturbed),
        swings=_swings(found.releases),
        periods=_periods(found.setup, b.inertia_kg_m2),
        readings=tuple((r.label, r.inertia_kg_m2, r.std_kg_m2) for r in found.readings),
        reports_way=REPORTS_WAY,
        sensitivity=_sensitivity(found.curves),
        sources=tuple((Bar(s.source, s.uncertainty), _tolerance(s)) for s in b.shares),
        changes=tuple((Bar(i.label, i.uncertainty), i.period_s) for i in found.improvements),
        explained=tuple((Range(e.label, e.interval, e.worst), e.rarity) for e in explanations()),
        difference=DIFFERENCE,
        draws=b.draws,
    )


def _swings(releases: Sequence[Release]) -> Swings:
    """Return what is drawn of the releases, from each one's first crossing on."""
    drawn = [(r.decay.t_s, r.decay.angle_rad - r.decay.rest_rad) for r in releases]
    first = releases[0]
    t_s = first.decay.t_s
    late = t_s >= first.swing.crossings_s[-3] - first.swing.crossings_s[0]
    fitted_rad = first.decay.angle_rad + first.decay.residual_rad
    return Swings(
        releases=thinned(drawn),
        resolution_rad=first.swing.resolution_rad,
        late_s=t_s[late],
        late_rad=drawn[0][1][late],
        late_fit_rad=fitted_rad[late] - first.decay.rest_rad,
    )


def _periods(setup: SpringSetup, inertia_kg_m2: float) -> Periods:
    """Return the period over the spring constant, all springs alike."""
    own_N_per_m = float(setup.stiffness_N_per_m.sum()) / 2
    parts = np.linspace(PERIODS_FROM, PERIODS_TO, 57)
    periods_s = [
        2
        * pi
        / replace(setup, stiffness_N_per_m=part * setup.stiffness_N_per_m).frequency_rad_s(
            inertia_kg_m2
        )
        for part in parts
    ]
    return Periods(
        stiffness_N_per_m=parts * own_N_per_m,
        period_s=np.array(periods_s),
        own_N_per_m=own_N_per_m,
        own_s=2 * pi / setup.frequency_rad_s(inertia_kg_m2),
    )


def _sensitivity(c: Curves) -> SensitivityCurve:
    return SensitivityCurve(
        stiffness=c.stiffness,
        stiffness_change=c.stiffness_change,
        lever=c.lever,
        lever_change=c.lever_change,
        mass=c.mass,
        mass_change=c.mass_change,
        factor=c.factor,
        factor_change=c.factor_change,
        wave_factor=c.wave_factor,
    )


def _tolerance(share: Share) -> str:
    if share.source == "frequency":
        return f"{100 * share.half_width:.4f} % (standard error)"
    each = " each" if share.inputs > 1 else ""
    if share.source == "effective mass":
        return f"\u00b1 {share.half_width:g} of the springs' mass"
    return f"\u00b1 {100 * share.half_width:g} %{each}"


def _acceleration(found: Acceleration) -> AccelerationReport:
    return AccelerationReport(
        value=Value(found.inertia_kg_m2, found.uncertainty_kg_m2),
        pushes=Pushes(
            tuple((p.t_s, p.angle_rad, p.torque_Nm, p.fitted_s, p.fitted_rad) for p in found.pushes)
        ),
        readings=(
            ("angle fitted with friction, torque by the sensor", found.inertia_kg_m2),
            ("the same, torque as commanded", found.commanded_kg_m2),
            ("as commanded, friction neglected, eq. (2.1)", found.plain_kg_m2),
        ),
        sources=tuple(Bar(s.source, s.uncertainty) for s in found.sources),
    )
