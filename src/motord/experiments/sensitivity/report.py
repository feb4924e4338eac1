"""The report of a sensitivity analysis: theory, practice, and a calibration from known errors."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure

from motord.experiments.sensitivity.curves import Surface, Volume
from motord.experiments.sensitivity.result import Again, Sensitivity, Theory
from motord.experiments.sensitivity.slope_fit import Series
from motord.experiments.subject import Recordings
from motord.intervals import coverage_factor
from motord.report.html import Page
from motord.report.plots.gains import Gains, gains
from motord.report.style import AFTER, ON_FILL, OTHER, REFERENCE, SOFT, figure

POELS2008_INDUCED = np.array([0.8, 1.118, 1.118, 1.0, -0.5, -0.5])
POELS2008_FOUND = np.array([0.7717, 1.1035, 1.0884, 0.9994, -0.5078, -0.6205])
"""Poels 2008, Table 4.2."""

POELS2008_ERRORS = ("-3.5 %", "-1.3 %", "-2.6 %", "+0.1 %", "+1.6 %", "+24.1 %")
"""By how much these are off, as printed there."""

SYMBOL = {
    "alpha_a": "\u03b1a",
    "beta_a_A": "\u03b2a (A)",
    "cogging": "cogging factor",
    "delta_epsilon": "\u03b4\u03b5",
}
"""What the axes are called."""

TITLE = {
    "alpha_a": "Gain of phase a",
    "beta_a_A": "Offset of phase a",
    "cogging": "Factor of the cogging torque",
    "delta_epsilon": "Common gain",
}

NAMES = tuple(SYMBOL[what] for what in ("alpha_a", "beta_a_A", "cogging"))
"""What the axes are called, in the order of the volume."""

_SMOOTH = LinearSegmentedColormap.from_list("smooth", ["#0d4f7c", "#3f8fbe", "#d5e7f0"])
_ROUGH = LinearSegmentedColormap.from_list("rough", ["#f6e7cf", "#ec9a62", "#b23a1e", "#6d1410"])


def report(result: Sensitivity, _: Recordings) -> Page:
    """Return a page of its own."""
    subject = result.subject
    motor = subject.motor
    page = Page("Sensitivity to errors of a calibration", subject.lead)
    page.cards(_key_figures(result))
    fill(page, result)
    page.heading("About these figures")
    rows = (
        ("bench", subject.bench),
        ("motor", f"{motor.name}, {motor.rated_torque_Nm:g} Nm rated, {motor.connection}"),
        ("recordings", ", ".join(result.runs) or "none"),
    )
    page.facts(rows)
    return page


def _key_figures(result: Sensitivity) -> list[tuple[str, str]]:
    """Return the measured slopes of gain and offset; without any what the theory allows."""
    theory = result.theory
    if any(any(one.branches) for one in result.series):
        return [
            (f"{slope} %", f"RMS error a unit of {branch}, 95 %; by theory {expected} %")
            for branch, _, slope, expected in result.slope_rows(SYMBOL, ",")
            if branch.startswith((SYMBOL["alpha_a"], SYMBOL["beta_a_A"]))
        ]
    return [
        (
            f"{_number(low)} to {_number(high)}",
            f"{SYMBOL[what]}, which alone leaves at most {theory.limit_percent:g} % by theory",
        )
        for what, (low, high) in theory.within.items()
    ]


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
        f"{SYMBOL[one.what]} = {_signed(one.meeting[0], '.3f')}"
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
        change = f"{100 * off / induced[n]:+.2f} %" if n < 3 else f"{off:+.2g} A"
        row = [name, f"{induced[n]:.4f}", f"{found[n]:.4f}", change, f"{again.cost_percent[n]:.3f}"]
        if _as_poels2008(again):
            row += [f"{POELS2008_FOUND[n]:.4f}", POELS2008_ERRORS[n]]
        rows.append(row)
    return rows


def traces(items: Sequence[Series]) -> Figure:
    """Return one picture for each kind of error, two next to each other."""
    rows = (len(items) + 1) // 2
    with figure(0.4 + 2.7 * rows) as picture:
        grid = picture.subplots(rows, 2, squeeze=False)
        for axes, item in zip(grid.flat, items, strict=False):
            _draw(axes, item)
        for axes in grid.flat[len(items) :]:
            axes.remove()
        for axes in grid[:, 0]:
            axes.set_ylabel("RMS error (% of rated)")
        picture.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        return picture


def _draw(axes: Axes, item: Series) -> None:
    axes.plot(item.value, item.theory_percent, color=REFERENCE, lw=1.6, label="theory")
    label: str | None = "line fitted to a branch"
    for branch, outer in zip(item.branches, (item.value[0], item.value[-1]), strict=True):
        if branch is not None:
            x = np.array([outer, item.ideal])
            y = branch.at_ideal + branch.slope * (x - item.ideal)
            axes.plot(x, y, color=OTHER, lw=1.2, ls=(0, (4, 3)), label=label)
            label = None
    half_width_percent = coverage_factor() * item.stderr_percent
    axes.errorbar(
        item.value, item.measured_percent, yerr=half_width_percent, fmt="o", color=AFTER,
        markersize=4.5, elinewidth=1.2, label="measured",
    )  # fmt: skip
    axes.set(ylim=(0.0, None), title=TITLE[item.what], xlabel=SYMBOL[item.what])


def slices(volume: Volume, limit_percent: float) -> Figure:
    """Return nine slices: each error in turn at both ends and in the middle of its interval."""
    values = volume.alpha_a, volume.beta_a_A, volume.cogging
    with figure(7.6) as picture:
        grid = picture.subplots(3, 3)
        levels, colours = _scale(float(volume.rms_percent.max()), limit_percent)
        norm = BoundaryNorm(levels, colours.N)
        for fixed in range(3):
            across, up = (n for n in range(3) if n != fixed)
            places = (0, values[fixed].size // 2, values[fixed].size - 1)
            for column, place in enumerate(places):
                axes = grid[fixed, column]
                rms = np.take(volume.rms_percent, place, axis=fixed).T
                x, y = values[across], values[up]
                filled = axes.contourf(x, y, rms, levels, cmap=colours, norm=norm)
                if rms.min() < limit_percent < rms.max():
                    axes.contour(x, y, rms, [limit_percent], colors=[ON_FILL], linewidths=1.6)
                axes.set(title=_at(fixed, float(values[fixed][place])), xlabel=NAMES[across])
                axes.grid(visible=False)
            grid[fixed, 0].set_ylabel(NAMES[up])
        bar = picture.colorbar(filled, ax=list(grid.flat), pad=0.02, aspect=40)
        bar.set_label("RMS error (% of rated)")
        bar.outline.set_visible(False)
        return picture


def _scale(highest_percent: float, limit_percent: float) -> tuple[np.ndarray, ListedColormap]:
    """Return levels and their colours: blue below the limit, red above."""
    below = np.linspace(0, limit_percent, 5)
    step = max(np.ceil(2 * (highest_percent - limit_percent) / 8) / 2, 0.5)
    above = np.arange(limit_percent + step, max(highest_percent, limit_percent) + step, step)
    levels = np.concatenate([below, above])
    colours = [*_SMOOTH(np.linspace(0, 1, 4)), *_ROUGH(np.linspace(0, 1, max(above.size, 1)))]
    return levels, ListedColormap(colours[: levels.size - 1])


def _signed(value: float, form: str) -> str:
    return format(value, form).replace("-", "\u2212")


def _at(fixed: int, value: float) -> str:
    name, _, unit = NAMES[fixed].partition(" (")
    return f"{name} = {_signed(value, 'g')}" + (f" {unit.rstrip(')')}" if unit else "")


def limit(surface: Surface) -> Figure:
    """Return the surface from two sides."""
    with figure(4.4) as picture:
        for place, azimuth_deg in enumerate((-58, 32)):
            axes = picture.add_subplot(1, 2, place + 1, projection="3d")
            axes.plot_surface(
                surface.alpha_a, surface.beta_a_A, surface.cogging, color=AFTER, edgecolor=SOFT,
                linewidth=0.25, rstride=1, cstride=1, alpha=0.9, shade=True,
            )  # fmt: skip
            axes.view_init(elev=22, azim=azimuth_deg)
            axes.set(xlabel=NAMES[0], ylabel=NAMES[1])
            axes.set_zlabel(NAMES[2])
            axes.locator_params(nbins=5)
            axes.set_box_aspect((1, 1, 0.9), zoom=0.86)
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        return picture
