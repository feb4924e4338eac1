"""What makes a moment of inertia uncertain: errors one by one, shares, improvements, 6.6 %."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, BEFORE, INK, OTHER, REFERENCE, SOFT, drawing, figure


@dataclass(frozen=True)
class SensitivityCurve:
    """Change of the inertia over errors of what was told, all in parts; see `identify`'s Curves.

    stiffness (a,), stiffness_change (n, a): the first spring wrong, the first two, ...; lever (b,),
    lever_change (m, b) likewise; mass, mass_change (c,); factor, factor_change (d,).
    """

    stiffness: np.ndarray
    stiffness_change: np.ndarray
    lever: np.ndarray
    lever_change: np.ndarray
    mass: np.ndarray
    mass_change: np.ndarray
    factor: np.ndarray
    factor_change: np.ndarray
    wave_factor: float


@dataclass(frozen=True)
class Bar:
    """A bar: its label and standard uncertainty in parts of the inertia."""

    label: str
    uncertainty: float


@dataclass(frozen=True)
class Range:
    """Where the inertia may lie, in parts off: 95 % of cases, and the worst."""

    label: str
    interval: tuple[float, float]
    worst: tuple[float, float]


def sensitivity(data: SensitivityCurve) -> Figure:
    """Return the change of the inertia over errors of springs, levers, mass, effective mass."""
    with drawing():
        picture = figure(6.2)
        ((springs, levers), (mass, factor)) = picture.subplots(2, 2)
        _fan(springs, data.stiffness, data.stiffness_change, "K")
        springs.set_title("Spring constants")
        springs.set_xlabel("error of the spring constants (%)")
        _fan(levers, data.lever, data.lever_change, "L")
        levers.set_title("Levers")
        levers.set_xlabel("error of the levers (%)")
        mass.plot(100 * data.mass, 100 * data.mass_change, color=AFTER)
        mass.set_title("Weighed mass of the springs")
        mass.set_xlabel("error of the springs' mass (%)")
        factor.plot(data.factor, 100 * data.factor_change, color=AFTER)
        _mark_waves(factor, data)
        factor.set_title("Effective mass of the springs")
        factor.set_xlabel("effective mass, in parts of the mass")
        for axes in (springs, mass):
            axes.set_ylabel("error of the inertia (%)")
        return picture


def _fan(axes: Axes, error: np.ndarray, change: np.ndarray, letter: str) -> None:
    for number, row in enumerate(change, start=1):
        alpha = 0.35 + 0.65 * number / len(change)
        axes.plot(100 * error, 100 * row, color=AFTER, alpha=alpha, linewidth=1.3)
        names = letter + ",".join(str(n) for n in range(1, number + 1))
        axes.annotate(
            names, (100 * error[-1], 100 * row[-1]), xytext=(4, 0), textcoords="offset points",
            va="center", fontsize=8, color=INK, annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(100 * error[0], 100 * error[-1])


def _mark_waves(axes: Axes, data: SensitivityCurve) -> None:
    at = data.wave_factor
    change = float(np.interp(at, data.factor, data.factor_change))
    axes.plot([at], [100 * change], "o", color=REFERENCE, markersize=6)
    axes.annotate(
        f"waves in the springs: {at:.3f}", (at, 100 * change), xytext=(10, 2),
        textcoords="offset points", color=INK, va="bottom",
    )  # fmt: skip


def shares(sources: Sequence[Bar], changes: Sequence[Bar]) -> Figure:
    """Return the ranked sources of the uncertainty, and what changes of the set-up leave of it."""
    with drawing():
        picture = figure(0.9 + 0.34 * max(len(sources), len(changes)))
        left, right = picture.subplots(1, 2)
        _bars(left, sources, AFTER)
        left.set_title("Where it comes from")
        _bars(right, changes, OTHER)
        right.set_title("What changes of the set-up leave")
        return picture


def ranked(sources: Sequence[Bar]) -> Figure:
    """Return the ranked sources of an uncertainty."""
    with drawing():
        picture = figure(0.9 + 0.34 * len(sources))
        axes = picture.subplots()
        _bars(axes, sources, AFTER)
        return picture


def _bars(axes: Axes, bars: Sequence[Bar], colour: str) -> None:
    places = np.arange(len(bars))
    values = 100 * np.array([bar.uncertainty for bar in bars])
    axes.barh(places, values, 0.62, color=colour)
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            f"{value:.2g}", (value, place), xytext=(4, 0), textcoords="offset points",
            va="center", fontsize=9, color=INK,
        )  # fmt: skip
    axes.set_yticks(places, [bar.label for bar in bars])
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.set_xlim(0, 1.15 * max(float(values.max()), 1e-9))
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("standard uncertainty (% of the inertia)")


def explanation(ranges: Sequence[Range], difference: float) -> Figure:
    """Return what the report's tolerances allow for, against the difference that it found."""
    with drawing():
        picture = figure(0.9 + 0.42 * len(ranges))
        axes = picture.subplots()
        for place, item in enumerate(ranges):
            low, high = (100 * x for x in item.worst)
            axes.plot([low, high], [place, place], color=SOFT, linewidth=1.2)
            low, high = (100 * x for x in item.interval)
            axes.plot([low, high], [place, place], color=AFTER, linewidth=6, solid_capstyle="butt")
        axes.axvline(100 * difference, color=BEFORE, linewidth=1.4)
        axes.annotate(
            f"CAD: +{100 * difference:.1f} %", (100 * difference, -0.6), xytext=(5, 0),
            textcoords="offset points", color=INK, va="top",
        )  # fmt: skip
        axes.axvline(0, color=INK, linewidth=0.8)
        axes.set_yticks(range(len(ranges)), [item.label for item in ranges])
        axes.set_ylim(len(ranges) - 0.5, -0.7)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel("true inertia against the measured one (%)")
        return picture
