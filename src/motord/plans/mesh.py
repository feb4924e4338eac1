"""`calibrate` and `verify`: the torque/speed mesh, point by point."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import BrakeConfig, Config, MeshConfig
from motord.plans.brake_servo import BrakeServo
from motord.plans.limits import check_held
from motord.plans.settings import chosen, compensation
from motord.plans.steps import Enable, OperatingPoint, Plan, Rest, Steps
from motord.plans.take_point import TakePoint


def make(name: str, config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan over the mesh of `[plans.NAME]` with `settings`. Raises PlanError."""
    given = dict(settings)
    word = given.pop("compensate", "off" if name == "calibrate" else "on")
    compensate = compensation(word)
    own: MeshConfig = getattr(config.plans, name)
    mesh = chosen(name, own, given, "compensate")
    check_held(config, mesh.torques_Nm, mesh.speeds_Hz)
    return Plan(
        name=name,
        points=points(mesh),
        make_steps=partial(steps, mesh, config.brake, int(compensate)),
        estimate_s=partial(seconds, mesh, config.brake),
        settings={**mesh.model_dump(mode="json"), "compensate": word},
    )


def points(mesh: MeshConfig) -> tuple[OperatingPoint, ...]:
    """Return the points, torque by torque, speeds up and down in turn so that steps are small."""
    ordered = []
    for row, torque_Nm in enumerate(mesh.torques_Nm):
        speeds_Hz = mesh.speeds_Hz if row % 2 == 0 else tuple(reversed(mesh.speeds_Hz))
        ordered += [(torque_Nm, speed_Hz) for speed_Hz in speeds_Hz]
    return tuple(
        OperatingPoint(index, torque_Nm, speed_Hz, mesh.turns)
        for index, (torque_Nm, speed_Hz) in enumerate(ordered)
    )


def steps(
    mesh: MeshConfig, brake: BrakeConfig, compensate: int, points: tuple[OperatingPoint, ...]
) -> Steps:
    """Yield the steps: enable, every point, rest."""
    servo = BrakeServo(brake)
    yield Enable(compensate=compensate)
    for point in points:
        yield TakePoint(point, mesh, servo)
    yield Rest()


def seconds(mesh: MeshConfig, brake: BrakeConfig, points: tuple[OperatingPoint, ...]) -> float:
    """Return an estimate of the whole time (s)."""
    servo = BrakeServo(brake)
    return 1.5 + sum(TakePoint(point, mesh, servo).seconds() for point in points)
