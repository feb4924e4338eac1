"""`sensitivity`: known errors induced on a calibrated bench, one operating point each.

Poels 2008, section 4.4: gains, offsets, cogging torque and delta epsilon are put wrong on purpose,
and the torque's ripple is measured (Figures 4.6 to 4.9). A small mesh with one set of gains and
offsets induced follows, to be calibrated from again (Table 4.2).
"""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from motord.config import Config, MeshConfig
from motord.config.plans import SensitivityConfig
from motord.schema import Compensation
from motord.sequencing import NOTHING_INDUCED, Induced, OperatingPoint, Plan, PlanError
from motord.sequencing.limits import check_current, check_operating_points
from motord.sequencing.mesh import operating_points, serpentine
from motord.sequencing.operating_point import operating_point_s
from motord.sequencing.settings import chosen, compensation

NAME = "sensitivity"

COMPENSATE: Compensation = "calibration"
"""What is applied: the calibration, but nothing learned, which would be of a torque without error.
"""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.sensitivity]` with `settings`. Raises PlanError."""
    given = dict(settings)
    if given.pop("compensate", COMPENSATE) != COMPENSATE:
        raise PlanError(
            f"{NAME}: errors are induced where all else is compensated: compensate is always "
            f"{COMPENSATE!r}"
        )
    if config.inverter.q_only:
        raise PlanError(
            f"{NAME}: the drive takes current along q alone, so the phases cannot have errors of "
            "their own induced"
        )
    own = chosen(config, NAME, SensitivityConfig, given)
    taken = points(own)
    if not taken:
        raise PlanError(f"{NAME}: all steps are 0 and there is no mesh: nothing to do")
    for point in taken:
        torque_Nm = point.torque_Nm * sum(point.induced.gain) / 3  # of its currents, about
        check_operating_points(config, (torque_Nm,), (point.speed_Hz,))
        check_current(config, max(map(abs, point.induced.offset_A)))
    mesh = MeshConfig(
        turns=own.turns,
        settle_s=own.settle_s,
        settle_timeout_s=own.settle_timeout_s,
        speed_tolerance=own.speed_tolerance,
    )
    return Plan(
        name=NAME,
        points=taken,
        motion=partial(operating_points, mesh, config.brake, int(compensation(COMPENSATE))),
        point_s=partial(operating_point_s, mesh, config.brake),
        settings={**own.model_dump(mode="json"), "compensate": COMPENSATE},
    )


def points(own: SensitivityConfig) -> tuple[OperatingPoint, ...]:
    """Return the points: single errors at one torque and speed, then the mesh with all of them.

    The point without any error belongs to all four and is taken once.
    """
    singles = list(dict.fromkeys(_singles(own)))
    places = [(own.torque_Nm, own.speed_Hz, induced) for induced in singles]
    again = Induced(gain=own.again_alpha, offset_A=own.again_beta_A)
    mesh = serpentine(own.again_torques_Nm, own.again_speeds_Hz)
    places += [(torque_Nm, speed_Hz, again) for torque_Nm, speed_Hz in mesh]
    return tuple(
        OperatingPoint(index, torque_Nm, speed_Hz, own.turns, induced)
        for index, (torque_Nm, speed_Hz, induced) in enumerate(places)
    )


def _singles(own: SensitivityConfig) -> Iterator[Induced]:
    """Yield errors of one kind each; gains have the product 1, offsets the sum 0."""
    for a in _steps_of(own.alpha_a, own.alpha_a_steps):
        other = float(a**-0.5)
        yield Induced(gain=(a, other, other))
    for b in _steps_of(own.beta_a_A, own.beta_a_steps):
        yield Induced(offset_A=(b, -b / 2, -b / 2)) if b else NOTHING_INDUCED
    for factor in _steps_of(own.cogging, own.cogging_steps):
        yield Induced(cogging=factor)
    for taken_for in _steps_of(own.delta_epsilon, own.delta_epsilon_steps):
        gain = 1.0 / taken_for  # the compensation divides by it
        yield Induced(gain=(gain, gain, gain))


def _steps_of(interval: tuple[float, float], steps: int) -> list[float]:
    """Return even steps over an interval, rounded so that the ideal is met exactly."""
    values: list[float] = np.round(np.linspace(*interval, steps), 12).tolist()
    return values
