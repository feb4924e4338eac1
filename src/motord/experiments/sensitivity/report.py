"""The report of a sensitivity analysis: theory, practice, and a calibration from known errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.experiments.sensitivity.plots import Trace, traces
from motord.experiments.sensitivity.plots_volume import Limit, Slices, limit, slices
from motord.report.html import Page
from motord.report.plots.gains import Gains, gains


@dataclass(frozen=True)
class BranchRow:
    """A fitted branch in words and numbers, slopes in percent per unit of the error."""

    what: str
    points: int
    slope: float
    slope_stderr: float
    theory_slope: float


@dataclass(frozen=True)
class Recalibration:
    """Errors that were induced, and what a calibration found; costs in percent RMS (6,).

    report_found (6,): alpha and beta that Poels 2008, Table 4.2, found for the same errors; None
    if others were induced.
    """

    induced: Gains
    found: Gains
    cost_percent: np.ndarray
    report_found: np.ndarray | None


@dataclass(frozen=True)
class SensitivityReport:
    """All that goes into the page.

    ends: (error, value, RMS error in percent) at the ends of the intervals; within: (error, from,
    to) that alone stay within limit_percent. speed_Hz: of the measured points.
    """

    title: str
    lead: str
    facts: tuple[tuple[str, str], ...]
    torque_Nm: float
    speed_Hz: float
    limit_percent: float
    ends: tuple[tuple[str, float, float], ...]
    within: tuple[tuple[str, float, float], ...]
    volume: Slices
    surface: Limit
    traces: tuple[Trace, ...] = ()
    branches: tuple[BranchRow, ...] = ()
    meetings: tuple[tuple[str, float, float], ...] = ()
    floor_percent: float | None = None
    worst_difference_percent: float | None = None
    again: Recalibration | None = None


def page(data: SensitivityReport) -> Page:
    """Return a page of its own."""
    made = Page(data.title, data.lead)
    fill(made, data)
    made.heading("About these figures")
    made.table((), data.facts)
    return made


def fill(page: Page, data: SensitivityReport) -> None:
    """Add theory, practice and the second calibration, as far as there are any."""
    _theory(page, data)
    if data.traces:
        _practice(page, data)
    if data.again is not None:
        _again(page, data.again)


def _theory(page: Page, data: SensitivityReport) -> None:
    page.heading("What errors of a calibration cost: theory")
    page.picture(
        slices(data.volume),
        f"RMS error of the torque at {data.torque_Nm:g} Nm over errors of phase a's gain "
        "(\u03b1b = \u03b1c, product 1), of its offset (\u03b2b = \u03b2c, sum 0) and of the "
        "factor by which the cogging torque is compensated; each row holds one of the three at "
        f"both ends and in the middle. The black line is {data.limit_percent:g} %. Poels 2008, "
        "Figure 4.3.",
    )
    page.picture(
        limit(data.surface),
        f"The surface on which the RMS error is {data.limit_percent:g} %: whatever lies inside "
        "is smoother. Poels 2008, Figure 4.4.",
    )
    rows = []
    for what, low, high in data.within:
        ends = [f"{value:g}: {percent:.2f} %" for name, value, percent in data.ends if name == what]
        rows.append([what, *ends, f"{_number(low)} to {_number(high)}"])
    header = ["error alone", "at one end", "at the other", f"at most {data.limit_percent:g} %"]
    page.table(header, rows, numbers=True)


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "any"


def _practice(page: Page, data: SensitivityReport) -> None:
    page.heading("What errors of a calibration cost: practice")
    page.picture(
        traces(data.traces),
        f"RMS error measured at {data.torque_Nm:g} Nm and {data.speed_Hz:g} turns/s after a "
        "calibration, with one error induced at a time; bars are 95 % intervals. Poels 2008, "
        "Figures 4.6 to 4.9. \u03b4\u03b5 is what the compensation takes it for, in parts of what "
        "it is: the currents, and with them the cogging torque that they cancel, are wrong by its "
        "inverse.",
    )
    if data.floor_percent is not None and data.worst_difference_percent is not None:
        page.paragraph(
            f"Without any induced error {data.floor_percent:.2f} % remain, of which the theory "
            "knows nothing; added in quadrature to the theory they leave no measured point more "
            f"than {data.worst_difference_percent:.2f} % off."
        )
    rows = [
        [
            row.what,
            str(row.points),
            f"{row.slope:.2f} \u00b1 {1.96 * row.slope_stderr:.2f}",
            f"{row.theory_slope:.2f}",
        ]
        for row in data.branches
    ]
    page.table(["branch", "points", "slope (% per unit)", "theory"], rows, numbers=True)
    if data.meetings:
        page.paragraph(
            "The lines of the two branches meet at "
            + ", ".join(f"{what} = {value:.3f}" for what, value, _ in data.meetings)
            + ". Where that is not the value of the calibration, another would be better at this "
            "one torque and speed: a cogging torque of many periods a turn is passed on a "
            "little weaker by currents that change in steps."
        )


REPORT_NUMBERS = ("-3.5 %", "-1.3 %", "-2.6 %", "0.1 %", "1.6 %", "24.1 %")


def _again(page: Page, again: Recalibration) -> None:
    page.heading("A calibration from known errors")
    page.picture(
        gains([again.found], again.induced),
        "How far gains and offsets that a calibration finds are off those that were induced; bars "
        "are 95 % intervals. Poels 2008, Table 4.2.",
    )
    header = ["", "induced", "found", "off by", "costs (% RMS)"]
    if again.report_found is not None:
        header += ["Poels 2008", "off by"]
    page.table(header, _rows(again), numbers=True)
    page.paragraph(
        "The errors were induced on currents whose own errors were compensated. A sensor with "
        "these errors, which reads the wanted currents while the wrong ones flow, stands in for "
        "the real one; the joint estimator was then given its readings and the measured torque."
    )


def _rows(again: Recalibration) -> Sequence[Sequence[str]]:
    rows = []
    names = [f"\u03b1 {p}" for p in "abc"] + [f"\u03b2 {p} (A)" for p in "abc"]
    induced = np.concatenate([again.induced.alpha, again.induced.beta_A])
    found = np.concatenate([again.found.alpha, again.found.beta_A])
    for n, name in enumerate(names):
        off = found[n] - induced[n]
        said = f"{100 * off / induced[n]:+.2f} %" if n < 3 else f"{off:+.4f} A"
        row = [name, f"{induced[n]:.4f}", f"{found[n]:.4f}", said, f"{again.cost_percent[n]:.3f}"]
        if again.report_found is not None:
            row += [f"{again.report_found[n]:.4f}", REPORT_NUMBERS[n]]
        rows.append(row)
    return rows
