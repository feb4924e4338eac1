"""`inertia-oscillation` and `inertia-acceleration`: releases of a bar, and steps of torque.

Somebody deflects the bar between its springs, holds it still and lets go; the plan sees that by
itself. The power stage is off then: no current may act on the rotor. The steps are of the motor's
own torque, from rest and with the brake open.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import AccelerationConfig, BrakeConfig, Config, OscillationConfig
from motord.experiments.inertia.motions import release, release_s, torque_step, torque_step_s
from motord.sequencing import OperatingPoint, Plan
from motord.sequencing.capture import retaken_if_poor
from motord.sequencing.limits import check_speed, check_torque
from motord.sequencing.motions import Motion, enable, ramp_down
from motord.sequencing.settings import chosen, compensation

OSCILLATION, ACCELERATION = "inertia-oscillation", "inertia-acceleration"


def make_oscillation(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.inertia-oscillation]` with `settings`. Raises PlanError."""
    own = chosen(config, OSCILLATION, OscillationConfig, settings)
    return Plan(
        name=OSCILLATION,
        points=tuple(
            OperatingPoint(index, 0.0, 0.0, 0, aim="a release") for index in range(own.repeats)
        ),
        motion=partial(releases, own),
        point_s=partial(release_s, own),
        settings=own.model_dump(mode="json"),
        needs="",
        ends_s=0.0,
    )


def make_acceleration(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.inertia-acceleration]` with `settings`. Raises PlanError."""
    given = dict(settings)
    applied = given.pop("compensate", "off")
    flags = compensation(applied)
    own = chosen(config, ACCELERATION, AccelerationConfig, given, "compensate")
    check_torque(config, own.torque_Nm)
    check_speed(config, own.stop_speed_Hz)
    torques_Nm = [own.torque_Nm * (-1) ** index for index in range(own.repeats)]
    return Plan(
        name=ACCELERATION,
        points=tuple(
            OperatingPoint(index, torque_Nm, 0.0, 0, aim=f"a torque step of {torque_Nm:g} Nm")
            for index, torque_Nm in enumerate(torques_Nm)
        ),
        motion=partial(torque_steps, own, config.brake, int(flags)),
        point_s=partial(torque_step_s, own, config.brake),
        settings={**own.model_dump(mode="json"), "compensate": applied},
    )


def releases(own: OscillationConfig, points: tuple[OperatingPoint, ...]) -> Motion[None]:
    """Wait for one release after the other."""
    for point in points:
        yield from retaken_if_poor(release, point, own)


def torque_steps(
    own: AccelerationConfig, brake: BrakeConfig, compensate: int, points: tuple[OperatingPoint, ...]
) -> Motion[None]:
    """Enable, take every step of torque, ramp down."""
    yield from enable(compensate)
    for point in points:
        yield from retaken_if_poor(torque_step, point, own, brake)
    yield from ramp_down()
