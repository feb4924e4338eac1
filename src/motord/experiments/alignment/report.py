"""The report of an alignment: what was found, how the rotor followed, what the zero rests on."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.alignment.rests import Rests
from motord.experiments.alignment.result import Alignment
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus, two_digits
from motord.report.html import Page, Verbatim
from motord.report.style import AFTER, BEFORE, INK, figure

DIRECTIONS = ((1, AFTER, "forwards"), (-1, BEFORE, "backwards"))

DOTS = 4000
"""Dots of a cloud at most."""


def report(result: Alignment, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Phase order, encoder direction and zero", recordings.subject.lead)
    zero = plus_minus(result.offset_rad, result.offset_half_width_rad)
    page.cards(
        [
            (result.phase_order, "phase order"),
            (f"{result.direction:+d}", "encoder direction"),
            (f"{zero} rad", "encoder zero, 95 %"),
        ]
    )
    page.paragraph(f"{result.agreement[0].upper()}{result.agreement[1:]}.")
    page.facts(recordings.facts)
    page.heading("Encoder and phases, found by turning a current vector")
    page.table(
        ["[motor]", "found", "bench file"],
        [
            [name, Verbatim(new), Verbatim(result.configured[name])]
            for name, new in result.fields.items()
        ],
    )
    page.points(
        [
            f"Zero known to \u00b1{result.offset_half_width_points:.2g} encoder points (95 %), "
            "and to a whole electrical turn.",
            f"[accuracy] encoder_zero_rad = {result.accuracy_fields['encoder_zero_rad']}: the "
            "limit of a rectangular distribution with the zero's combined standard uncertainty, "
            "that of the rests and that of the encoder's own error.",
            f"The rotor turns 1/{result.pole_pairs:.3f} of a turn for each electrical turn.",
            f"Friction leaves {two_digits(1e3 * result.friction_Nm)} mNm at rest, RMS, which "
            f"takes a single stop {result.friction_points:.2f} encoder points off.",
        ]
    )
    _pictures(page, result)
    return page


def _pictures(page: Page, result: Alignment) -> None:
    page.picture(
        followed(result.rests),
        "Where the rotor was at each stop of the current vector. It goes down where the encoder "
        "counts against the order of the phases; the slope is one over the pole pairs.",
    )
    page.picture(
        rests(result),
        "How far the rotor rested from where the vector alone would take it, in encoder points, "
        "and the residual of the fit, which takes cogging torque, unequal currents and their "
        "offsets into account: friction.",
    )
    response = result.torque_response
    page.picture(
        torque_sign(response.motion_Nm, response.torque_Nm),
        "Torque that the rotor's oscillations take, by its inertia and damping, and the torque "
        f"that the sensor measured: {100 * response.explained[0]:.0f} % of its variance. A rising "
        "line: forwards is the direction of positive torque.",
    )


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
            (left, points * result.deviation_rad, "deviation"),
            (right, points * result.residual_rad, "residual"),
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
