"""The page of a check: the verdict, and what changed with its interval, in parts of its limit."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.check_calibration.result import CalibrationCheck, Change
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus, two_digits
from motord.report.html import Page
from motord.report.style import AFTER, BEFORE, SOFT, figure

ROW_IN = 0.24
"""Height of a row of the picture."""


def report(found: CalibrationCheck, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Check of a calibration", recordings.subject.lead)
    page.cards([(found.verdict, f"calibration {found.calibration}"), *_nearest(found.changes)])
    page.paragraph(found.sentence[:1].upper() + found.sentence[1:] + ".")
    page.heading("What changed since the calibration")
    page.picture(
        changes(found.changes),
        "Each change in parts of its limit, with its 95 % interval. Beyond the limits (dashed) it "
        "is no chance: noise alone passes any of them in 0.5 % of checks. Gains and offsets of the "
        "phases are against the two others: where one drifts, these mirror half of it.",
    )
    page.table(
        ["95 % intervals", "change", "limit", "found in 95 %", "unit", ""],
        found.rows(),
        numbers=True,
    )
    page.points([f"Not tested: {what}; these turns do not show it." for what in found.unseen])
    page.heading("About these figures")
    page.paragraph(
        f"{sum(found.turns)} whole turns of {len(found.turns)} operating points. Left at the "
        f"orders of the model: {found.misfit:.2g} times what noise and the model's accuracy are "
        "expected to leave there, mean square."
    )
    page.facts(recordings.facts)
    return page


def _nearest(found: Sequence[Change]) -> list[tuple[str, str]]:
    """Return the change that is nearest to its limit, or furthest beyond, as a key figure."""
    ranked = sorted(found, key=lambda one: -abs(one.value) / one.limit)
    return [
        (
            f"{plus_minus(one.value, one.half_width)} {one.unit}",
            f"largest change for its limit, {two_digits(one.limit)} {one.unit}: "
            f"{one.meaning}, 95 %",
        )
        for one in ranked[:1]
    ]


def changes(found: Sequence[Change]) -> Figure:
    """Return the changes, one a row; those that are drift in another colour."""
    with figure(1.0 + ROW_IN * len(found)) as picture:
        axes = picture.subplots()
        for kind, colour in ((False, AFTER), (True, BEFORE)):
            rows = [(n, one) for n, one in enumerate(found) if one.drifted == kind]
            axes.errorbar(
                [one.value / one.limit for _, one in rows],
                [n for n, _ in rows],
                xerr=[one.half_width / one.limit for _, one in rows],
                fmt="o", color=colour, markersize=5, capsize=3, elinewidth=1.4,
            )  # fmt: skip
        for limit in (-1.0, 1.0):
            axes.axvline(limit, color=SOFT, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.axvline(0.0, color=SOFT, linewidth=0.8)
        axes.set_yticks(np.arange(len(found)), [one.name for one in found])
        axes.set_ylim(len(found) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("change in parts of its limit")
        return picture
