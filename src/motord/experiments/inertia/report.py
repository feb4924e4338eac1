"""The report of a moment of inertia: by oscillation, by acceleration, or both."""

from dataclasses import dataclass, field

from motord.experiments.inertia.plots import Periods, Pushes, Swings, periods, pushes, swings
from motord.experiments.inertia.plots_budget import (
    Bar,
    Range,
    SensitivityCurve,
    explanation,
    ranked,
    sensitivity,
    shares,
)
from motord.report.html import Page


@dataclass(frozen=True)
class Value:
    """A moment of inertia (kg m^2): standard uncertainty and 95 % interval where they are known."""

    inertia_kg_m2: float
    uncertainty_kg_m2: float | None = None
    interval_kg_m2: tuple[float, float] | None = None


@dataclass(frozen=True)
class OscillationReport:
    """What the releases gave.

    readings: (label, kg m^2, standard deviation of one release) each, the report's way marked by
    `reports_way`; sources: (source, tolerance in words, share) ranked; changes: (label, period in
    s, uncertainty in parts); explained: for each range the part of cases as far off as CAD.
    """

    value: Value
    damping_ratio: float
    period_s: float
    repeatability: float
    disturbed: int
    swings: Swings
    periods: Periods
    readings: tuple[tuple[str, float, float], ...]
    reports_way: str
    sensitivity: SensitivityCurve
    sources: tuple[tuple[Bar, str], ...]
    changes: tuple[tuple[Bar, float], ...]
    explained: tuple[tuple[Range, float], ...]
    difference: float
    draws: int


@dataclass(frozen=True)
class AccelerationReport:
    """What the steps of torque gave; readings: (label, kg m^2) each."""

    value: Value
    pushes: Pushes
    readings: tuple[tuple[str, float], ...]
    sources: tuple[Bar, ...]


@dataclass(frozen=True)
class InertiaReport:
    """All that goes into the page; truth_kg_m2: of a simulated rig, if it is known."""

    lead: str
    facts: tuple[tuple[str, str], ...]
    oscillation: OscillationReport | None = None
    acceleration: AccelerationReport | None = None
    truth_kg_m2: float | None = None
    title: str = field(default="Moment of inertia")


def page(data: InertiaReport) -> Page:
    """Return a page of its own."""
    made = Page(data.title, data.lead)
    _cards(made, data)
    fill(made, data)
    made.heading("About these figures")
    made.table((), data.facts)
    return made


def fill(page: Page, data: InertiaReport) -> None:
    """Add what there is to a page that may hold other experiments, too."""
    if data.oscillation is not None:
        _oscillation(page, data.oscillation, data.truth_kg_m2)
        _budget(page, data.oscillation)
        _difference(page, data.oscillation)
    if data.acceleration is not None:
        _acceleration(page, data.acceleration, data.truth_kg_m2)


def grams(inertia_kg_m2: float) -> str:
    """Return a moment of inertia in 1e-3 kg m^2 with four digits."""
    return f"{1e3 * inertia_kg_m2:.3f}"


UNIT = "10\u207b\u00b3 kg m\u00b2"


def _cards(page: Page, data: InertiaReport) -> None:
    cards = []
    for name, part in (("oscillation", data.oscillation), ("acceleration", data.acceleration)):
        if part is not None:
            cards.append((f"{grams(part.value.inertia_kg_m2)} {UNIT}", f"by {name}"))
            u = part.value.uncertainty_kg_m2
            if u is not None:
                percent = 196 * u / part.value.inertia_kg_m2
                cards.append((f"\u00b1 {percent:.2g} %", f"95 %, by {name}"))
    if data.truth_kg_m2 is not None:
        cards.append((f"{grams(data.truth_kg_m2)} {UNIT}", "true of the simulated rig"))
    page.cards(cards)


def _against(value_kg_m2: float, truth_kg_m2: float | None) -> list[str]:
    if truth_kg_m2 is None:
        return []
    return [f"{100 * (value_kg_m2 / truth_kg_m2 - 1):+.3f}"]


def _oscillation(page: Page, data: OscillationReport, truth_kg_m2: float | None) -> None:
    page.heading("Moment of inertia by oscillation")
    left_out = f" {data.disturbed} more fit worse and are left out." if data.disturbed else ""
    page.paragraph(
        f"A bar between springs on the rotor is let go, {len(data.swings.releases)} times."
        f"{left_out} The "
        f"period is {1e3 * data.period_s:.2f} ms, the damping ratio {data.damping_ratio:.4f}; the "
        f"frequency of one release repeats within {100 * data.repeatability:.4f} %."
    )
    page.picture(
        swings(data.swings),
        "Angle from rest after each release (Poels 2008, Figure 2.4) and the encoder's samples of "
        "the last oscillation that is used of one release (Figure 2.5), with the fit.",
    )
    header = ["reading of the swings", f"J ({UNIT})", "std of a release (%)"]
    header += ["off the truth (%)"] if truth_kg_m2 is not None else []
    rows = [
        [label, grams(j), f"{100 * std / j:.4f}", *_against(j, truth_kg_m2)]
        for label, j, std in data.readings
    ]
    page.table(header, rows, numbers=True)
    page.paragraph(
        f"\u201c{data.reports_way}\u201d is how Poels 2008 reads the swings, eqs. (2.4) to (2.6). "
        "Two things make it too high: the springs pull along their own direction, so that their "
        "lever shortens as the bar swings, by the square of its amplitude; and more of their mass "
        "swings than the third that belongs to a heavy load."
    )
    page.picture(
        periods(data.periods),
        "Period over the spring constant of each side (Poels 2008, Figure 2.2), for this bar and "
        "this motor.",
    )


def _budget(page: Page, data: OscillationReport) -> None:
    page.heading("Uncertainty of the moment of inertia")
    u, interval = data.value.uncertainty_kg_m2, data.value.interval_kg_m2
    if u is not None and interval is not None:
        page.paragraph(
            f"J = {grams(data.value.inertia_kg_m2)} {UNIT} with a standard uncertainty of "
            f"{100 * u / data.value.inertia_kg_m2:.2g} % (first order, GUM); 95 % of "
            f"{data.draws:,} draws lie between {grams(interval[0])} and {grams(interval[1])}."
        )
    page.picture(
        shares([bar for bar, _ in data.sources], [bar for bar, _ in data.changes]),
        "Standard uncertainty that each source alone would give, and what is left of the whole "
        "after the changes that Poels 2008, section 2.3.2, proposes, with the same ruler and "
        "balance. A single lever has no others to average with; the brake's disc makes damping, "
        "which hardly matters.",
    )
    page.table(
        ["source", "tolerance", "share (% of J)"],
        [[bar.label, words, f"{100 * bar.uncertainty:.3f}"] for bar, words in data.sources],
        numbers=True,
    )
    page.table(
        ["set-up", "period (ms)", "standard uncertainty (% of J)"],
        [
            [bar.label, f"{1e3 * period_s:.1f}", f"{100 * bar.uncertainty:.2f}"]
            for bar, period_s in data.changes
        ],
        numbers=True,
    )
    page.picture(
        sensitivity(data.sensitivity),
        "Error of the moment of inertia by errors of the spring constants, the levers, the "
        "springs' weighed mass and their effective mass (Poels 2008, Figures 2.6 to 2.9). The dot "
        "is the effective mass that waves in uniform springs give.",
    )


def _difference(page: Page, data: OscillationReport) -> None:
    page.heading(f"The report's {100 * data.difference:.1f} %")
    page.paragraph(
        "Poels 2008 measured 9.902 and has 10.56 from CAD drawings. With its own tolerances (3 % "
        "of the spring constants, 0.5 % of the levers, 3 % of the springs' mass), this is what may "
        "be:"
    )
    page.picture(
        explanation([item for item, _ in data.explained], data.difference),
        "95 % of the cases (thick) and the worst case (thin) by the report's tolerances, its "
        "set-up being inferred from its figures.",
    )
    page.points(
        [
            f"{item.label}: "
            f"{100 * item.interval[0]:+.1f} to {100 * item.interval[1]:+.1f} % in 95 % of cases; "
            f"as far off as CAD in {_share(rarity)}"
            for item, rarity in data.explained
        ]
    )
    page.paragraph(
        "So the difference lies within the 95 % interval if one error is common to all springs, as "
        "from one ruler and one balance, and the effective mass is a third; with an error of its "
        "own for each spring it does not, and an effective mass above a third takes it further "
        "away. It is always within the worst case."
    )


def _share(rarity: float) -> str:
    if rarity < 1e-4:
        return "less than 0.01 % of them"
    return f"{100 * rarity:.2g} % of them"


def _acceleration(page: Page, data: AccelerationReport, truth_kg_m2: float | None) -> None:
    page.heading("Moment of inertia by acceleration")
    page.paragraph(
        "The motor's own torque turns the rotor from rest, forwards and back, with the brake open. "
        "The torque sensor does not pass a mean, but a step that begins from rest it does: its "
        "high-pass is undone from there on, so the cogging torque is part of what was measured. "
        "The commanded torque knows neither cogging torque nor errors of the currents."
    )
    page.picture(
        pushes(data.pushes),
        "Angle turned with its fit, and the torque by the sensor with its high-pass undone; steps "
        "backwards are drawn turned round.",
    )
    header = ["reading of the steps", f"J ({UNIT})"]
    header += ["off the truth (%)"] if truth_kg_m2 is not None else []
    page.table(
        header,
        [[label, grams(j), *_against(j, truth_kg_m2)] for label, j in data.readings],
        numbers=True,
    )
    page.picture(ranked(data.sources), "Standard uncertainty that each source alone would give.")
