"""The report of learning: ripple over the mesh before and after, and pass by pass."""

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from motord.calibration import TorqueSpeed
from motord.experiments.ilc.analysis import LearnPass
from motord.experiments.ilc.order_list import in_lines
from motord.experiments.subject import Recordings
from motord.identification.point_ripple import PointRipple, rms_errors
from motord.learned import LearnedPoint
from motord.report.html import Page
from motord.report.plots.mesh import rms_error
from motord.report.style import INK, SOFT, figure, steps
from motord.report.text import largest_interval, with_interval

PASS_NUMBERS = 15
"""So many numbers of passes have room below a picture."""

LEAST_PERCENT = 0.02
"""Smallest error that is drawn: less cannot be separated from none."""


def report(done: LearnPass, _: Recordings | None = None) -> Page:
    """Return the page of a pass."""
    calibration = done.calibration
    lead = f"{calibration.motor.name}, calibration {calibration.id}"
    made = Page("Learning of torque ripple", lead)
    made.cards(_key_figures(done.ripples))
    fill(made, done)
    return made


def _key_figures(ripples: Sequence[PointRipple]) -> list[tuple[str, str]]:
    """Return mean and largest RMS error of the pass, with the intervals that noise makes."""
    errors = rms_errors(ripples)
    if (found := errors.after) is None:
        return []
    mean = with_interval(found.mean, found.mean_half_width, " %")
    largest = with_interval(found.max, found.max_half_width, " %")
    worst = next(one for one in errors.points if one.after == found.max)
    where = f"{worst.torque_Nm:g} Nm, {worst.speed_Hz:g} Hz"
    return [
        (mean, "mean RMS error of this pass, 95 % by noise"),
        (largest, f"the largest, at {where}, 95 % by noise"),
    ]


def fill(page: Page, done: LearnPass, truth: Sequence[Mapping[TorqueSpeed, float]] = ()) -> None:
    """Add headings and pictures to a page.

    truth: RMS error of the true torque in percent in every pass, the first with the calibration
    alone; by default the errors are those that the passes measured.
    """
    meaning = "measured torque, without noise and aliases," if not truth else "true torque"
    learned = {
        place: point for place, point in done.learned.by_place.items() if point.history_percent
    }
    passes = {place: point.history_percent for place, point in learned.items()}
    if truth:
        passes = {place: tuple(errors[place] for errors in truth) for place in truth[0]}
    panels = _panels(done, passes, measured=not truth)
    intervals = largest_interval(done.half_width_percent.values())
    page.heading("Learning the residual torque ripple")
    page.picture(
        rms_error(panels),
        f"RMS error of the {meaning.removesuffix(',')}, Poels 2008, eq. (4.16), in percent of "
        "rated torque at each operating point. One scale for all; the line in it marks 1 %."
        + (f" Of this pass, by noise, {intervals}" if not truth else ""),
    )
    page.picture(
        convergence(passes),
        f"RMS error of the {meaning} in each pass, one line an operating point. The "
        "first pass has the calibration alone; each of the others has what was learned in those "
        "before it. A point that gains no more keeps its best correction. Lines at 1 and at 0.2 %; "
        f"what is less than {LEAST_PERCENT:g} % stands there.",
    )
    page.picture(
        corrections(done.learned.orders, learned),
        "Amplitude of the corrections at each order of the turn: dots are operating points, "
        "coloured by torque. Errors of the current sensors make torque at multiples of the pole "
        "pairs; other orders are there because the torque shows them.",
    )
    page.points([*done.reach, *in_lines(done.unreached)])
    page.table(
        ["", *(f"{title} (%)" for title, _ in panels)], _mean_and_worst(panels), numbers=True
    )


def _mean_and_worst(panels: Sequence[tuple[str, Mapping[TorqueSpeed, float]]]) -> list[list[str]]:
    """Return the rows of mean and largest RMS error, percent."""
    return [
        ["mean", *(f"{sum(errors.values()) / len(errors):.3f}" for _, errors in panels)],
        ["worst", *(f"{max(errors.values()):.3f}" for _, errors in panels)],
    ]


def _panels(
    done: LearnPass, passes: Mapping[TorqueSpeed, Sequence[float]], *, measured: bool
) -> list[tuple[str, dict[TorqueSpeed, float]]]:
    """Return title and RMS errors without compensation, calibrated and learned, where known."""
    panels = [
        ("Calibrated", {place: errors[0] for place, errors in passes.items()}),
        ("Learned", {place: errors[-1] for place, errors in passes.items()}),
    ]
    points = done.calibration.rms_error_percent.points
    before = {(p.torque_Nm, p.speed_Hz): p.before for p in points if p.before is not None}
    return [("Without compensation", before), *panels] if measured and before else panels


def _colours(points: Sequence[TorqueSpeed]) -> dict[float, str]:
    torques_Nm = sorted({torque_Nm for torque_Nm, _ in points})
    return dict(zip(torques_Nm, steps(len(torques_Nm)), strict=True))


def _legend(picture: Figure, axes: Axes, colours: Mapping[float, str]) -> None:
    for torque_Nm, colour in colours.items():
        axes.plot([], [], color=colour, marker="o", markersize=4, label=f"{torque_Nm:g} Nm")
    picture.legend(loc="outside upper right", ncols=min(len(colours), 8))


def convergence(passes: Mapping[TorqueSpeed, Sequence[float]]) -> Figure:
    """Return RMS errors (percent) over the number of the pass, one line a point."""
    colours = _colours(list(passes))
    with figure(3.2) as picture:
        axes = picture.subplots()
        for (torque_Nm, _), errors in passes.items():
            number, drawn = np.arange(1, len(errors) + 1), np.maximum(errors, LEAST_PERCENT)
            axes.semilogy(
                number, drawn, color=colours[torque_Nm], marker="o", markersize=3,
                linewidth=1.0, alpha=0.8,
            )  # fmt: skip
        axes.axhline(1.0, color=INK, linewidth=0.8)
        axes.axhline(0.2, color=SOFT, linewidth=0.8, linestyle=(0, (4, 3)))
        longest = max(len(errors) for errors in passes.values())
        axes.set_xticks(range(1, longest + 1, ceil(longest / PASS_NUMBERS)))
        largest = max(max(errors) for errors in passes.values())
        axes.set(
            xlabel="pass",
            ylabel="RMS error (% of rated)",
            ylim=(0.9 * LEAST_PERCENT, 1.5 * largest),
        )
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        _legend(picture, axes, colours)
        return picture


def corrections(orders: Sequence[int], points: Mapping[TorqueSpeed, LearnedPoint]) -> Figure:
    """Return amplitudes over order, a dot for each point."""
    colours = _colours(list(points))
    with figure(3.0) as picture:
        axes = picture.subplots()
        for (torque_Nm, _), point in points.items():
            axes.plot(
                orders, 1e3 * np.abs(point.line_Nm), color=colours[torque_Nm], marker="o",
                markersize=3, linestyle="none", alpha=0.8,
            )  # fmt: skip
        axes.set(ylim=(0, None), xlim=(0, None), xlabel="order per turn", ylabel="correction (mNm)")
        _legend(picture, axes, colours)
        return picture
