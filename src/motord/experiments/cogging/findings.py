"""What is questionable about a cogging run, each with its meaning and what to do."""

from collections.abc import Iterator
from math import sqrt

import numpy as np

from motord.experiments.cogging.at_speed import STANDS_OUT
from motord.experiments.cogging.result import MeasuredCogging
from motord.experiments.driven_findings import left_out_finding
from motord.findings import Finding
from motord.identification.rotor.driven_rotor import JERKY

STICKS = 5.0
"""Part of that limit from which on it is no swing that dies out, but the rotor sticks and slips."""

FEW_TURNS = 6
"""Turns in all below which the noise's colour is not known."""


def findings(found: MeasuredCogging, used_s: float) -> tuple[Finding, ...]:
    """Return what is questionable about the run; used_s: what of it was used."""
    return (
        *_orders(found),
        *_turns(found),
        *_motion(found),
        *_directions(found),
        *left_out_finding(found.left_out, used_s),
    )


def _orders(found: MeasuredCogging) -> Iterator[Finding]:
    seen = min(one.spectrum_Nm.size for one in found.speeds)
    if found.main_order not in found.order:
        yield Finding(
            "main-order-not-seen", found.main_order, seen, "order", "serious",
            f"the main order {found.main_order} is too high for the sampling or the encoder: "
            f"orders are seen up to {seen}; what it has is folded into others",
            "turn slower, sample faster or use a finer encoder",
        )  # fmt: skip
    others = ~found.allowed
    if others.any():
        largest = int(np.argmax(np.where(others, found.amplitude_Nm, 0)))
        yield Finding(
            "unexplained-orders", float(found.amplitude_Nm[largest]),
            STANDS_OUT * float(found.stderr_Nm[largest]), "Nm", "warning",
            "orders that neither slots nor poles explain stand out of the noise: "
            f"{', '.join(str(order) for order in found.order[others])}: a bearing, the belt, an "
            "eccentric rotor or encoder, or slots and pole_pairs are not right; they are no part "
            "of the cogging torque that is stated",
            "check slots and pole_pairs in [motor]; drive through another belt or coupling",
        )  # fmt: skip


def _turns(found: MeasuredCogging) -> Iterator[Finding]:
    turns = sum(one.turns for one in found.speeds)
    if turns < FEW_TURNS:
        yield Finding(
            "few-turns", turns, FEW_TURNS, "turns", "warning",
            "the standard errors take the noise to be white: so few turns do not show its colour",
            "take more turns",
        )  # fmt: skip


def _motion(found: MeasuredCogging) -> Iterator[Finding]:
    jerky = [one for one in found.speeds if one.jerky]
    if jerky:
        worst = max(one.motion_left_counts for one in jerky)
        at = ", ".join(f"{one.direction * one.speed_Hz:.3g} /s" for one in jerky)
        yield Finding(
            "jerky-motion", worst, JERKY / sqrt(12), "counts",
            "warning" if worst > STICKS * JERKY / sqrt(12) else "note",
            f"at {at} no smooth motion explains the encoder: the rotor sticks and slips, or swings "
            "as it starts. The counted angles themselves were fitted; where the sensor sees "
            "friction, that of the rests is taken for cogging torque in part",
            "drive faster, through a stiffer belt, or with more inertia; take both directions",
        )  # fmt: skip


def _directions(found: MeasuredCogging) -> Iterator[Finding]:
    if not found.directions:
        yield Finding(
            "one-direction", 1, 2, "directions", "note",
            "friction that ripples over the turn looks like cogging torque in one direction alone",
            "drive in the other direction, too",
        )  # fmt: skip
    apart = [one for one in found.directions if one.significant]
    if apart:
        worst = max(apart, key=lambda one: one.difference_Nm)
        yield Finding(
            "directions-differ", worst.difference_Nm, worst.limit_Nm, "Nm", "warning",
            f"orders {', '.join(str(one.order) for one in apart)} differ between the directions, "
            f"most order {worst.order}, by {worst.phase_rad:+.3f} rad in phase: half of it is "
            "ripple of friction or hysteresis, or the torque is older than the angle; the mean of "
            "both is stated",
            "compare at two speeds: a delay grows with it, friction does not",
        )  # fmt: skip
