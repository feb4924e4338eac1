"""Pictures: releases of a bar between springs, steps of torque, sources of uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.inertia.error_budget import Curves
from motord.experiments.inertia.torque_step import TorqueStep
from motord.report.style import AFTER, BEFORE, INK, OTHER, REFERENCE, SOFT, drawing, figure


@dataclass(frozen=True)
class DecayCurves:
    """Releases: (t_s, angle_rad) from the first crossing on, angle from rest, each of any length.

    late_s, late_rad: samples of the last used oscillation of one of them; late_fit_rad: its fit at
    these times.
    """

    releases: tuple[tuple[np.ndarray, np.ndarray], ...]
    resolution_rad: float
    late_s: np.ndarray
    late_rad: np.ndarray
    late_fit_rad: np.ndarray


@dataclass(frozen=True)
class Periods:
    """Period (s) over the spring constant of each side (N/m), and where the set-up is."""

    stiffness_N_per_m: np.ndarray
    period_s: np.ndarray
    own_N_per_m: float
    own_s: float


def decays(data: DecayCurves) -> Figure:
    """Return all releases over time, and the last oscillation of one with its fit."""
    with drawing():
        picture = figure(3.5)
        left, right = picture.subplots(1, 2, width_ratios=[1.5, 1.0])
        for t_s, angle_rad in data.releases:
            left.plot(t_s, angle_rad / data.resolution_rad, color=AFTER, linewidth=0.7, alpha=0.5)
        left.axhline(0, color=INK, linewidth=0.8)
        left.set_xlim(0, max(t_s[-1] for t_s, _ in data.releases))
        left.set_xlabel("time since the first crossing (s)")
        left.set_ylabel("angle from rest (encoder counts)")
        left.set_title(f"{len(data.releases)} releases")
        right.plot(
            data.late_s, data.late_rad / data.resolution_rad, ".", color=AFTER, markersize=4,
            label="encoder",
        )  # fmt: skip
        right.plot(
            data.late_s, data.late_fit_rad / data.resolution_rad, color=REFERENCE, linewidth=1.4,
            label="fit of the whole decay",
        )  # fmt: skip
        right.axhline(0, color=INK, linewidth=0.8)
        right.set_xlabel("time since the first crossing (s)")
        right.set_title("The last oscillation of one of them")
        right.legend(loc="upper right", markerscale=1.6)
        right.margins(y=0.25)
        return picture


def periods(data: Periods) -> Figure:
    """Return the period over the spring constant."""
    with drawing():
        picture = figure(2.6)
        axes = picture.subplots()
        axes.plot(data.stiffness_N_per_m, data.period_s, color=AFTER)
        axes.plot([data.own_N_per_m], [data.own_s], "o", color=BEFORE, markersize=6)
        axes.annotate(
            f"this set-up: {1e3 * data.own_s:.0f} ms", (data.own_N_per_m, data.own_s),
            xytext=(8, 8), textcoords="offset points", color=INK,
        )  # fmt: skip
        axes.set_xlabel("spring constant of each side (N/m)")
        axes.set_ylabel("period (s)")
        axes.set_ylim(bottom=0)
        return picture


def torque_steps(steps: Sequence[TorqueStep]) -> Figure:
    """Return angle and torque of all steps over time, those backwards turned round."""
    with drawing():
        picture = figure(3.4)
        left, right = picture.subplots(1, 2)
        for number, one in enumerate(steps):
            sign, first = np.sign(one.angle_rad[-1]), number == 0
            left.plot(
                1e3 * one.t_s, sign * one.angle_rad, color=AFTER, linewidth=2.2, alpha=0.45,
                label="encoder" if first else None,
            )  # fmt: skip
            left.plot(
                1e3 * one.fitted_s, sign * one.fitted_rad, color=REFERENCE, linewidth=0.8,
                label="fit" if first else None,
            )  # fmt: skip
            right.plot(1e3 * one.t_s, sign * one.torque_Nm, color=OTHER, linewidth=0.6, alpha=0.6)
        right.axhline(0, color=SOFT, linewidth=0.8)
        for axes in (left, right):
            axes.set_xlabel("time since the step (ms)")
        left.set_ylabel("angle turned (rad)")
        left.set_title("Angle")
        left.legend(loc="upper left")
        right.set_ylabel("torque (Nm)")
        right.set_title("Torque by the sensor, high-pass undone")
        return picture


def thinned(
    releases: Sequence[tuple[np.ndarray, np.ndarray]], most: int = 350
) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Return releases with at most `most` samples each, for drawing."""
    steps = [-(-t_s.size // most) for t_s, _ in releases]
    return tuple(
        (t_s[::step], angle_rad[::step])
        for (t_s, angle_rad), step in zip(releases, steps, strict=True)
    )


def sensitivity(curves: Curves) -> Figure:
    """Return the change of the inertia over errors of springs, levers, mass, effective mass."""
    with drawing():
        picture = figure(6.2)
        ((springs, levers), (mass, factor)) = picture.subplots(2, 2)
        _fan(springs, curves.stiffness, curves.stiffness_change, "K")
        springs.set_title("Spring constants")
        springs.set_xlabel("error of the spring constants (%)")
        _fan(levers, curves.lever, curves.lever_change, "L")
        levers.set_title("Levers")
        levers.set_xlabel("error of the levers (%)")
        mass.plot(100 * curves.mass, 100 * curves.mass_change, color=AFTER)
        mass.set_title("Weighed mass of the springs")
        mass.set_xlabel("error of the springs' mass (%)")
        factor.plot(curves.factor, 100 * curves.factor_change, color=AFTER)
        _mark_waves(factor, curves)
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


def _mark_waves(axes: Axes, curves: Curves) -> None:
    at = curves.wave_factor
    change = float(np.interp(at, curves.factor, curves.factor_change))
    axes.plot([at], [100 * change], "o", color=REFERENCE, markersize=6)
    axes.annotate(
        f"waves in the springs: {at:.3f}", (at, 100 * change), xytext=(10, 2),
        textcoords="offset points", color=INK, va="bottom",
    )  # fmt: skip


def shares(sources: Sequence[tuple[str, float]], changes: Sequence[tuple[str, float]]) -> Figure:
    """Return the ranked sources, (label, uncertainty in parts), and what changes would leave."""
    with drawing():
        picture = figure(0.9 + 0.34 * max(len(sources), len(changes)))
        left, right = picture.subplots(1, 2)
        _bars(left, sources, AFTER)
        left.set_title("Where it comes from")
        _bars(right, changes, OTHER)
        right.set_title("What changes of the set-up leave")
        return picture


def ranked(sources: Sequence[tuple[str, float]]) -> Figure:
    """Return the ranked sources of an uncertainty, (label, uncertainty in parts)."""
    with drawing():
        picture = figure(0.9 + 0.34 * len(sources))
        axes = picture.subplots()
        _bars(axes, sources, AFTER)
        return picture


def _bars(axes: Axes, bars: Sequence[tuple[str, float]], colour: str) -> None:
    places = np.arange(len(bars))
    values = 100 * np.array([uncertainty for _, uncertainty in bars])
    axes.barh(places, values, 0.62, color=colour)
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            f"{value:.2g}", (value, place), xytext=(4, 0), textcoords="offset points",
            va="center", fontsize=9, color=INK,
        )  # fmt: skip
    axes.set_yticks(places, [label for label, _ in bars])
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.set_xlim(0, 1.15 * max(float(values.max()), 1e-9))
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("standard uncertainty (% of the inertia)")
