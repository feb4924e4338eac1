"""The report of an alignment: what was found, how the rotor followed, what the zero rests on."""

from dataclasses import dataclass

import numpy as np

from motord.experiments.alignment.plots import followed, rests, torque_sign
from motord.report.html import Page


@dataclass(frozen=True)
class AlignReport:
    """All that goes into the page.

    fields: (name, value) of `[motor]` as found; told: as they were. Over all n stops: vector_turns,
    encoder_turns (n,), amplitude_A (n,), way (n,) 1 or -1, still (n,). Over the m stops at which
    the rotor rested: electrical_deg, apart_points and left_points (m,), in encoder points.
    motion_Nm, torque_Nm (k,): torque that the motion takes, and that was measured.
    """

    title: str
    lead: str
    facts: tuple[tuple[str, str], ...]
    fields: tuple[tuple[str, str], ...]
    told: tuple[str, ...]
    stderr_points: float
    pole_pairs: float
    friction_Nm: float
    friction_points: float
    counts: int
    vector_turns: np.ndarray
    encoder_turns: np.ndarray
    amplitude_A: np.ndarray
    way: np.ndarray
    still: np.ndarray
    electrical_deg: np.ndarray
    apart_points: np.ndarray
    left_points: np.ndarray
    motion_Nm: np.ndarray
    torque_Nm: np.ndarray
    explained: float
    notes: tuple[str, ...]


def page(data: AlignReport) -> Page:
    """Return a page of its own."""
    made = Page(data.title, data.lead)
    made.table([], data.facts)
    fill(made, data)
    return made


def fill(page: Page, data: AlignReport) -> None:
    """Add the alignment to a page."""
    page.heading("Encoder and phases, found by turning a current vector")
    page.table(
        ["[motor]", "found", "as it was told"],
        [[name, value, told] for (name, value), told in zip(data.fields, data.told, strict=True)],
    )
    page.points(
        [
            f"Zero known to \u00b1{1.96 * data.stderr_points:.2f} encoder points (95 %), and to a "
            "whole electrical turn.",
            f"The rotor turns 1/{data.pole_pairs:.3f} of a turn for each electrical turn.",
            f"Friction leaves {1e3 * data.friction_Nm:.0f} mNm at rest, RMS, which takes a single "
            f"stop {data.friction_points:.2f} encoder points off.",
            *data.notes,
        ]
    )
    page.picture(
        followed(data.vector_turns, data.encoder_turns, data.amplitude_A, data.way),
        "Where the rotor was at each stop of the current vector. It goes down where the encoder "
        "counts against the order of the phases; the slope is one over the pole pairs.",
    )
    page.picture(
        rests(
            data.electrical_deg,
            data.apart_points,
            data.left_points,
            data.way[data.still],
            data.amplitude_A[data.still],
        ),
        "How far the rotor rested from where the vector alone would take it, in encoder points, "
        "and what is left once cogging torque, unequal currents and their offsets are taken into "
        "account: friction.",
    )
    page.picture(
        torque_sign(data.motion_Nm, data.torque_Nm),
        "Torque that the rotor's swings take, by its inertia and damping, and the torque that the "
        f"sensor measured: {100 * data.explained:.0f} % of its variance. A rising line: the way "
        "called forwards is that of positive torque.",
    )
