"""What is questionable about a cogging run, each with its meaning and what to do."""

from collections.abc import Iterator
from math import pi, sqrt

import numpy as np

from motord.experiments.cogging.at_speed import STANDS_OUT
from motord.experiments.cogging.result import MeasuredCogging
from motord.experiments.driven_rotor import left_out_finding
from motord.experiments.signal_findings import beyond_rated
from motord.findings import Finding
from motord.identification.rotor.driven_rotor import JERKY
from motord.intervals import two_digits

STICKS = 5.0
"""Part of that limit from which on it is no swing that dies out, but the rotor sticks and slips."""

FEW_TURNS = 6
"""Turns in all below which the noise's colour is not known."""


def findings(found: MeasuredCogging, used_s: float) -> tuple[Finding, ...]:
    """Return what is questionable about the run; used_s: what of it was used."""
    return (
        *_scale(found),
        *_orders(found),
        *_encoder(found),
        *_turns(found),
        *_motion(found),
        *_directions(found),
        *_speeds(found),
        *left_out_finding(found.left_out, used_s),
    )


def _scale(found: MeasuredCogging) -> Iterator[Finding]:
    rated_Nm = found.motor.rated_torque_Nm
    if found.peak_Nm > rated_Nm:
        yield beyond_rated("the cogging torque", found.peak_Nm, rated_Nm, "Nm")


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


def _encoder(found: MeasuredCogging) -> Iterator[Finding]:
    """Yield a finding for an angle that is off once or twice a turn; named as `calibrate` does."""
    order, size_Nm = found.order[found.allowed], found.amplitude_Nm[found.allowed]
    for one in found.encoder:
        parts = one.lost(order)
        largest = np.argsort(-parts * size_Nm)[:3]
        texts = [f"{order[n]} by {two_digits(1e3 * parts[n] * size_Nm[n])} mNm" for n in largest]
        yield Finding(
            f"encoder-error-order-{one.order}", float(np.degrees(one.error_rad)),
            float(np.degrees(one.limit_rad)), "deg", "serious" if one.serious else "note",
            "orders of the cogging torque have sidebands as of an encoder that is "
            f"{'oval or misaligned' if one.order > 1 else 'eccentric'}: the "
            f"orders stated are too small, order {', '.join(texts)} (up to "
            f"{100 * float(parts.max()):.2g} %); the intervals are widened by that, by as much "
            "also to the other side, and what the sidebands have is missing in the torque",
            "centre and align the encoder's disc on its shaft and measure again",
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
        worst = max(one.motion_residual_counts for one in jerky)
        at = ", ".join(f"{one.direction * one.speed_Hz:.3g} turns/s" for one in jerky)
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
            "friction that ripples over the turn looks like cogging torque in one direction alone; "
            "play between rotor and encoder, and hysteresis of the torque sensor, turn all phases",
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


def _speeds(found: MeasuredCogging) -> Iterator[Finding]:
    apart = found.differences
    if apart.age_s.significant:
        age_us = 1e6 * apart.age_s.size
        yield Finding(
            "torque-age", abs(age_us), 1e6 * apart.age_s.limit, "us", "serious",
            f"phases fall behind in proportion to order and speed, as of a torque {age_us:.3g} us "
            "older than the angle: a low-pass or averaging of the torque channel, or an encoder "
            "that is read at another time; stated phases are off by order times speed times that",
            "sample both at the same time, or raise the corner of the torque channel's filter",
        )  # fmt: skip
    if apart.shift_rad.significant:
        points = found.motor.counts / (2 * pi)
        yield Finding(
            "angle-slips", points * apart.shift_rad.size, points * apart.shift_rad.limit, "counts",
            "serious",
            "the angle is another at each speed, for all orders alike: the encoder slips on its "
            "shaft or loses counts, or a low-pass or resonance turns orders by more than an age",
            "tighten the encoder's coupling, check its lines, and repeat a speed",
        )  # fmt: skip
    if apart.gain.significant:
        yield Finding(
            "speeds-differ", 100 * apart.gain.size, 100 * apart.gain.limit, "%", "warning",
            "amplitudes differ between the speeds: the torque sensor's gain drifts as it warms, or "
            "its channel has a low-pass or a resonance that [torque_sensor] does not state",
            "warm up, repeat a speed: what comes back with it is of the frequency; correct "
            "resonance_Hz and damping_ratio",
        )  # fmt: skip
