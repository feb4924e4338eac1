"""The page on a moment of inertia: by oscillation, by acceleration, or both."""

import numpy as np

from motord.experiments.inertia.acceleration import Acceleration
from motord.experiments.inertia.error_budget import Share
from motord.experiments.inertia.oscillation import POELS2008_METHOD, Oscillation
from motord.experiments.inertia.plots import (
    decays,
    periods,
    sensitivity,
    torque_steps,
    uncertainties,
)
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus
from motord.report.html import Page

UNIT = "10\u207b\u00b3 kg m\u00b2"


def report(found: Oscillation | Acceleration, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Moment of inertia", recordings.subject.lead)
    name = "oscillation" if isinstance(found, Oscillation) else "acceleration"
    percent = 100 * found.half_width_kg_m2 / found.inertia_kg_m2
    inertia = plus_minus(1e3 * found.inertia_kg_m2, 1e3 * found.half_width_kg_m2)
    page.cards([(f"({inertia}) \u00b7 {UNIT}", f"by {name}, 95 %: \u00b1 {percent:.2g} %")])
    fill(page, found)
    page.heading("About these figures")
    rows = recordings.facts
    if isinstance(found, Oscillation):
        rows.append(("set-up", _described(found.setup)))
    page.facts(rows)
    return page


def fill(page: Page, found: Oscillation | Acceleration, truth_kg_m2: float | None = None) -> None:
    """Add one experiment to a page; truth_kg_m2: of a simulated rig, if it is known."""
    if isinstance(found, Oscillation):
        _oscillation(page, found, truth_kg_m2)
        _budget(page, found)
    else:
        _acceleration(page, found, truth_kg_m2)


def in_thousandths(inertia_kg_m2: float) -> str:
    """Return a moment of inertia in 1e-3 kg m^2 with five digits."""
    return f"{1e3 * inertia_kg_m2:#.5g}"


def _against(value_kg_m2: float, truth_kg_m2: float | None) -> list[str]:
    if truth_kg_m2 is None:
        return []
    return [f"{100 * (value_kg_m2 / truth_kg_m2 - 1):+.3f}"]


def _oscillation(page: Page, found: Oscillation, truth_kg_m2: float | None) -> None:
    page.heading("Moment of inertia by oscillation")
    disturbed, releases = len(found.disturbed), found.releases
    frequencies = np.array([release.decay.frequency_rad_s for release in releases])
    scatter = float(frequencies.std(ddof=1) / frequencies.mean()) if frequencies.size > 1 else 0.0
    period_s = float(np.mean([release.five.period_s for release in releases]))
    left_out = f" {disturbed} more fit worse and are left out." if disturbed else ""
    page.paragraph(
        f"A bar between springs on the rotor is let go, {len(releases)} times."
        f"{left_out} The "
        f"period is {1e3 * period_s:.2f} ms, the damping ratio {found.damping_ratio:.4f}; the "
        f"frequency of one release repeats within {100 * scatter:.4f} %."
    )
    page.picture(
        decays(releases),
        "Angle from rest after each release (Poels 2008, Figure 2.4) and the encoder's samples of "
        "the last oscillation that is used of one release (Figure 2.5), with the fit.",
    )
    _methods(page, found, truth_kg_m2)
    page.paragraph(
        f"\u201c{POELS2008_METHOD}\u201d is the method of Poels 2008, eqs. (2.4) to (2.6). "
        "Two things make it too high: the springs pull along their own direction, so that their "
        "lever shortens as the bar swings, by the square of its amplitude; and more of their mass "
        "swings than the third that belongs to a heavy load."
    )
    page.picture(
        periods(found.setup, found.inertia_kg_m2),
        "Period over the spring constant of each side (Poels 2008, Figure 2.2), for this bar and "
        "this motor.",
    )


def _methods(page: Page, found: Oscillation, truth_kg_m2: float | None) -> None:
    """Add the table of the inertia by each method."""
    header = ["method", f"J ({UNIT})", "std of a release (%)"]
    header += ["off the truth (%)"] if truth_kg_m2 is not None else []
    rows = [
        [
            one.label,
            in_thousandths(one.inertia_kg_m2),
            f"{100 * one.std_kg_m2 / one.inertia_kg_m2:.4f}",
            *_against(one.inertia_kg_m2, truth_kg_m2),
        ]
        for one in found.readings
    ]
    page.table(header, rows, numbers=True)


def _budget(page: Page, found: Oscillation) -> None:
    page.heading("Uncertainty of the moment of inertia")
    budget = found.budget
    low, high = budget.interval_kg_m2
    page.paragraph(
        f"J = {in_thousandths(budget.inertia_kg_m2)} {UNIT} with a standard uncertainty of "
        f"{100 * budget.uncertainty_kg_m2 / budget.inertia_kg_m2:.2g} % (first order, GUM); 95 % "
        f"of {budget.draws:,} draws lie between {in_thousandths(low)} and {in_thousandths(high)}."
    )
    page.picture(
        uncertainties(
            ("Where it comes from", [(one.source, one.uncertainty) for one in budget.shares]),
            (
                "After changes of the set-up",
                [(one.label, one.uncertainty) for one in found.improvements],
            ),
        ),
        "Standard uncertainty that each source alone would give, and the combined one "
        "after the changes that Poels 2008, section 2.3.2, proposes, with the same ruler and "
        "balance. A single lever has no others to average with; the brake's disc makes damping, "
        "which hardly matters.",
    )
    _budget_tables(page, found)
    page.picture(
        sensitivity(found.curves),
        "Error of the moment of inertia by errors of the spring constants, the levers, the "
        "springs' weighed mass and their effective mass (Poels 2008, Figures 2.6 to 2.9). The dot "
        "is the effective mass that waves in uniform springs give.",
    )


def _budget_tables(page: Page, found: Oscillation) -> None:
    """Add the tables of the sources, and of the changes of the set-up."""
    page.table(
        ["source", "tolerance", "share (% of J)"],
        [
            [one.source, _tolerance(one), f"{100 * one.uncertainty:.3f}"]
            for one in found.budget.shares
        ],
        numbers=True,
    )
    page.table(
        ["set-up", "period (ms)", "standard uncertainty (% of J)"],
        [
            [one.label, f"{1e3 * one.period_s:.1f}", f"{100 * one.uncertainty:.2f}"]
            for one in found.improvements
        ],
        numbers=True,
    )


def _acceleration(page: Page, found: Acceleration, truth_kg_m2: float | None) -> None:
    page.heading("Moment of inertia by acceleration")
    page.paragraph(
        "The motor's own torque turns the rotor from rest, forwards and back, with the brake open. "
        "The torque sensor does not pass a mean, but a step that begins from rest it does: its "
        "high-pass is undone from there on, so the cogging torque is part of what was measured. "
        "The commanded torque knows neither cogging torque nor errors of the currents."
    )
    page.picture(
        torque_steps(found.steps),
        "Angle turned with its fit, and the torque by the sensor with its high-pass undone; steps "
        "backwards are drawn turned round.",
    )
    header = ["reading of the steps", f"J ({UNIT})"]
    header += ["off the truth (%)"] if truth_kg_m2 is not None else []
    page.table(
        header,
        [
            [label, in_thousandths(j), *_against(j, truth_kg_m2)]
            for label, j in (
                ("angle fitted with friction, torque by the sensor", found.inertia_kg_m2),
                ("the same, torque as commanded", found.commanded_kg_m2),
                ("as commanded, friction neglected, eq. (2.1)", found.plain_kg_m2),
            )
        ],
        numbers=True,
    )
    page.picture(
        uncertainties(("", [(one.source, one.uncertainty) for one in found.budget])),
        "Standard uncertainty that each source alone would give.",
    )


def _described(setup: SpringSetup) -> str:
    levers = ", ".join(f"{1e3 * lever_m:g}" for lever_m in setup.levers_m)
    return (
        f"{setup.stiffness_N_per_m.size} springs of {setup.stiffness_N_per_m.min():g} to "
        f"{setup.stiffness_N_per_m.max():g} N/m and {1e3 * setup.mass_kg.mean():.3g} g, levers "
        f"{levers} mm, bar {setup.bar_inertia_kg_m2:g} kg m\u00b2, effective mass: "
        f"{setup.effective_mass}"
    )


def _tolerance(share: Share) -> str:
    if share.source == "frequency":
        return f"{100 * share.half_width:.4f} % (standard error)"
    each = " each" if share.inputs > 1 else ""
    if share.source == "effective mass":
        return f"\u00b1 {share.half_width:g} of the springs' mass"
    return f"\u00b1 {100 * share.half_width:g} %{each}"
