"""alpha and beta of the phases with error bars, and those of a reference."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, OTHER, REFERENCE, figure

STYLES = ((AFTER, "o"), (OTHER, "s"))
"""Colour and marker of the first estimate and of the second."""


@dataclass(frozen=True)
class Gains:
    """alpha and beta_A (3,) as one method found them, and halves of 95 % intervals, if any."""

    label: str
    alpha: np.ndarray
    beta_A: np.ndarray
    alpha_half_width: np.ndarray | None = None
    beta_half_width_A: np.ndarray | None = None


def gains(estimates: Sequence[Gains], reference: Gains | None) -> Figure:
    """Return alpha and beta of each phase; with a reference, how far each is off it.

    Bars are 95 % intervals.
    """
    with figure(2.9) as picture:
        left, right = picture.subplots(1, 2)
        for row, estimate in enumerate(estimates):
            base = reference.alpha if reference else np.zeros(3)
            scale = 100 / base if reference else np.ones(3)
            errors = estimate.alpha_half_width
            _dots(
                left, estimate.label, row, len(estimates), (estimate.alpha - base) * scale,
                None if errors is None else errors * np.abs(scale),
            )  # fmt: skip
            offset_A = estimate.beta_A - (reference.beta_A if reference else 0.0)
            _dots(right, None, row, len(estimates), offset_A, estimate.beta_half_width_A)
        _label(left, "Phase gains \u03b1", reference, "%", "\u03b1")
        _label(right, "Phase offsets \u03b2", reference, "A", "\u03b2 (A)")
        picture.legend(loc="outside upper right", ncols=3, borderaxespad=0.1)
        return picture


def _dots(
    axes: Axes,
    label: str | None,
    row: int,
    rows: int,
    values: np.ndarray,
    half_width: np.ndarray | None,
) -> None:
    colour, marker = STYLES[row % len(STYLES)]
    y = np.arange(3) + 0.3 * (row - (rows - 1) / 2)
    axes.errorbar(
        values, y, xerr=half_width, fmt=marker, color=colour,
        markersize=6, capsize=3.5, elinewidth=1.4, label=label,
    )  # fmt: skip


def _label(axes: Axes, title: str, reference: Gains | None, unit: str, absolute: str) -> None:
    axes.set_title(title)
    axes.set_yticks(range(3), ["phase a", "phase b", "phase c"])
    axes.set_ylim(2.6, -0.6)
    axes.margins(x=0.12)
    axes.locator_params(axis="x", nbins=6)
    axes.grid(visible=False, axis="y")
    if reference is None:
        axes.set_xlabel(absolute)
        return
    label = reference.label if unit == "%" else None
    axes.axvline(0.0, color=REFERENCE, lw=1.6, label=label, zorder=1)
    axes.set_xlabel(f"difference from the {reference.label} ({unit})")
