"""Torque over one turn and its spectrum over the orders, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, BEFORE, SOFT, figure

COLOURS = {"before": BEFORE, "after": AFTER}

FLOOR_DECADES = 4
"""Whole decades that the spectrum shows below the one of the largest amplitude."""
MOST_NUMBERS = 16
"""So many orders of three digits have room below the spectrum."""


@dataclass(frozen=True)
class TorqueCurve:
    """Torque without its mean at one operating point.

    angle_rad, torque_Nm (n,): over one turn; order, amplitude_Nm (m,): its spectrum; noise_Nm
    (m,): standard error of the amplitudes, if it is known.
    """

    angle_rad: np.ndarray
    torque_Nm: np.ndarray
    order: np.ndarray
    amplitude_Nm: np.ndarray
    noise_Nm: np.ndarray | None = None


def over_angle_and_order(
    before: TorqueCurve | None, after: TorqueCurve | None, marked_orders: Sequence[int]
) -> Figure:
    """Return torque over the turn above its spectrum; `marked_orders` get a tick with a number."""
    ripples = {"before": before, "after": after}
    present = {name: ripple for name, ripple in ripples.items() if ripple is not None}
    with figure(6.0) as picture:
        upper, lower = picture.subplots(2, 1, height_ratios=[1.0, 1.1])
        for name, ripple in present.items():
            degrees = np.rad2deg(ripple.angle_rad)
            width = 1.6 if name == "after" else 0.9
            upper.plot(degrees, ripple.torque_Nm, color=COLOURS[name], lw=width, label=name)
        upper.set(xlim=(0, 360), xticks=range(0, 361, 45), xlabel="mechanical angle (degrees)")
        upper.set(ylabel="torque less mean (Nm)", title="Torque over one turn")
        upper.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
        _spectrum(lower, present, marked_orders)
        return picture


def _spectrum(axes: Axes, ripples: dict[str, TorqueCurve], marked_orders: Sequence[int]) -> None:
    highest = _highest(list(ripples.values()), marked_orders)
    floor_Nm = _floor_Nm(list(ripples.values()))
    for name, ripple in ripples.items():
        shown = ripple.order <= highest
        offset = 0.0 if len(ripples) == 1 else (-0.3 if name == "before" else 0.3)
        size = np.maximum(ripple.amplitude_Nm[shown], floor_Nm)
        axes.vlines(ripple.order[shown] + offset, floor_Nm, size, color=COLOURS[name], lw=1.6)
        if ripple.noise_Nm is not None and name == list(ripples)[-1]:
            axes.plot(
                ripple.order[shown], ripple.noise_Nm[shown], color=SOFT, lw=1.2, ls=(0, (4, 3)),
                label="noise",
            )  # fmt: skip
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    axes.set(yscale="log", xlim=(0, highest + 1), ylim=(floor_Nm, None))
    marked = [order for order in marked_orders if order <= highest]
    every = ceil(len(marked) / MOST_NUMBERS) or 1
    axes.set_xticks(marked[every - 1 :: every])
    axes.grid(visible=False, axis="x")
    axes.set(xlabel="order (per turn)", ylabel="amplitude (Nm)")
    axes.set_title("Spectrum over the orders of a turn")


def _floor_Nm(ripples: list[TorqueCurve]) -> float:
    """Return the lower end of the spectrum."""
    largest_Nm = max(float(ripple.amplitude_Nm.max()) for ripple in ripples)
    decade = floor(log10(largest_Nm)) if largest_Nm > 0 else 0
    return float(10.0 ** (decade - FLOOR_DECADES))


def _highest(ripples: list[TorqueCurve], marked_orders: Sequence[int]) -> int:
    """Return the last order worth showing: the last marked one with anything in it, and a bit."""
    last = min(int(ripple.order[-1]) for ripple in ripples)
    strongest = max(float(ripple.amplitude_Nm.max()) for ripple in ripples)
    busy = [
        order
        for order in marked_orders
        if order <= last
        and any(ripple.amplitude_Nm[order - 1] > 0.003 * strongest for ripple in ripples)
    ]
    return min(last, int(1.15 * max(busy, default=last)))
