"""The report of a cogging run: spectrum, cogging torque, error of each speed, a calibration's."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.cogging.at_speed import SpeedCogging
from motord.experiments.cogging.result import Comparison, MeanHarmonic, MeasuredCogging, SpeedResult
from motord.experiments.driven_rotor import left_out_lines
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus, significant, two_digits
from motord.report.html import Page
from motord.report.style import AFTER, BEFORE, GRID, REFERENCE, figure, steps

PERIODS_SHOWN = 6
"""Periods of the main order in the close view."""

CURVE_POINTS = 4096
"""Points of a curve at most."""


def report(measured: MeasuredCogging, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Cogging torque of a driven rotor", recordings.subject.lead)
    figures = [
        (f"{one.cells[1]} mNm", f"order {one.order}, the main one, 95 %")
        for one in measured.harmonics
        if one.order == measured.main_order
    ]
    whole_Nm, half_Nm = measured.peak_to_peak_Nm
    whole = plus_minus(1e3 * whole_Nm, 1e3 * half_Nm)
    page.cards([*figures, (f"{whole} mNm", "peak to peak over a turn, 95 %")])
    page.facts(recordings.facts)
    fill(page, measured)
    return page


def fill(page: Page, measured: MeasuredCogging) -> None:
    """Add the cogging run to a page."""
    speeds = measured.speed_results
    slots, poles = measured.motor.slots, measured.motor.poles
    page.heading("Cogging torque, measured by driving the rotor")
    page.paragraph(
        f"{slots} slots and {poles} poles have their main order at {measured.main_order} per "
        "turn, Q 2p / HCF(Q, 2p) (Poels 2008, eq. (3.1)). A slot out of place adds multiples of "
        f"{poles}, a magnet out of place multiples of {slots}."
    )
    page.picture(
        spectra(
            [(_at(s.measured), np.abs(s.measured.spectrum_Nm)) for s in speeds], _allowed(measured)
        ),
        "Amplitude (Nm) at each order of the turn, at each speed, freed of the sensor's response "
        "(Poels 2008, Figure 3.2). Marked: the orders that slots and poles allow. Between them is "
        "noise, but for the orders that the table has from neither.",
    )
    page.picture(
        averaged(measured.tau_cog_Nm, measured.main_order),
        "Cogging torque (Nm) over a turn, averaged over the speeds (Poels 2008, Figure 3.3), and "
        "a part of it.",
    )
    _harmonics(page, measured)
    page.picture(
        errors([(_at(s.measured), s.error_percent) for s in speeds], _span_deg(measured)),
        "Cogging torque at each speed less the average, in percent of the average's peak, over "
        "the part of the turn within which it repeats (Poels 2008, Figure 3.4, where it is up to "
        "2.5 %).",
    )
    _speeds(page, speeds)
    if measured.left_out:
        page.points([f"{line[0].upper()}{line[1:]}." for line in left_out_lines(measured.left_out)])
    if measured.directions:
        _directions(page, measured)
    if measured.comparison is not None:
        _comparison(page, measured, measured.comparison)


def _at(speed: SpeedCogging) -> str:
    return f"{speed.direction * speed.speed_Hz:.2g} turns/s"


def _span_deg(measured: MeasuredCogging) -> float:
    """Return two of the parts of a turn that are all alike, the whole turn at most."""
    return 360.0 * min(2 / math.gcd(*_allowed(measured)), 1.0)


def _allowed(measured: MeasuredCogging) -> tuple[int, ...]:
    return tuple(h.order for h in measured.harmonics if h.allowed)


def _harmonics(page: Page, measured: MeasuredCogging) -> None:
    page.table(
        ["order", "amplitude (mNm)", "phase (rad)", "from"],
        [[*h.cells, _origin(h, measured)] for h in measured.harmonics],
        numbers=True,
    )


def _speeds(page: Page, speeds: Sequence[SpeedResult]) -> None:
    page.table(
        ["speed (turns/s)", "turns", "speed ripple (%)", "angle", "largest error (%)"],
        [
            [
                f"{s.measured.direction * s.measured.speed_Hz:+.4f}",
                str(s.measured.turns),
                f"{s.speed_ripple_percent:.1f}",
                "as counted" if s.measured.jerky else "smooth motion",
                f"{s.worst_error_percent:.2f}",
            ]
            for s in speeds
        ],
        numbers=True,
    )


def _directions(page: Page, measured: MeasuredCogging) -> None:
    page.subheading("Both directions")
    page.paragraph(
        "Cogging torque is the same in both directions; what differs turns its sign with the "
        "direction: half of it is ripple of friction, or hysteresis."
    )
    page.table(
        [
            "order",
            "forwards (mNm)",
            "backwards (mNm)",
            "phase (rad)",
            "differ by (mNm)",
            "by chance",
        ],
        [
            [
                str(one.order),
                significant(1e3 * one.forward_Nm, 4),
                significant(1e3 * one.backward_Nm, 4),
                f"{one.phase_rad:+.4f}",
                two_digits(1e3 * one.difference_Nm),
                f"{'beyond ' if one.significant else 'up to '}{two_digits(1e3 * one.limit_Nm)}",
            ]
            for one in measured.directions
        ],
        numbers=True,
    )


def _origin(harmonic: MeanHarmonic, measured: MeasuredCogging) -> str:
    if not harmonic.allowed:
        return "neither slots nor poles"
    if harmonic.order % measured.main_order == 0:
        return "slots and poles"
    slot = harmonic.order % measured.motor.poles == 0
    return "slot out of place" if slot else "magnet out of place"


def _comparison(page: Page, measured: MeasuredCogging, other: Comparison) -> None:
    page.heading("Cogging torque as calibrated and as measured")
    page.picture(
        with_calibration(
            measured.tau_cog_Nm, other.tau_cog_Nm, other.error_percent, _span_deg(measured)
        ),
        f"Cogging torque of {other.label} less the measured one, in percent of the measured peak "
        "(Poels 2008, Figure 4.5).",
    )
    rows = [["in time (% of peak)", f"{other.worst_percent:.2f}", "8"]]
    if other.order.size:
        magnitude, points = np.abs(other.magnitude_percent), np.abs(other.phase_points)
        rows += [
            ["magnitude of a harmonic (%)", f"{magnitude.max():.2f}", "0.5"],
            ["phase of a harmonic (encoder points)", f"{points.max():.3f}", "0.5"],
        ]
    page.table(["largest difference", "here", "Poels 2008"], rows, numbers=True)
    page.table(
        ["order", "magnitude (%)", "phase (encoder points)"],
        [
            [str(int(order)), f"{m:+.3f}", f"{p:+.3f}"]
            for order, m, p in zip(
                other.order, other.magnitude_percent, other.phase_points, strict=True
            )
        ],
        numbers=True,
    )


def spectra(speeds: Sequence[tuple[str, np.ndarray]], allowed: Sequence[int]) -> Figure:
    """Return amplitudes (Nm) of orders 1 to m of each speed, (label, (m,)), allowed ones marked."""
    with figure(3.4) as picture:
        axes = picture.subplots()
        highest = max(amplitude.size for _, amplitude in speeds)
        for marked in allowed:
            axes.axvline(marked, color=GRID, linewidth=4.0, zorder=0)
        for (label, amplitude), colour in zip(speeds, steps(len(speeds)), strict=True):
            order = np.arange(1, amplitude.size + 1)
            axes.plot(order, amplitude, color=colour, linewidth=0.9, label=label)
        axes.set(yscale="log", xlim=(0, highest))
        axes.grid(visible=False, axis="x")
        axes.set(xlabel="order (per turn)", ylabel="amplitude (Nm)")
        _speeds_legend(picture, axes)
        return picture


def averaged(tau_cog_Nm: np.ndarray, main_order: int) -> Figure:
    """Return the cogging torque (counts,) over a turn and over some periods of the main order."""
    with figure(3.0) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.6, 1.0], sharey=True)
        degrees, torque_Nm = _closed(tau_cog_Nm)
        for axes in (left, right):
            axes.plot(degrees, torque_Nm, color=AFTER, linewidth=1.1)
            axes.set_xlabel("mechanical angle (degrees)")
        left.set(xlim=(0, 360), xticks=range(0, 361, 60))
        right.set_xlim(0, 360 * min(PERIODS_SHOWN / main_order, 1.0))
        left.set_ylabel("cogging torque (Nm)")
        return picture


def errors(speeds: Sequence[tuple[str, np.ndarray]], span_deg: float) -> Figure:
    """Return errors in percent of the peak (counts,) over `span_deg`, one line a speed."""
    with figure(3.0) as picture:
        axes = picture.subplots()
        for (label, error), colour in zip(speeds, steps(len(speeds)), strict=True):
            degrees, percent = _closed(error)
            axes.plot(degrees, percent, color=colour, linewidth=0.9, label=label)
        _over_span(axes, span_deg, "error (% of peak)")
        _speeds_legend(picture, axes)
        return picture


def with_calibration(
    measured_Nm: np.ndarray, calibrated_Nm: np.ndarray, error_percent: np.ndarray, span_deg: float
) -> Figure:
    """Return both torques and their difference (counts,) over `span_deg`."""
    with figure(3.0) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.0, 1.3])
        degrees, torque_Nm = _closed(measured_Nm)
        left.plot(degrees, torque_Nm, color=REFERENCE, linewidth=2.2, label="measured")
        degrees, torque_Nm = _closed(calibrated_Nm)
        left.plot(
            degrees, torque_Nm, color=AFTER, linewidth=1.4, linestyle=(0, (3, 2)),
            label="calibrated",
        )  # fmt: skip
        _over_span(left, span_deg, "cogging torque (Nm)")
        degrees, percent = _closed(error_percent)
        right.plot(degrees, percent, color=BEFORE, linewidth=0.9)
        _over_span(right, span_deg, "difference (% of peak)")
        picture.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return picture


def _over_span(axes: Axes, span_deg: float, label: str) -> None:
    axes.set(xlim=(0, span_deg), xlabel="mechanical angle (degrees)", ylabel=label)


def _closed(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return degrees and values over a whole turn, with no more points than can be seen."""
    step = max(turn.size // CURVE_POINTS, 1)
    values = np.append(turn[::step], turn[0])
    degrees = np.append(360.0 * np.arange(0, turn.size, step) / turn.size, 360.0)
    return degrees, values


def _speeds_legend(picture: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside upper right", ncols=min(len(labels), 8))
