"""The report of a friction run: friction over speed, coast-downs with their fit, residuals."""

from collections.abc import Sequence
from math import pi, sqrt

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from motord.experiments.friction.result import CoastFit, CurvePoint, DirectionalFriction, Friction
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus, two_digits
from motord.report.html import Page
from motord.report.style import AFTER, BEFORE, GRID, INK, SOFT, figure

CURVE_HEADER = (
    "speed (rad/s)",
    "torque (mNm)",
    "standard uncertainty (mNm)",
    "half of the 95 % interval (mNm)",
)

COLOURS = {"forwards": AFTER, "backwards": BEFORE}
WIDTHS = {"forwards": 3.2, "backwards": 1.2}
"""Of lines that may be the same either way: the first shows on both sides of the other."""

DOT_SAMPLES = 100
"""Samples from one dot to the next."""

LINE_SAMPLES = 4
"""Samples from one point of a line to the next."""


def report(found: Friction, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Friction of the free rotor", recordings.subject.lead)
    page.cards(
        [
            (f"{one.parts['Coulomb (mNm)']} mNm", f"Coulomb friction {one.direction}, 95 %")
            for one in found.directions
        ]
    )
    page.facts(recordings.facts)
    page.heading("Friction torque over speed")
    page.picture(
        friction_over_speed(found.directions),
        "Friction torque (mNm) over speed in both directions of turning, from the coast-downs "
        "with their 95 % interval (shaded), over the speeds that were seen. Dotted: Coulomb "
        "friction alone. Right: half of that interval, and dashed the combined standard "
        "uncertainty, which is in the table of the points.",
    )
    page.table(
        ["95 % intervals", *(one.direction for one in found.directions)],
        found.part_rows,
        numbers=True,
    )
    page.points(found.notes)
    page.subheading("Points of the curve")
    page.table(CURVE_HEADER, [_curve_row(point) for point in found.curve], numbers=True)
    _fill_coast_downs(page, found, recordings.subject.motor.counts)
    return page


def _fill_coast_downs(page: Page, found: Friction, counts: int) -> None:
    page.heading("Coast-downs")
    page.picture(
        coast_downs(found.directions),
        "Speed of the rotor without current, by the fit: cogging torque and current offsets make "
        "its ripple. Right: the angle (dots, every hundredth sample) with the fit through it.",
    )
    rounding_rad = 2 * pi / counts / sqrt(12)
    page.picture(
        residuals(found.directions, rounding_rad),
        "Measured angle less the fit, of each coast-down and as an RMS over all of them; shaded: "
        f"half a count of the encoder, whose rounding alone has an RMS of {1e3 * rounding_rad:.2g} "
        "mrad. What repeats from coast-down to coast-down is torque that the fit does not have.",
    )
    page.subheading("Torque without current that does no work over a turn")
    page.table(
        ["order per turn", *(f"{one.direction} (mNm)" for one in found.directions)],
        _cogging_rows(found),
        numbers=True,
    )


def _curve_row(point: CurvePoint) -> list[str]:
    torque, low, high = (1e3 * value for value in (point.torque_Nm, point.low_Nm, point.high_Nm))
    half = max(high - torque, torque - low)
    number, _, width = plus_minus(torque, half).partition(" +- ")
    return [f"{point.speed_rad_s:.2f}", number, two_digits(1e3 * point.stderr_Nm), width]


def _cogging_rows(found: Friction) -> list[list[str]]:
    by_direction = [
        {line.order: two_digits(1e3 * line.amplitude_Nm) for line in one.cogging}
        for one in found.directions
    ]
    orders = sorted({order for lines in by_direction for order in lines})
    return [[str(order), *(lines.get(order, "") for lines in by_direction)] for order in orders]


def friction_over_speed(directions: Sequence[DirectionalFriction]) -> Figure:
    """Return friction torque over speed with its band, the band's half and the uncertainty."""
    with figure(3.6) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.6, 1.0])
        for one in directions:
            colour, width = COLOURS[one.direction], WIDTHS[one.direction]
            speed, value, low, high, stderr = _curve(one)
            left.fill_between(speed, low, high, color=colour, alpha=0.25, linewidth=0)
            left.plot(speed, value, color=colour, label=one.direction)
            coulomb_mNm = 1e3 * np.sign(value[0]) * (one.coulomb_Nm.value or 0.0)
            left.plot(
                [0, speed[np.argmax(np.abs(speed))]], [coulomb_mNm, coulomb_mNm],
                color=SOFT, linewidth=1.2, linestyle=(0, (1, 2)),
            )  # fmt: skip
            right.plot(np.abs(speed), (high - low) / 2, color=colour, linewidth=width)
            right.plot(np.abs(speed), stderr, color=colour, linewidth=width, linestyle="dashed")
        for axis in (left.axhline, left.axvline):
            axis(0, color=SOFT, linewidth=0.8, zorder=0)
        left.set(xlabel="speed (rad/s)", ylabel="friction torque (mNm)")
        right.set(
            xlim=(0, None),
            ylim=(0, None),
            xlabel="speed, either way (rad/s)",
            ylabel="uncertainty (mNm)",
        )
        handles, _ = left.get_legend_handles_labels()
        handles += [
            Line2D([], [], color=INK, label="half of the 95 % interval"),
            Line2D([], [], color=INK, linestyle="dashed", label="standard uncertainty"),
        ]
        picture.legend(handles=handles, loc="outside upper left", ncols=4)
        return picture


def coast_downs(directions: Sequence[DirectionalFriction]) -> Figure:
    """Return speeds over time of all coast-downs, and angles with the fit."""
    with figure(3.4) as picture:
        left, right = picture.subplots(1, 2)
        for one in directions:
            colour = COLOURS[one.direction]
            for number, fit in enumerate(one.fits):
                label = one.direction if number == 0 else None
                line, dots = slice(None, None, LINE_SAMPLES), slice(None, None, DOT_SAMPLES)
                left.plot(
                    fit.t_s[line], fit.speed_rad_s[line], color=colour, linewidth=0.6, alpha=0.7,
                    label=label,
                )  # fmt: skip
                turns = fit.angle_rad / (2 * np.pi)
                fitted = (fit.angle_rad - fit.residual_rad) / (2 * np.pi)
                right.plot(fit.t_s[line], fitted[line], color=colour, linewidth=0.6, alpha=0.7)
                right.plot(fit.t_s[dots], turns[dots], ".", color=colour, markersize=3.0)
        left.set(ylim=(0, None), xlabel="time (s)", ylabel="speed, either way (rad/s)")
        right.set(xlabel="time (s)", ylabel="turns")
        picture.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return picture


def residuals(directions: Sequence[DirectionalFriction], rounding_rad: float) -> Figure:
    """Return angle less fit over time, one picture for each direction."""
    with figure(3.0) as picture:
        every = picture.subplots(1, len(directions), sharey=True, squeeze=False)[0]
        for axes, one in zip(every, directions, strict=True):
            half_width_mrad = 1e3 * sqrt(3) * rounding_rad
            axes.axhspan(-half_width_mrad, half_width_mrad, color=GRID, zorder=0)
            for fit in one.fits:
                axes.plot(
                    fit.t_s[::LINE_SAMPLES], 1e3 * fit.residual_rad[::LINE_SAMPLES],
                    color=COLOURS[one.direction], linewidth=0.4, alpha=0.5,
                )  # fmt: skip
            t_s, rms_rad = _rms(one.fits)
            axes.plot(t_s, 1e3 * rms_rad, color=INK, linewidth=1.6)
            axes.set(title=one.direction, xlabel="time (s)")
        every[0].set_ylabel("angle less fit (mrad)")
        return picture


def _curve(one: DirectionalFriction) -> tuple[np.ndarray, ...]:
    """Return speeds (rad/s), torques, both limits and standard uncertainties (mNm)."""
    points = [(p.speed_rad_s, p.torque_Nm, p.low_Nm, p.high_Nm, p.stderr_Nm) for p in one.curve]
    return tuple(np.array(points, float).T * np.array([[1.0], [1e3], [1e3], [1e3], [1e3]]))


def _rms(fits: Sequence[CoastFit]) -> tuple[np.ndarray, np.ndarray]:
    """Return the RMS of the residuals over all coast-downs in 50 parts of their time."""
    t_s = np.concatenate([fit.t_s for fit in fits])
    square = np.concatenate([fit.residual_rad for fit in fits]) ** 2
    edges = np.linspace(0, min(fit.t_s[-1] for fit in fits), 51)
    place = np.searchsorted(edges, t_s, side="right") - 1
    inside = place < 50
    total = np.bincount(place[inside], square[inside], 50)
    number = np.maximum(np.bincount(place[inside], minlength=50), 1)
    return (edges[1:] + edges[:-1]) / 2, np.sqrt(total / number)
