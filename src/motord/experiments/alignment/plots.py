"""Pictures of an alignment: rotor over vector, rests, torque over motion."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.alignment.rests import Rests
from motord.experiments.alignment.result import Alignment
from motord.report.style import AFTER, BEFORE, INK, figure

DIRECTIONS = ((1, AFTER, "forwards"), (-1, BEFORE, "backwards"))

DOTS = 4000
"""Dots of a cloud at most."""


def followed(stops: Rests) -> Figure:
    """Return the encoder's angle over the vector's at each stop, by amplitude and direction."""
    with figure(3.2) as picture:
        axes = picture.subplots()
        turns = stops.electrical_rad / (2 * np.pi), stops.encoder_rad / (2 * np.pi)
        for which, style in _kinds(stops):
            axes.plot(turns[0][which], turns[1][which], **style)
        axes.set(xlabel="current vector (electrical turns)", ylabel="encoder (turns)")
        picture.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
        return picture


def rests(result: Alignment) -> Figure:
    """Return how far rests are off in encoder points, before and after the fit."""
    points = result.points(1.0)
    electrical_deg = np.degrees(result.angle_rad * result.motor.pole_pairs) % 360
    still = result.rests[result.rests.still]
    with figure(3.2) as picture:
        left, right = picture.subplots(1, 2)
        for axes, values, label in (
            (left, points * result.deviation_rad, "deviation from the vector"),
            (right, points * result.residual_rad, "residual of the fit"),
        ):
            for which, style in _kinds(still):
                axes.plot(electrical_deg[which], values[which], **style)
            axes.set(
                xlim=(0, 360),
                xticks=range(0, 361, 60),
                xlabel="rotor's electrical angle (degrees)",
                ylabel=f"{label} (encoder points)",
            )
        picture.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=4)
        return picture


def torque_sign(motion_Nm: np.ndarray, torque_Nm: np.ndarray) -> Figure:
    """Return measured torque over that which the motion takes, (k,) Nm each."""
    with figure(3.2) as picture:
        axes = picture.subplots()
        every = slice(None, None, max(motion_Nm.size // DOTS, 1))
        axes.plot(
            motion_Nm[every], torque_Nm[every], linestyle="none", marker=".", color=AFTER,
            markersize=3, alpha=0.5,
        )  # fmt: skip
        if motion_Nm.size:
            ends = np.array([motion_Nm.min(), motion_Nm.max()])
            axes.plot(ends, ends, color=INK, linewidth=0.9)
        axes.set(xlabel="torque that the motion takes (Nm)", ylabel="measured torque (Nm)")
        return picture


def _kinds(stops: Rests) -> Iterator[tuple[np.ndarray, dict[str, Any]]]:
    """Yield which stops (n,) are of an amplitude and a direction, and how they are drawn."""
    amplitude_A = np.abs(stops.vector_A)
    for amplitude, marker in zip(np.unique(np.round(amplitude_A, 6)), "os^Dv<>p", strict=False):
        for sign, colour, name in DIRECTIONS:
            yield (
                (stops.direction == sign) & np.isclose(amplitude_A, amplitude),
                {
                    "linestyle": "none", "marker": marker, "color": colour, "markersize": 4,
                    "label": f"{amplitude:.3g} A {name}",
                },
            )  # fmt: skip
