"""The report of a heat-up and its cooling: temperatures with the fit, constants, residuals."""

from motord.experiments.operator_notes import add_operator_notes
from motord.experiments.subject import Recordings
from motord.experiments.thermal.plots import temperatures
from motord.experiments.thermal.result import ThermalConstants
from motord.intervals import IntervalEstimate, coverage_factor
from motord.report.html import Page

HEADER = ("", "value", "95 % interval", "unit")
STEADY_HEADER = ("channel", "end of the heat-up (degC)", "steady (degC)", "95 % interval", "")


def report(found: ThermalConstants, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Thermal constants", recordings.subject.lead)
    slowest = found.time_constants[0]
    cards = [(f"{slowest.time_constant_s.value:.4g} s", "slowest time constant, cooling")]
    if (ambient_K_per_W := found.resistance_K_per_W.value) is not None:
        cards.append((f"{ambient_K_per_W:.4g} K/W", f"{found.nodes[0]} to ambient"))
    page.cards(cards)
    page.table([], [*recordings.facts, *_facts(found)])
    page.heading("Heat-up and cooling")
    page.picture(
        temperatures(found),
        "Readings (dots) and the fit of the thermal network. Dashed: where a temperature would "
        "end with this current. Dotted: end of the current. Below: readings less the fit.",
    )
    page.heading("Constants")
    page.table(HEADER, rows(found), numbers=True)
    page.table(STEADY_HEADER, steady_rows(found), numbers=True)
    page.points(found.notes)
    add_operator_notes(page, recordings)
    return page


def rows(found: ThermalConstants) -> list[list[str]]:
    """Return the constants as rows under HEADER."""
    table = [
        _row(f"time constant {one.number}, {one.phase}", one.time_constant_s, "s")
        for one in found.time_constants
    ]
    if found.resistance_K_per_W.value is not None:
        name = f"{found.nodes[0]} to ambient, all paths"
        table.append(_row(name, found.resistance_K_per_W, "K/W"))
    else:
        name = f"{found.nodes[0]} above ambient for each A\u00b2"
        table.append(_row(name, found.rise, "K/A\u00b2"))
    lost = {True: "", False: ", not separated"}
    table += [
        _row(one.between, one.resistance_K_per_W, f"K/W{lost[one.separated]}")
        for one in found.resistances
    ]
    table += [
        _row(one.node, one.capacity_J_per_K, f"J/K{lost[one.separated]}")
        for one in found.capacities
    ]
    return table


def steady_rows(found: ThermalConstants) -> list[list[str]]:
    """Return the steady temperatures as rows under STEADY_HEADER."""
    return [
        [
            one.channel,
            f"{one.end_C:.2f}",
            "none" if steady.value is None else f"{steady.value:.2f}",
            "" if steady.value is None else f"{steady.low:.2f} to {steady.high:.2f}",
            "extrapolated" if one.extrapolated else "reached",
        ]
        for one in found.steady
        for steady in (one.steady_C,)
    ]


def _row(name: str, one: IntervalEstimate, unit: str) -> list[str]:
    return [name, f"{one.value:.4g}", f"{one.low:.4g} to {one.high:.4g}", unit]


def _facts(found: ThermalConstants) -> list[tuple[str, str]]:
    how = "measured" if found.ambient_measured else "fitted"
    half_width_K = coverage_factor(found.fit.freedom) * found.ambient_stderr_C
    ambient = f"{found.ambient_C:.2f} \u00b0C, {how}"
    heat = "" if found.heat_W is None else f", {found.heat_W:.4g} W of copper loss at its end"
    return [
        ("current", f"{found.current_rms_A:.4g} A RMS a phase{heat}"),
        ("heat-up", f"{found.heating_s:.0f} s, ended by {found.ended_by[0]}"),
        ("cooling", f"{found.cooling_s:.0f} s, ended by {found.ended_by[1]}"),
        (
            "ambient",
            ambient if found.ambient_measured else f"{ambient}, \u00b1 {half_width_K:.2f} K",
        ),
    ]
