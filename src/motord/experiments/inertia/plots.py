"""Pictures: releases of a bar between springs, steps of torque, sources of uncertainty."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.inertia.error_budget import Curves
from motord.experiments.inertia.releases import Release
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.torque_step import TorqueStep
from motord.report.style import AFTER, BEFORE, INK, OTHER, REFERENCE, SOFT, figure

SAMPLES = 350
"""Samples of a release that are drawn, at most."""

PERIODS_FROM, PERIODS_TO = 0.2, 1.6
"""Spring constants over which the period is drawn, in parts of the set-up's own."""


def decays(releases: Sequence[Release]) -> Figure:
    """Return all releases over time, and the last oscillation of one with its fit."""
    count_rad, decay = releases[0].oscillation.resolution_rad, releases[0].decay
    crossings_s = releases[0].oscillation.crossings_s
    late = decay.t_s >= crossings_s[-3] - crossings_s[0]
    fitted_rad = decay.angle_rad + decay.residual_rad
    since = "time since the first crossing (s)"
    with figure(3.5) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.5, 1.0])
        end_s = 0.0
        for one in (release.decay for release in releases):
            some = slice(None, None, -(-one.t_s.size // SAMPLES))
            t_s, angle = one.t_s[some], (one.angle_rad[some] - one.rest_rad) / count_rad
            left.plot(t_s, angle, color=AFTER, linewidth=0.7, alpha=0.5)
            end_s = max(end_s, t_s[-1])
        left.set(xlim=(0, end_s), xlabel=since, ylabel="angle from rest (encoder counts)")
        left.set_title(f"{len(releases)} releases")
        t_s, angle = decay.t_s[late], (decay.angle_rad[late] - decay.rest_rad) / count_rad
        right.plot(t_s, angle, ".", color=AFTER, markersize=4, label="encoder")
        fit = (fitted_rad[late] - decay.rest_rad) / count_rad
        right.plot(t_s, fit, color=REFERENCE, linewidth=1.4, label="fit of the whole decay")
        right.set(xlabel=since, title="The last oscillation of one of them")
        right.legend(loc="upper right", markerscale=1.6)
        right.margins(y=0.25)
        for axes in (left, right):
            axes.axhline(0, color=INK, linewidth=0.8)
        return picture


def periods(setup: SpringSetup, inertia_kg_m2: float) -> Figure:
    """Return the period over the spring constant of each side, all springs alike."""

    def period_s(part: float) -> float:
        other = replace(setup, stiffness_N_per_m=part * setup.stiffness_N_per_m)
        return 2 * np.pi / other.frequency_rad_s(inertia_kg_m2)

    own_N_per_m, own_s = float(setup.stiffness_N_per_m.sum()) / 2, period_s(1.0)
    parts = np.linspace(PERIODS_FROM, PERIODS_TO, 57)
    with figure(2.6) as picture:
        axes = picture.subplots()
        axes.plot(parts * own_N_per_m, [period_s(part) for part in parts], color=AFTER)
        axes.plot([own_N_per_m], [own_s], "o", color=BEFORE, markersize=6)
        axes.annotate(
            f"this set-up: {1e3 * own_s:.0f} ms", (own_N_per_m, own_s),
            xytext=(8, 8), textcoords="offset points", color=INK,
        )  # fmt: skip
        axes.set(xlabel="spring constant of each side (N/m)", ylabel="period (s)", ylim=(0, None))
        return picture


def torque_steps(steps: Sequence[TorqueStep]) -> Figure:
    """Return angle and torque of all steps over time, those backwards turned round."""
    with figure(3.4) as picture:
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
        since = "time since the step (ms)"
        left.set(xlabel=since, ylabel="angle turned (rad)", title="Angle")
        left.legend(loc="upper left")
        right.set(
            xlabel=since, ylabel="torque (Nm)", title="Torque by the sensor, high-pass undone"
        )
        return picture


def sensitivity(curves: Curves) -> Figure:
    """Return the change of the inertia over errors of springs, levers, mass, effective mass."""
    with figure(6.2) as picture:
        ((springs, levers), (mass, factor)) = picture.subplots(2, 2)
        _fan(springs, curves.stiffness, curves.stiffness_change, "K")
        springs.set(title="Spring constants", xlabel="error of the spring constants (%)")
        _fan(levers, curves.lever, curves.lever_change, "L")
        levers.set(title="Levers", xlabel="error of the levers (%)")
        mass.plot(100 * curves.mass, 100 * curves.mass_change, color=AFTER)
        mass.set(title="Weighed mass of the springs", xlabel="error of the springs' mass (%)")
        factor.plot(curves.factor, 100 * curves.factor_change, color=AFTER)
        _mark_waves(factor, curves)
        factor.set(
            title="Effective mass of the springs", xlabel="effective mass, in parts of the mass"
        )
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


def uncertainties(*panels: tuple[str, Sequence[tuple[str, float]]]) -> Figure:
    """Return bars of uncertainties, (label, uncertainty in parts), under the title of a panel."""
    with figure(0.9 + 0.34 * max(len(bars) for _, bars in panels)) as picture:
        places = picture.subplots(1, len(panels), squeeze=False)[0]
        for axes, (title, bars), colour in zip(places, panels, (AFTER, OTHER), strict=False):
            _bars(axes, bars, colour)
            axes.set_title(title)
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
    axes.set(
        ylim=(len(bars) - 0.4, -0.6),
        xlim=(0, 1.15 * max(float(values.max()), 1e-9)),
        xlabel="standard uncertainty (% of the inertia)",
    )
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
