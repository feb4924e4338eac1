"""Page of a soak: figures over the repetitions, and their slopes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.soak.result import FigureTrend, SoakResult
from motord.experiments.soak.trend import CORRELATION_MAX
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus
from motord.report.html import Page, typeset
from motord.report.style import AFTER, SOFT, figure

HEADER = ("figure", "mean", "unit", "slope an hour", "drift", "step")
"""Of the table of slopes."""

CARDS = 3
"""Figures whose slopes the page begins with."""

PANELS_MAX = 8
"""Figures of whole repetitions that are drawn; the table has all."""


def report(found: SoakResult, recordings: Recordings) -> Page:
    """Return the page of a soak."""
    page = Page("Soak", recordings.subject.lead)
    if found.trends:
        page.cards([_card(one) for one in _foremost(found)])
    page.paragraph(f"{found.statement}.")
    page.heading("Over the repetitions")
    if not found.trends:
        page.paragraph("No figure has two values: slopes need two repetitions.")
    else:
        page.picture(
            over_time(found),
            "Each repetition's figures (dots: all points are there), those of the single "
            "set-points (thin), and the fitted slope; dashed where chance explains it.",
        )
    page.heading("Slopes")
    page.table(HEADER, rows(found), numbers=True)
    page.paragraph(
        "95 % intervals, by generalised least squares with residuals correlated from repetition to "
        "repetition. Drifts are judged for all figures together: where there is none, one is "
        f"claimed in about 5 % of soaks at most, up to a correlation of {CORRELATION_MAX:g}. "
        "A step is what changed at once; the slope is that of before and after. Of values that are "
        "all the same no interval is known (?): a drift may be below their resolution."
    )
    page.heading("About these figures")
    page.facts(recordings.facts)
    return page


def _foremost(found: SoakResult) -> list[FigureTrend]:
    """Return some figures of whole repetitions, or else of set-points; those that drift first."""
    whole = [one for one in found.trends if not one.of_point] or found.trends
    return sorted(whole, key=lambda one: not one.drifts)[:CARDS]


def _card(one: FigureTrend) -> tuple[str, str]:
    level = ", interval not known" if one.slope.half_width is None else ", 95 %"
    return f"{one.to_text()} {one.slope_unit}", f"slope of {one.title}{level}"


def rows(found: SoakResult) -> list[list[str]]:
    """Return a row for each figure."""
    return [
        [
            one.name, f"{one.mean:#.4g}".rstrip("."), one.unit, one.to_text(),
            "yes" if one.drifts else "no" if one.slope.p_value is not None else "?",
            plus_minus(one.step.value, one.step.half_width) if one.step else "",
        ]
        for one in found.trends
    ]  # fmt: skip


def over_time(found: SoakResult) -> Figure:
    """Return the figures of the repetitions over time, of one or more, one below the other."""
    whole = [one for one in found.trends if not one.of_point][:PANELS_MAX]
    shown = whole or [one for one in found.trends if one.of_point][:PANELS_MAX]
    with figure(1.0 + 1.5 * len(shown)) as picture:
        panels = picture.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, one in zip(panels, shown, strict=True):
            for part in found.trends:
                if part.of_point and part is not one and part.name.startswith(f"{one.name} of "):
                    axes.plot(part.hours, part.values, color=SOFT, linewidth=0.6, alpha=0.5)
            _draw(axes, one)
        panels[-1].set_xlabel("time since the first repetition (h)")
        return picture


def _draw(axes: Axes, one: FigureTrend) -> None:
    axes.plot(one.hours, one.values, ".", color=AFTER, markersize=5)
    rise = one.slope.value * one.hours
    if one.step is not None:
        rise[one.step.place :] += one.step.value
    line = one.mean + rise - rise.mean()
    style = "-" if one.drifts else (0, (4, 3))
    axes.plot(one.hours, line, color=AFTER, linestyle=style, linewidth=1.1)
    slope = typeset(f"{one.to_text()} {one.slope_unit}")
    axes.set_title(
        f"{one.title}: {slope}"
        + (", drifts" if one.drifts else "")
        + (", a step" if one.step else "")
    )
    axes.set_ylabel(typeset(one.unit))
    low, high = np.min(one.values), np.max(one.values)
    if low == high:
        axes.set_ylim(low - 1, high + 1)
