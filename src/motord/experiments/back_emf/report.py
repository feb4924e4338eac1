"""The report of a back-EMF run: waves over the electrical period, harmonics."""

import numpy as np

from motord.experiments.back_emf.plots import waves
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.driven_findings import left_out_lines
from motord.experiments.subject import Recordings
from motord.intervals import coverage_factor, plus_minus
from motord.report.html import Page

HEADER = ("order", "amplitude (mV s/rad)", "% of fundamental", "phase (rad)")


def report(found: MeasuredBackEmf, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Back-EMF of a driven rotor", recordings.subject.lead)
    page.table([], recordings.facts)
    fill(page, found)
    return page


def fill(page: Page, found: MeasuredBackEmf) -> None:
    """Add the back-EMF run to a page."""
    page.heading("Back-EMF, measured by driving the rotor")
    measured, configured = found.table(), found.motor.back_emf_table()
    page.picture(
        waves(measured, found),
        "Back-EMF over speed (V s/rad) of the three phases over the first electrical period, and "
        "the amplitude of each electrical order in percent of the fundamental, with 95 % limits "
        "of noise. Dashed: what the bench file says.",
    )
    page.table(HEADER, rows(found), numbers=True)
    apart = np.abs(measured - configured).max() / found.fundamental
    items = [f"Largest difference from the bench file: {100 * apart:.2f} % of the fundamental."]
    if age_us := found.delay_us:
        items.append(
            f"The voltages are {age_us} \u00b5s older than the recording says (accounted for)."
        )
    items += [f"{line[0].upper()}{line[1:]}." for line in left_out_lines(found.left_out)]
    page.points(items)


def rows(found: MeasuredBackEmf) -> list[list[str]]:
    """Return the harmonics of the table as rows under HEADER."""
    return [
        [
            str(h.order),
            plus_minus(
                1e3 * h.amplitude_V_s_per_rad,
                1e3 * coverage_factor(h.degrees_of_freedom) * h.stderr_V_s_per_rad,
            ),
            f"{100 * h.amplitude_V_s_per_rad / found.fundamental:.3f}",
            plus_minus(
                h.phase_rad, coverage_factor(h.phase_degrees_of_freedom) * h.phase_stderr_rad
            ),
        ]
        for h in found.harmonics
        if h.in_table
    ]
