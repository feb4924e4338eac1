"""Pictures of an alignment: rotor over vector, rests, torque over motion."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, BEFORE, INK, drawing, figure

WAYS = ((1, AFTER, "forwards"), (-1, BEFORE, "backwards"))

DOTS = 4000
"""Dots of a cloud at most."""


def followed(
    vector_turns: np.ndarray, encoder_turns: np.ndarray, amplitude_A: np.ndarray, way: np.ndarray
) -> Figure:
    """Return the encoder's angle over the vector's, (n,) turns each, by amplitude and way."""
    with drawing():
        picture = figure(3.2)
        axes = picture.subplots()
        for amplitude, marker in _markers(amplitude_A):
            for sign, colour, word in WAYS:
                which = (way == sign) & np.isclose(amplitude_A, amplitude)
                axes.plot(
                    vector_turns[which], encoder_turns[which], linestyle="none", marker=marker,
                    color=colour, markersize=4, label=f"{amplitude:.3g} A {word}",
                )  # fmt: skip
        axes.set_xlabel("current vector (electrical turns)")
        axes.set_ylabel("encoder (turns)")
        _legend(picture, axes)
        return picture


def rests(
    electrical_deg: np.ndarray,
    apart_points: np.ndarray,
    left_points: np.ndarray,
    way: np.ndarray,
    amplitude_A: np.ndarray,
) -> Figure:
    """Return how far rests (n,) are off in encoder points, before and after the fit."""
    with drawing():
        picture = figure(3.2)
        left, right = picture.subplots(1, 2)
        for amplitude, marker in _markers(amplitude_A):
            for sign, colour, word in WAYS:
                which = (way == sign) & np.isclose(amplitude_A, amplitude)
                for axes, values in ((left, apart_points), (right, left_points)):
                    axes.plot(
                        electrical_deg[which], values[which], linestyle="none", marker=marker,
                        color=colour, markersize=4, label=f"{amplitude:.3g} A {word}",
                    )  # fmt: skip
        for axes, words in ((left, "from the vector"), (right, "not explained")):
            axes.set_xlim(0, 360)
            axes.set_xticks(range(0, 361, 60))
            axes.set_xlabel("rotor's electrical angle (degrees)")
            axes.set_ylabel(f"{words} (encoder points)")
        _legend(picture, left)
        return picture


def torque_sign(motion_Nm: np.ndarray, torque_Nm: np.ndarray) -> Figure:
    """Return measured torque over that which the motion takes, (k,) Nm each."""
    with drawing():
        picture = figure(3.2)
        axes = picture.subplots()
        every = slice(None, None, max(motion_Nm.size // DOTS, 1))
        axes.plot(
            motion_Nm[every], torque_Nm[every], linestyle="none", marker=".", color=AFTER,
            markersize=3, alpha=0.5,
        )  # fmt: skip
        if motion_Nm.size:
            ends = np.array([motion_Nm.min(), motion_Nm.max()])
            axes.plot(ends, ends, color=INK, linewidth=0.9)
        axes.set_xlabel("torque that the motion takes (Nm)")
        axes.set_ylabel("measured torque (Nm)")
        return picture


def _markers(amplitude_A: np.ndarray) -> list[tuple[float, str]]:
    found = np.unique(np.round(amplitude_A, 6))
    return list(zip(found.tolist(), "os^Dv<>p", strict=False))


def _legend(picture: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside upper left", ncols=4)
