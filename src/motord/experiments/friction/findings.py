"""What is questionable about coast-downs, each with its meaning and what to do."""

from collections.abc import Iterator, Sequence
from math import hypot, pi, sqrt

from motord.config import MotorConfig
from motord.experiments.friction.result import DirectionalFriction, Inertia
from motord.findings import Finding
from motord.identification.cluster_robust_ls import LEAST_TURNS
from motord.intervals import significant

RESIDUAL_COUNTS = 2.0
"""RMS of the residual, in that of the encoder's rounding, above which the model is not enough."""

RIPPLE_MAX = 0.4
"""Part of the least speed by which the cogging torque may change it."""


def findings(
    directions: Sequence[DirectionalFriction], motor: MotorConfig, inertia: Inertia
) -> tuple[Finding, ...]:
    """Return what is questionable, of each direction and of both."""
    found = [each for one in directions for each in _of_direction(one, motor, inertia)]
    both = _difference(*directions) if len(directions) == 2 else _one_alone(directions[0])
    return (*found, *both)


def _of_direction(
    one: DirectionalFriction, motor: MotorConfig, inertia: Inertia
) -> Iterator[Finding]:
    if one.coast_downs < LEAST_TURNS:
        yield Finding(
            "few-coast-downs", one.coast_downs, LEAST_TURNS, "coast-downs", "warning",
            f"{one.direction}: what differs between coast-downs is not in the intervals",
            "raise repeats",
        )  # fmt: skip
    rounding_rad = 2 * pi / motor.counts / sqrt(12)
    if one.residual_rad > RESIDUAL_COUNTS * rounding_rad:
        yield Finding(
            "residual", one.residual_rad, RESIDUAL_COUNTS * rounding_rad, "rad", "warning",
            f"{one.direction}: the angles differ from the fit by more than the encoder's "
            "rounding: another torque acts on the rotor, or its friction changes",
            "see the residual in the report; brake released? shaft free of cables and belt?",
        )  # fmt: skip
    yield from _windage(one)
    ripple = _ripple(one, inertia)
    if ripple > RIPPLE_MAX:
        yield Finding(
            "cogging-at-stop-speed", ripple, RIPPLE_MAX, "parts", "warning",
            f"{one.direction}: cogging torque changes the speed by up to {100 * ripple:.0f} % "
            f"near the least one, {one.speed_min_rad_s:.3g} rad/s: what is not known of it "
            "there looks like friction that changes with speed, such as a Stribeck part",
            "raise stop_speed_Hz",
        )  # fmt: skip


def _windage(one: DirectionalFriction) -> Iterator[Finding]:
    """Yield a finding where the friction has a part of the square of the speed."""
    windage = one.windage
    if windage.significant:
        yield Finding(
            "windage", abs(windage.torque_Nm), windage.limit_Nm, "Nm",
            "serious" if windage.beyond else "warning",
            f"{one.direction}: all coast-downs have a torque with the square of the speed, "
            f"{1e3 * windage.torque_Nm:+.3g} mNm at {one.speed_max_rad_s:.3g} rad/s, that Coulomb "
            "and viscous friction do not explain. Allowing for it changes Coulomb friction by "
            f"{1e3 * windage.coulomb_change_Nm:+.3g} mNm, viscous friction by "
            f"{1e3 * windage.viscous_change_Nm_s_per_rad:+.3g} mNm s/rad; the intervals "
            "are widened by that. It is windage, or a Stribeck part that fits no better, or, if "
            "negative, a bearing that warms",
            "use the curve within its speeds; take coast-downs from higher to lower speeds",
        )  # fmt: skip


def _one_alone(one: DirectionalFriction) -> Iterator[Finding]:
    yield Finding(
        "one-direction", 1.0, 2.0, "directions", "warning",
        f"all coast-downs turn {one.direction}: a constant torque, such as that "
        "of gravity or of a cable, looks like friction",
        "take coast-downs in the other direction, too",
    )  # fmt: skip


def _ripple(one: DirectionalFriction, inertia: Inertia) -> float:
    """Return the change of speed by the cogging torque's energy, in parts of the least speed."""
    energy_J = sum(2 * line.amplitude_Nm / line.order for line in one.cogging)
    fast_rad_s = sqrt(one.speed_min_rad_s**2 + 2 * energy_J / inertia.kg_m2)
    return fast_rad_s / one.speed_min_rad_s - 1.0


def _difference(forwards: DirectionalFriction, backwards: DirectionalFriction) -> Iterator[Finding]:
    """Yield a finding where Coulomb friction differs; the inertia is common to both."""
    apart_Nm = (forwards.coulomb_Nm.value or 0.0) - (backwards.coulomb_Nm.value or 0.0)
    limit_Nm = hypot(forwards.coulomb_fit_Nm, backwards.coulomb_fit_Nm)
    if abs(apart_Nm) > limit_Nm:
        yield Finding(
            "directions-differ", abs(apart_Nm), limit_Nm, "Nm", "note",
            f"Coulomb friction is {significant(1e3 * abs(apart_Nm), 3)} mNm more "
            f"{'forwards' if apart_Nm > 0 else 'backwards'}: half of it is a torque that acts in "
            "one direction whatever way the rotor turns, or bearing and seal differ",
            "use the value of each direction; look for a cable or a belt on the shaft",
        )  # fmt: skip
