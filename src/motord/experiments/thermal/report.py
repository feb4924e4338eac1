"""The report of a heat-up and its cooling: temperatures with the fit, constants, residuals."""

from math import isfinite

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.subject import Recordings
from motord.experiments.thermal.recordings import STOPPED
from motord.experiments.thermal.result import ThermalConstants
from motord.experiments.thermal.watch import STEADY, TEMPERATURE_LIMIT, TIME_LIMIT
from motord.intervals import IntervalEstimate, decimals_of
from motord.report.html import Page
from motord.report.style import AFTER, BEFORE, INK, OTHER, SOFT, figure

HEADER = ("", "value", "95 % interval", "unit")
STEADY_HEADER = ("channel", "end of the heat-up (degC)", "steady (degC)", "95 % interval", "is")

COLOURS = {"winding": BEFORE, "magnet": OTHER, "housing": AFTER}
MARKERS = {"winding": "o", "magnet": "s", "housing": "^"}

ENDED = {
    STEADY: ", until the temperatures were steady",
    TIME_LIMIT: ", until its time limit",
    TEMPERATURE_LIMIT: ", until a temperature was at its limit",
    STOPPED: ", until it was stopped",
}
"""What ended heat-up or cooling, by the reason that the recording has."""

DOTS = 250
"""Readings that are drawn of each channel, about."""


def report(found: ThermalConstants, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Thermal constants", recordings.subject.lead)
    slowest = found.time_constants[0]
    cards = [(slowest.time_constant_s.text(" s"), "slowest time constant, cooling")]
    if ambient := found.resistance_K_per_W.text(" K/W"):
        cards.append((ambient, f"{found.nodes[0]} to ambient"))
    page.cards(cards)
    page.facts([*recordings.facts, *_facts(found)])
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
    return page


def rows(found: ThermalConstants) -> list[list[str]]:
    """Return the constants as rows under HEADER."""
    table = [
        constant_row(f"time constant {one.number}, {one.phase}", one.time_constant_s, "s")
        for one in found.time_constants
    ]
    if found.resistance_K_per_W.value is not None:
        name = f"{found.nodes[0]} to ambient, all paths"
        table.append(constant_row(name, found.resistance_K_per_W, "K/W"))
    else:
        name = f"{found.nodes[0]} above ambient for each A\u00b2"
        table.append(constant_row(name, found.rise, "K/A\u00b2"))
    lost = {True: "", False: ", not separated"}
    table += [
        constant_row(one.between, one.resistance_K_per_W, f"K/W{lost[one.separated]}")
        for one in found.resistances
    ]
    table += [
        constant_row(one.node, one.capacity_J_per_K, f"J/K{lost[one.separated]}")
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
            "" if steady.value is None else _interval(steady, ".2f"),
            "extrapolated" if one.extrapolated else "reached",
        ]
        for one in found.steady
        for steady in (one.steady_C,)
    ]


def constant_row(name: str, one: IntervalEstimate, unit: str) -> list[str]:
    """Return a constant with the digits that its interval has two of, four if it has none."""
    low, high = one.low, one.high
    if low is None or high is None or not isfinite(high - low) or high <= low:
        return [name, f"{one.value:#.4g}".rstrip("."), _interval(one, ".4g"), unit]
    digits = f".{max(decimals_of((high - low) / 2), 0)}f"
    return [name, f"{one.value:{digits}}", _interval(one, digits), unit]


def _interval(one: IntervalEstimate, digits: str) -> str:
    return "not known" if one.low is None else f"{one.low:{digits}} to {one.high:{digits}}"


def _facts(found: ThermalConstants) -> list[tuple[str, str]]:
    heating, cooling = found.ended_by
    how = "measured" if found.ambient_measured else "fitted"
    ambient = f"{found.ambient_C:.2f} \u00b0C, {how}"
    heat = "" if found.heat_W is None else f", {found.heat_W:.4g} W of copper loss at its end"
    return [
        ("current", f"{found.current_rms_A:.4g} A RMS a phase{heat}"),
        ("heat-up", f"{found.heating_s:.0f} s{ENDED.get(heating, '')}"),
        ("cooling", f"{found.cooling_s:.0f} s{ENDED.get(cooling, '')}"),
        (
            "ambient",
            ambient if found.ambient_measured else ambient + found.ambient_error_text("\u00b1"),
        ),
    ]


def temperatures(found: ThermalConstants) -> Figure:
    """Return temperatures over time with the fit, and below the residual of each channel."""
    with figure(5.2) as picture:
        upper, lower = picture.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
        course = found.fit.course
        every = zip(
            course.readings.items(), found.fit.fitted_C, found.fit.residuals_K, found.steady,
            strict=True,
        )  # fmt: skip
        for (node, each), fitted_C, residual_K, steady in every:
            colour, some = COLOURS[node], slice(None, None, max(each.t_s.size // DOTS, 1))
            minutes = each.t_s / 60
            upper.plot(
                minutes[some], each.value_C[some], ".", color=colour, markersize=3.0, alpha=0.5
            )
            upper.plot(
                minutes, fitted_C, color=colour, linewidth=1.2, label=each.channel,
                marker=MARKERS[node], markersize=5.0, markevery=0.08,
            )  # fmt: skip
            lower.plot(minutes, residual_K, ".", color=colour, markersize=1.5, alpha=0.6)
            if (steady_C := steady.steady_C.value) is not None:
                _steady(upper, steady_C, course.heating_s / 60, colour)
        if course.ambient is not None:
            upper.plot(
                course.ambient.t_s / 60, course.ambient.value_C, color=SOFT, linewidth=0.9,
                label=course.ambient.channel,
            )  # fmt: skip
        for axes in (upper, lower):
            axes.axvline(course.heating_s / 60, color=INK, linewidth=0.8, linestyle=(0, (2, 2)))
        lower.axhline(0.0, color=SOFT, linewidth=0.8)
        upper.set(ylabel="temperature (\u00b0C)")
        lower.set(xlabel="time (min)", ylabel="residual (K)")
        upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        return picture


def _steady(axes: Axes, steady_C: float, until_min: float, colour: str) -> None:
    axes.plot([0, until_min], [steady_C] * 2, color=colour, linewidth=0.9, linestyle=(0, (5, 3)))
