"""The page of a check: the verdict, and what changed with its interval and its limit."""

from motord.experiments.check_calibration.plots import changes
from motord.experiments.check_calibration.result import CalibrationCheck
from motord.experiments.subject import Recordings
from motord.report.html import Page


def report(found: CalibrationCheck, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Check of a calibration", recordings.subject.lead)
    page.cards([(found.verdict, f"calibration {found.calibration}")])
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
    page.table((), recordings.facts)
    return page
