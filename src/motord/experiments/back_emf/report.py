"""The report of a back-EMF run: waves over the electrical period, harmonics."""

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.back_emf.result import ElectricalHarmonic, MeasuredBackEmf
from motord.experiments.driven_rotor import left_out_lines
from motord.experiments.subject import Recordings
from motord.intervals import coverage_factor, plus_minus
from motord.report.html import Page
from motord.report.style import AFTER, INK, OTHER, REFERENCE, SOFT, figure

HEADER = ("order", "amplitude (mV s/rad)", "% of fundamental", "phase (rad)")

PHASES = ((AFTER, "a"), (OTHER, "b"), (REFERENCE, "c"))


def report(found: MeasuredBackEmf, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Back-EMF of a driven rotor", recordings.subject.lead)
    fundamental = f"{_amplitude(found.harmonics[0])} mV s/rad"
    page.cards([(fundamental, "fundamental of a phase, peak, 95 %")])
    page.facts(recordings.facts)
    fill(page, found)
    return page


def fill(page: Page, found: MeasuredBackEmf) -> None:
    """Add the back-EMF run to a page."""
    page.heading("Back-EMF, measured by driving the rotor")
    measured, configured = found.table(), found.motor.back_emf_table()
    page.picture(
        waves(measured, found),
        "Back-EMF over speed (V s/rad) of the three phases over the first electrical period, and "
        "the amplitude of each electrical order in percent of the fundamental, with half of its "
        "95 % interval. Dashed: what the bench file says.",
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
            _amplitude(h),
            f"{100 * h.amplitude_V_s_per_rad / found.fundamental:.3f}",
            plus_minus(
                h.phase_rad, coverage_factor(h.phase_degrees_of_freedom) * h.phase_stderr_rad
            ),
        ]
        for h in found.harmonics
        if h.in_table
    ]


def _amplitude(harmonic: ElectricalHarmonic) -> str:
    half_width = coverage_factor(harmonic.degrees_of_freedom) * harmonic.stderr_V_s_per_rad
    return plus_minus(1e3 * harmonic.amplitude_V_s_per_rad, 1e3 * half_width)


def waves(measured: np.ndarray, found: MeasuredBackEmf) -> Figure:
    """Return the table k (counts, 3) over a period, and the harmonics as bars."""
    configured, pole_pairs = found.motor.back_emf_table(), found.motor.pole_pairs
    with figure(3.2) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.2, 1.0])
        counts = measured.shape[0]
        shown = min(-(-counts // pole_pairs) + 1, counts)
        degrees = 360.0 * pole_pairs * np.arange(shown) / counts
        for phase, (colour, name) in enumerate(PHASES):
            k = measured[:shown, phase]
            left.plot(degrees, k, color=colour, label=f"phase {name}", linewidth=1.8)
            left.plot(
                degrees, configured[:shown, phase], color=INK, linewidth=0.8, linestyle=(0, (4, 3))
            )
        left.set(xlim=(0, 360), xticks=range(0, 361, 60))
        left.set_xlabel("electrical angle from the zero point (degrees)")
        left.set_ylabel("back-EMF over speed (V s/rad)")
        picture.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        harmonics = found.harmonics
        fundamental = harmonics[0].amplitude_V_s_per_rad
        order = [h.order for h in harmonics]
        percent = 100 * np.array([h.amplitude_V_s_per_rad for h in harmonics]) / fundamental
        half_width = np.array(
            [coverage_factor(h.degrees_of_freedom) * h.stderr_V_s_per_rad for h in harmonics]
        )
        half_width *= 100 / fundamental
        right.bar(order, percent, 0.7, color=AFTER)
        right.plot(order, half_width, color=SOFT, linewidth=1.2, label="half of the 95 % interval")
        right.set(yscale="log", xlabel="electrical order", ylabel="amplitude (% of fundamental)")
        right.grid(visible=False, axis="x")
        right.legend(loc="upper right")
        return picture
