"""The report of a back-EMF run: waves over the electrical period, harmonics."""

from dataclasses import dataclass

import numpy as np

from motord.experiments.back_emf.plots import waves
from motord.report.html import Page


@dataclass(frozen=True)
class BackEmfRow:
    """An electrical order of the phases' mean, its standard error, and whether it is kept."""

    order: int
    amplitude_V_s_per_rad: float
    phase_rad: float
    stderr_V_s_per_rad: float
    in_table: bool


@dataclass(frozen=True)
class BackEmfReport:
    """All that goes into the page.

    k_V_s_per_rad (counts, 3): measured; told_V_s_per_rad (counts, 3): what the bench file says.
    delay_s: age of the voltages beyond the recorded, and its standard error.
    """

    title: str
    lead: str
    facts: tuple[tuple[str, str], ...]
    pole_pairs: int
    k_V_s_per_rad: np.ndarray
    told_V_s_per_rad: np.ndarray
    harmonics: tuple[BackEmfRow, ...]
    delay_s: tuple[float, float] | None
    notes: tuple[str, ...]


def fill(page: Page, data: BackEmfReport) -> None:
    """Add the back-EMF run to a page."""
    page.heading("Back-EMF, measured by driving the rotor")
    fundamental = data.harmonics[0].amplitude_V_s_per_rad
    page.picture(
        waves(
            data.k_V_s_per_rad,
            data.told_V_s_per_rad,
            data.pole_pairs,
            [(h.order, h.amplitude_V_s_per_rad, h.stderr_V_s_per_rad) for h in data.harmonics],
        ),
        "Back-EMF over speed (V s/rad) of the three phases over the first electrical period, and "
        "the amplitude of each electrical order in percent of the fundamental, with 95 % limits "
        "of noise. Dashed: what the bench file says.",
    )
    page.table(
        ["order", "amplitude (mV s/rad)", "% of fundamental", "phase (rad)"],
        [
            [
                str(h.order),
                f"{1e3 * h.amplitude_V_s_per_rad:.3f} \u00b1 {1.96e3 * h.stderr_V_s_per_rad:.3f}",
                f"{100 * h.amplitude_V_s_per_rad / fundamental:.3f}",
                f"{h.phase_rad:.4f}",
            ]
            for h in data.harmonics
            if h.in_table
        ],
        numbers=True,
    )
    apart = np.abs(data.k_V_s_per_rad - data.told_V_s_per_rad).max() / fundamental
    items = [f"Largest difference from the bench file: {100 * apart:.2f} % of the fundamental."]
    if data.delay_s is not None:
        items.append(
            f"The voltages are {1e6 * data.delay_s[0]:.0f} \u00b1 {1.96e6 * data.delay_s[1]:.0f} "
            "\u00b5s older than the recording says (accounted for)."
        )
    page.points([*items, *data.notes])


def page(data: BackEmfReport) -> Page:
    """Return a page of its own."""
    made = Page(data.title, data.lead)
    made.table([], data.facts)
    fill(made, data)
    return made
