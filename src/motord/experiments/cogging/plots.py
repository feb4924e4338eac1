"""Pictures of a cogging run: spectra, torque over a turn, errors."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, BEFORE, GRID, REFERENCE, figure

PERIODS_SHOWN = 6
"""Periods of the main order in the close view."""

CURVE_POINTS = 4096
"""Points of a curve at most."""


def spectra(speeds: Sequence[tuple[str, np.ndarray]], allowed: Sequence[int]) -> Figure:
    """Return amplitudes (Nm) of orders 1 to m of each speed, (label, (m,)), allowed ones marked."""
    with figure(3.4) as picture:
        axes = picture.subplots()
        highest = max(amplitude.size for _, amplitude in speeds)
        for marked in allowed:
            axes.axvline(marked, color=GRID, linewidth=4.0, zorder=0)
        for (label, amplitude), colour in zip(speeds, _shades(len(speeds)), strict=True):
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
        for (label, error), colour in zip(speeds, _shades(len(speeds)), strict=True):
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


def _shades(number: int) -> list[tuple[float, float, float, float]]:
    """Return colours from slow to fast."""
    return [colormaps["viridis"](x) for x in np.linspace(0.1, 0.85, max(number, 2))][:number]


def _speeds_legend(picture: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside upper right", ncols=min(len(labels), 8))
