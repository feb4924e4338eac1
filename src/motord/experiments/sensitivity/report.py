"""The report of a sensitivity analysis: theory, practice, and a calibration from known errors."""

from collections.abc import Sequence

import numpy as np

from motord.experiments.sensitivity.plots import SYMBOL, limit, slices, traces
from motord.experiments.sensitivity.result import Again, Sensitivity, Theory
from motord.experiments.subject import Recordings
from motord.report.html import Page
from motord.report.plots.gains import Gains, gains

POELS2008_INDUCED = np.array([0.8, 1.118, 1.118, 1.0, -0.5, -0.5])
POELS2008_FOUND = np.array([0.7717, 1.1035, 1.0884, 0.9994, -0.5078, -0.6205])
"""Poels 2008, Table 4.2."""

POELS2008_ERRORS = ("-3.5 %", "-1.3 %", "-2.6 %", "0.1 %", "1.6 %", "24.1 %")
"""By how much these are off, as printed there."""


def report(result: Sensitivity, _: Recordings) -> Page:
    """Return a page of its own."""
    subject = result.subject
    motor = subject.motor
    page = Page("Sensitivity to errors of a calibration", subject.lead)
    fill(page, result)
    page.heading("About these figures")
    rows = (
        ("bench", subject.bench),
        ("motor", f"{motor.name}, {motor.rated_torque_Nm:g} Nm rated, {motor.connection}"),
        ("recordings", ", ".join(result.runs) or "none"),
    )
    page.table((), rows)
    return page


def fill(page: Page, result: Sensitivity) -> None:
    """Add theory, practice and the second calibration, as far as there are any."""
    _theory(page, result.theory)
    if result.series:
        _practice(page, result)
    if result.again is not None:
        _again(page, result.again)


def _theory(page: Page, theory: Theory) -> None:
    page.heading("What errors of a calibration cost: theory")
    page.picture(
        slices(theory.volume, theory.limit_percent),
        f"RMS error of the torque at {theory.torque_Nm:g} Nm over errors of phase a's gain "
        "(\u03b1b = \u03b1c, product 1), of its offset (\u03b2b = \u03b2c, sum 0) and of the "
        "factor by which the cogging torque is compensated; each row holds one of the three at "
        f"both ends and in the middle. The black line is {theory.limit_percent:g} %. Poels 2008, "
        "Figure 4.3.",
    )
    page.picture(
        limit(theory.surface),
        f"The surface on which the RMS error is {theory.limit_percent:g} %: whatever lies inside "
        "is smoother. Poels 2008, Figure 4.4.",
    )
    rows = []
    for what, (low, high) in theory.within.items():
        ends = [f"{value:g}: {percent:.2f} %" for value, percent in theory.ends[what]]
        rows.append([SYMBOL[what], *ends, f"{_number(low)} to {_number(high)}"])
    header = ["error alone", "at one end", "at the other", f"at most {theory.limit_percent:g} %"]
    page.table(header, rows, numbers=True)


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "any"


def _practice(page: Page, result: Sensitivity) -> None:
    page.heading("What errors of a calibration cost: practice")
    place = f"{result.theory.torque_Nm:g} Nm and {result.speed_Hz:g} turns/s"
    page.picture(
        traces(result.series),
        f"RMS error measured at {place} after a calibration, with one error induced at a time; "
        "bars are 95 % intervals. Poels 2008, Figures 4.6 to 4.9. \u03b4\u03b5 is what the "
        "compensation takes it for, in parts of what it is: the currents, and with them the "
        "cogging torque that they cancel, are wrong by its inverse.",
    )
    worst_percent = max(one.worst_difference_percent for one in result.series)
    page.paragraph(
        f"Without any induced error {result.series[0].floor_percent:.2f} % remain, of which the "
        "theory knows nothing; added in quadrature to the theory they leave no measured point more "
        f"than {worst_percent:.2f} % off."
    )
    meetings = [
        f"{SYMBOL[one.what]} = {one.meeting[0]:.3f}"
        for one in result.series
        if one.meeting is not None and one.what != "delta_epsilon"  # its branches are curved
    ]
    page.table(
        ["branch", "points", "slope (% per unit)", "theory"],
        result.slope_rows(SYMBOL, ","),
        numbers=True,
    )
    if meetings:
        page.paragraph(
            f"The lines of the two branches meet at {', '.join(meetings)}. "
            "Where that is not the value of the calibration, another would be better at this "
            "one torque and speed: a cogging torque of many periods a turn is passed on a "
            "little weaker by currents that change in steps."
        )


def _again(page: Page, again: Again) -> None:
    found = again.found
    induced = Gains("induced", again.alpha, again.beta_A)
    identified = Gains(
        "found", found.alpha, found.beta_A, found.alpha_half_width, found.beta_half_width_A
    )
    page.heading("A calibration from known errors")
    page.picture(
        gains([identified], induced),
        "How far gains and offsets that a calibration finds are off those that were induced; bars "
        "are 95 % intervals. Poels 2008, Table 4.2.",
    )
    header = ["", "induced", "found", "off by", "costs (% RMS)"]
    if _as_poels2008(again):
        header += ["Poels 2008", "off by"]
    page.table(header, _rows(again), numbers=True)
    page.paragraph(
        "The errors were induced on currents whose own errors were compensated. A sensor with "
        "these errors, which reads the wanted currents while the wrong ones flow, stands in for "
        "the real one; the joint estimator was then given its readings and the measured torque."
    )


def _as_poels2008(again: Again) -> bool:
    """Return whether the errors are those of Poels 2008, Table 4.2."""
    induced = np.concatenate([again.alpha, again.beta_A])
    return bool(np.allclose(induced, POELS2008_INDUCED, atol=1e-3))


def _rows(again: Again) -> Sequence[Sequence[str]]:
    rows = []
    names = [f"\u03b1 {p}" for p in "abc"] + [f"\u03b2 {p} (A)" for p in "abc"]
    induced = np.concatenate([again.alpha, again.beta_A])
    found = np.concatenate([again.found.alpha, again.found.beta_A])
    for n, name in enumerate(names):
        off = found[n] - induced[n]
        change = f"{100 * off / induced[n]:+.2f} %" if n < 3 else f"{off:+.4f} A"
        row = [name, f"{induced[n]:.4f}", f"{found[n]:.4f}", change, f"{again.cost_percent[n]:.3f}"]
        if _as_poels2008(again):
            row += [f"{POELS2008_FOUND[n]:.4f}", POELS2008_ERRORS[n]]
        rows.append(row)
    return rows
