"""`inertia-acceleration`: steps of the motor's own torque from rest, with the brake open."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import AccelerationConfig, BrakeConfig, Config
from motord.experiments.inertia.push_motion import TakePush
from motord.sequencing.limits import check_speed, check_torque
from motord.sequencing.settings import chosen, compensation
from motord.sequencing.steps import Enable, OperatingPoint, Plan, Rest, Steps

NAME = "inertia-acceleration"


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.inertia-acceleration]` with `settings`. Raises PlanError."""
    given = dict(settings)
    word = given.pop("compensate", "off")
    compensate = int(compensation(word))
    push = chosen(NAME, config.plans.inertia_acceleration, given, "compensate")
    check_torque(config, push.torque_Nm)
    check_speed(config, push.stop_speed_Hz)
    return Plan(
        name=NAME,
        points=tuple(
            OperatingPoint(index, torque_Nm, 0.0, 0, aim=f"a push of {torque_Nm:g} Nm")
            for index in range(push.repeats)
            for torque_Nm in (push.torque_Nm * (-1) ** index,)
        ),
        make_steps=partial(steps, push, config.brake, compensate),
        estimate_s=partial(seconds, push, config.brake),
        settings={**push.model_dump(mode="json"), "compensate": word},
    )


def steps(
    push: AccelerationConfig,
    brake: BrakeConfig,
    compensate: int,
    points: tuple[OperatingPoint, ...],
) -> Steps:
    """Yield the steps: enable, every push, rest."""
    yield Enable(compensate=compensate)
    for point in points:
        yield TakePush(point, push, brake)
    yield Rest()


def seconds(
    push: AccelerationConfig, brake: BrakeConfig, points: tuple[OperatingPoint, ...]
) -> float:
    """Return an estimate of the whole time (s)."""
    return 1.5 + sum(TakePush(point, push, brake).seconds() for point in points)
