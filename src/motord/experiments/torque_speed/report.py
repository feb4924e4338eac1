"""The report of an efficiency map: contours, losses, all figures, and what makes them uncertain."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import LinearTriInterpolator, Triangulation

from motord.experiments.subject import Recordings
from motord.experiments.torque_speed.result import EfficiencyMap, OperatingPower
from motord.intervals import two_digits
from motord.report.html import Page
from motord.report.style import INK, ON_FILL, PAPER, SERIOUS, figure, steps
from motord.report.text import largest_interval

HEADER = ("set-points", "mechanical (W)", "electrical (W)", "losses (W)", "efficiency (%)")

_MAP = LinearSegmentedColormap.from_list(
    "efficiency", ["#6d1410", "#c2502f", "#ec9a62", "#f3e6c8", "#a9cfe3", "#3f8fbe", "#0d4f7c"]
)
"""Red is lossy, blue is efficient."""

GRID_POINTS = 120
"""Points of the grid that contours are drawn on, in each direction."""

LEVELS = 12
LINES = {"motoring": "o-", "generating": "s--", "braking": "^:"}


def report(found: EfficiencyMap, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Efficiency map", recordings.subject.lead)
    shown = found.best or found.points[0]
    figures = [
        (shown.loss.text(" W"), f"losses at {shown.label}, 95 %"),
        (f"{len(found.points)}", "operating points"),
    ]
    if found.best:
        highest = shown.efficiency.text(" %")
        figures.insert(0, (highest, f"highest efficiency, at {shown.label}, 95 %"))
    page.cards(figures)
    page.facts(recordings.facts)
    page.heading("Efficiency over torque and speed")
    page.picture(
        efficiency_contours(found.points),
        "Efficiency of motor and inverter: mechanical over electrical power where it motors, "
        "electrical over mechanical where it generates. Dots: operating points, crosses: no "
        "efficiency is stated; between points the losses are taken to be straight. Dashed: the "
        "largest torque that the plan had for a speed, where the recordings say it. "
        + _intervals(found.points),
    )
    page.heading("Losses")
    page.picture(
        losses(found.points), "Electrical less mechanical power over torque, with 95 % intervals."
    )
    page.heading("Operating points")
    page.paragraph(
        "Means over whole turns; powers are positive into the motor. Half-widths of 95 % "
        f"intervals. The electrical power is the channel {found.power_source}."
    )
    page.table(HEADER, [row(one) for one in found.points], numbers=True)
    reasons = [f"{one.label}: {one.efficiency_reason}" for one in found.points]
    page.points(
        [reason for one, reason in zip(found.points, reasons, strict=True) if one.efficiency_reason]
    )
    _fill_budget(page, found)
    return page


def _intervals(points: Sequence[OperatingPower]) -> str:
    """Return a sentence on how well the efficiencies are known."""
    stated = [one.efficiency for one in points if one.efficiency.value is not None]
    return largest_interval(
        None if one.value is None or one.high is None else one.high - one.value for one in stated
    )


def row(one: OperatingPower) -> list[str]:
    """Return an operating point as a row under HEADER."""
    return [
        one.label,
        one.mechanical.text(),
        one.electrical.text(),
        one.loss.text(),
        one.efficiency.text() or "-",
    ]


def _fill_budget(page: Page, found: EfficiencyMap) -> None:
    best = found.best or found.points[0]
    page.heading("What makes it uncertain")
    page.paragraph(
        f"Standard uncertainties at {best.label}: {best.blocks} blocks of turns, {best.readings} "
        f"readings of the power, {best.read_every_s:.3g} s apart."
    )
    page.table(
        ["source", "type", "losses (W)", "efficiency (%)"],
        [
            [
                one.source,
                one.type,
                two_digits(one.loss_W),
                "-" if one.efficiency_percent is None else two_digits(one.efficiency_percent),
            ]
            for one in best.budget
        ],
        numbers=True,
    )


def efficiency_contours(points: Sequence[OperatingPower]) -> Figure:
    """Return the efficiency over speed and torque, with the points and the envelope."""
    with figure(4.8) as picture:
        axes = picture.subplots()
        defined = [one for one in points if one.efficiency.value is not None]
        values = [one.efficiency.value or 0.0 for one in defined]
        ends = min(values, default=0.0), max(values, default=100.0)
        levels = np.asarray(MaxNLocator(LEVELS, steps=[1, 2, 2.5, 5, 10]).tick_values(*ends))
        drawn = None
        for mode in ("motoring", "generating"):
            for sign in (1, -1):
                group = [p for p in defined if p.mode == mode and sign * p.speed_mean_Hz > 0]
                drawn = _contours(axes, group, levels) or drawn
        _points(axes, points)
        _envelope(axes, points)
        axes.use_sticky_edges = False
        axes.margins(0.06)
        axes.set(xlabel="speed (turns/s)", ylabel="torque (Nm)")
        if drawn is not None:
            bar = picture.colorbar(drawn, ax=axes, pad=0.02, aspect=24)
            bar.set_label("efficiency of motor and inverter (%)")
            bar.outline.set_visible(False)
        return picture


def _contours(
    axes: Axes, points: Sequence[OperatingPower], levels: np.ndarray
) -> QuadContourSet | None:
    """Draw the efficiency within the points of a quadrant; nothing if they lie on a line.

    Between points the losses are taken to be straight, and the efficiency follows.
    """
    speed_Hz = np.array([one.speed_mean_Hz for one in points])
    torque_Nm = np.array([one.torque_mean_Nm for one in points])
    if (
        len(points) < 3
        or np.linalg.matrix_rank(
            np.column_stack([np.ones(len(points)), speed_Hz, torque_Nm]), tol=1e-3
        )
        < 3
    ):
        return None
    loss_W = np.array([one.loss.value for one in points])
    between = LinearTriInterpolator(Triangulation(speed_Hz, torque_Nm), loss_W)
    grid = np.meshgrid(
        np.linspace(speed_Hz.min(), speed_Hz.max(), GRID_POINTS),
        np.linspace(torque_Nm.min(), torque_Nm.max(), GRID_POINTS),
    )
    mechanical_W, lost_W = 2 * np.pi * grid[0] * grid[1], between(*grid)
    given_W = mechanical_W + lost_W
    part = mechanical_W / given_W if points[0].mode == "motoring" else given_W / mechanical_W
    filled = axes.contourf(*grid, 100 * part, levels, cmap=_MAP, extend="min")
    axes.contour(*grid, 100 * part, levels, colors=ON_FILL, linewidths=0.4, alpha=0.5)
    return filled


def _points(axes: Axes, points: Sequence[OperatingPower]) -> None:
    for one in points:
        value = one.efficiency.value
        axes.plot(
            one.speed_mean_Hz, one.torque_mean_Nm, "o" if value is not None else "x",
            color=INK if value is not None else SERIOUS, markersize=3.0,
        )  # fmt: skip
        axes.annotate(
            "" if value is None else f"{value:.1f}",
            (one.speed_mean_Hz, one.torque_mean_Nm),
            xytext=(0, 4), textcoords="offset points", ha="center", fontsize=8.0, color=INK,
            path_effects=[withStroke(linewidth=2.5, foreground=PAPER)],
        )  # fmt: skip


def _envelope(axes: Axes, points: Sequence[OperatingPower]) -> None:
    """Draw the largest torques of the plan over speed, in each quadrant."""
    known = [one for one in points if one.envelope_Nm is not None]
    label: str | None = "envelope of the plan"
    for sign in (1, -1):
        for forwards in (True, False):
            own = {
                one.speed_Hz: one.envelope_Nm
                for one in known
                if sign * one.torque_Nm > 0 and (one.speed_Hz > 0) is forwards
            }
            if own:
                speeds_Hz = sorted(own)
                axes.plot(
                    speeds_Hz, [own[at_Hz] or 0.0 for at_Hz in speeds_Hz], color=SERIOUS,
                    linestyle=(0, (5, 3)), marker="_", label=label,
                )  # fmt: skip
                label = None
    if known:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))


def losses(points: Sequence[OperatingPower]) -> Figure:
    """Return the losses over torque, a line for each speed, with their 95 % intervals."""
    with figure(3.6) as picture:
        axes = picture.subplots()
        speeds_Hz = sorted({one.speed_Hz for one in points})
        for speed_Hz, colour in zip(speeds_Hz, steps(len(speeds_Hz)), strict=True):
            for mode, style in LINES.items():
                line = sorted(
                    (one for one in points if one.speed_Hz == speed_Hz and one.mode == mode),
                    key=lambda one: one.torque_mean_Nm,
                )
                value = np.array([one.loss.value for one in line], float)
                high = np.array([one.loss.high for one in line], float)
                if line:
                    axes.errorbar(
                        [one.torque_mean_Nm for one in line], value, high - value, fmt=style,
                        color=colour, capsize=2.5, markersize=3.0, linewidth=1.0,
                        label=f"{speed_Hz:g} turn{'s' * (speed_Hz != 1)}/s, {mode}",
                    )  # fmt: skip
        lowest_W = min(0.0, axes.dataLim.ymin)
        axes.set(xlabel="torque (Nm)", ylabel="losses (W)", ylim=(lowest_W, None))
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        return picture
