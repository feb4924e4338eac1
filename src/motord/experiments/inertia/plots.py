"""Releases of a bar between springs, and steps of torque: what was measured and what was fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from motord.report.style import AFTER, BEFORE, INK, OTHER, REFERENCE, SOFT, drawing, figure


@dataclass(frozen=True)
class Swings:
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


@dataclass(frozen=True)
class Pushes:
    """Steps of torque: (t_s, angle_rad, torque_Nm, fitted_s, fitted_rad) each, in one direction."""

    steps: tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], ...]


def swings(data: Swings) -> Figure:
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


def pushes(data: Pushes) -> Figure:
    """Return angle and torque of all steps over time, those backwards turned round."""
    with drawing():
        picture = figure(3.4)
        left, right = picture.subplots(1, 2)
        for number, (t_s, angle_rad, torque_Nm, fitted_s, fitted_rad) in enumerate(data.steps):
            sign = np.sign(angle_rad[-1])
            first = number == 0
            left.plot(
                1e3 * t_s, sign * angle_rad, color=AFTER, linewidth=2.2, alpha=0.45,
                label="encoder" if first else None,
            )  # fmt: skip
            left.plot(
                1e3 * fitted_s, sign * fitted_rad, color=REFERENCE, linewidth=0.8,
                label="fit" if first else None,
            )  # fmt: skip
            right.plot(1e3 * t_s, sign * torque_Nm, color=OTHER, linewidth=0.6, alpha=0.6)
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
