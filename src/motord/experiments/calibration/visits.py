"""The visits of a quick calibration: which operating point next, by what the design says."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from motord.experiments.calibration.design import COGGING, Candidate, Design
from motord.sequencing.brake_servo import excitation_for, speed_held_rad_s
from motord.sequencing.continuous import END_S, SETTLE_S, SLOWER

TURNS = 2
"""Whole turns that are added at a time: errors come from how turns differ."""

LEAST_VISITS = 4
"""Points of TURNS turns without which there are no errors: see estimate.checks."""

COVERAGE = 2.5
"""Half-width in standard deviations: 95 %, with the few degrees of freedom of short captures."""

RIPPLE_PERCENT = 0.1
"""What the ripple is weighed by where it is no target."""

MOST_TURNS = 4
"""Turns of a point: what is known is looked at between points."""


@dataclass(frozen=True)
class Visit:
    """A candidate for some turns at a speed, backwards negative.

    duration_s: with the transition before it; half_widths: expected after it.
    """

    candidate: Candidate
    turns: int
    speed_Hz: float
    duration_s: float
    half_widths: Mapping[str, float]


@dataclass(frozen=True)
class Objective:
    """What half-widths mean in terms of the design's parameters.

    forms: by quantity, M with (half-width / COVERAGE)^2 = tr(M V); targets: of half-widths.
    """

    forms: Mapping[str, np.ndarray]
    targets: Mapping[str, float]

    @classmethod
    def of(
        cls, design: Design, targets: Mapping[str, float], torques_Nm: Sequence[float]
    ) -> "Objective":
        """torques_Nm: of the mesh for which the ripple counts."""
        size = design.parameters
        ratios = 100**2 * (np.eye(3) - 1 / 3) / 2  # alpha has the product 1
        offsets = np.eye(3) / 3
        if not design.offset_seen:  # sum of beta = 0 then
            offsets = offsets - 1 / 9
        lines = (100 / (COGGING * design.rated_Nm)) ** 2 * np.eye(2 * len(size.orders))
        forms = {"ripple_percent": 100.0**2 * design.ripple(torques_Nm)}
        for name, place, form in (
            ("alpha_percent", slice(0, 3), ratios),
            ("beta_A", slice(3, 6), offsets),
            ("cogging_percent", size.cogging, lines),
        ):
            forms[name] = np.zeros((size.all, size.all))
            forms[name][place, place] = form
        return cls(forms, targets)

    def half_widths(self, covariance: np.ndarray) -> dict[str, float]:
        """Return what is expected of each quantity."""
        return {
            name: COVERAGE * math.sqrt(float((form * covariance).sum()))
            for name, form in self.forms.items()
        }

    @cached_property
    def weights(self) -> np.ndarray:
        """The form that is to become small: of all targets, each in parts of itself.

        The ripple's among them, so that gains, offsets and cogging torque are separated.
        """
        targets = {"ripple_percent": RIPPLE_PERCENT, **self.targets}
        return np.asarray(sum(self.forms[name] / targets[name] ** 2 for name in targets))


def visits(
    design: Design, objective: Objective, speed_Hz: float, rate_Nm_per_s: float, limit_s: float
) -> list[Visit]:
    """Return the visits that tell most in `limit_s`, each chosen after those before it.

    speed_Hz: at the largest torque; at constant excitation each torque has a speed of its own.
    """
    largest_Nm = max(one.mean_torque_Nm for one in design.candidates)
    excitation = excitation_for(design.brake, largest_Nm, 2 * math.pi * speed_Hz)
    speeds_Hz = [
        speed_held_rad_s(design.brake, excitation, one.mean_torque_Nm) / (2 * math.pi)
        for one in design.candidates
    ]
    turn = TURNS * np.array(
        [design.information(c, s) for c, s in zip(design.candidates, speeds_Hz, strict=True)]
    )
    turn_s = TURNS / (SLOWER * np.abs(speeds_Hz))
    ramp_s = np.array([one.torque_Nm for one in design.candidates]) / rate_Nm_per_s
    found: list[Visit] = []
    known, left_s, at = design.prior, limit_s - END_S, -1
    while True:
        transition_s = np.abs(ramp_s - (ramp_s[at] if at >= 0 else 0.0)) + SETTLE_S
        longer = len(found) >= LEAST_VISITS and found[-1].turns < MOST_TURNS
        if longer:
            transition_s[at] = 0.0
        visit_s = transition_s + turn_s
        now, then = np.linalg.inv(known), np.linalg.inv(known + turn)
        gain = (objective.weights * (now - then)).sum(axis=(1, 2)) / visit_s
        gain[visit_s + np.abs(ramp_s) > left_s] = 0.0
        if 0 < len(found) < LEAST_VISITS:
            gain[at] = 0.0
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            return found
        known, left_s = known + turn[best], left_s - visit_s[best]
        visit = Visit(
            design.candidates[best],
            TURNS,
            speeds_Hz[best],
            float(visit_s[best]),
            objective.half_widths(then[best]),
        )
        if best == at and longer:
            last = found.pop()
            longer_s = last.duration_s + visit.duration_s
            visit = replace(visit, turns=last.turns + TURNS, duration_s=longer_s)
        found.append(visit)
        at = best
