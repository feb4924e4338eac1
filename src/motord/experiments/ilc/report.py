"""The report of learning: ripple over the mesh before and after, and pass by pass."""

from dataclasses import dataclass

from motord.experiments.ilc.plots import convergence, corrections
from motord.report.html import Page
from motord.report.plots.mesh import Point, rms_error


@dataclass(frozen=True)
class LearnReport:
    """All that goes into the page.

    panels: title and RMS error in percent by (torque_Nm, speed_Hz), of one torque, in the order in
    which they came about, such as without compensation, calibrated, learned. passes: RMS error of
    every pass by point, the first with the calibration alone. correction_Nm: by point, its
    harmonics as (order, amplitude) each. torque_meaning: which torque the errors are of.
    """

    title: str
    lead: str
    panels: tuple[tuple[str, dict[Point, float]], ...]
    passes: dict[Point, tuple[float, ...]]
    correction_Nm: dict[Point, tuple[tuple[int, float], ...]]
    torque_meaning: str = "measured torque, freed of noise and of what sampling folds into it,"


def page(data: LearnReport) -> Page:
    """Return a page of its own."""
    made = Page(data.title, data.lead)
    fill(made, data)
    return made


def fill(page: Page, data: LearnReport) -> None:
    """Add headings and pictures to a page."""
    page.heading("Learning what the calibration leaves")
    page.picture(
        rms_error(data.panels),
        f"RMS error of the {data.torque_meaning}, Poels 2008, eq. (4.16), in percent of rated "
        "torque at each operating point. One scale for all; the line in it marks 1 %.",
    )
    page.picture(
        convergence(data.passes),
        f"RMS error of the {data.torque_meaning} in each pass, one line an operating point. The "
        "first pass has the calibration alone; each of the others has what those before it "
        "taught. A point that gains no more keeps its best correction. Lines at 1 and at 0.2 %.",
    )
    page.picture(
        corrections(data.correction_Nm),
        "Amplitude of the corrections at each order of the turn: dots are operating points, "
        "coloured by torque. Errors of the current sensors make torque at multiples of the pole "
        "pairs.",
    )
    page.table(["", *_headings(data)], _rows(data), numbers=True)


def _headings(data: LearnReport) -> list[str]:
    return [f"{title} (%)" for title, _ in data.panels]


def _rows(data: LearnReport) -> list[list[str]]:
    """Return mean and worst of each panel."""
    rows = [["mean"], ["worst"]]
    for _, values in data.panels:
        errors = list(values.values())
        rows[0].append(f"{sum(errors) / len(errors):.3f}")
        rows[1].append(f"{max(errors):.3f}")
    return rows
