"""`calibrate` and `verify`: the torque/speed mesh, point by point."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from motord.config import BrakeConfig, CalibrateConfig, Config, MeshConfig
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.limits import check_held
from motord.sequencing.operating_point import TakePoint
from motord.sequencing.settings import chosen, compensation
from motord.sequencing.steps import Enable, Induced, OperatingPoint, Plan, Rest, Steps


def make(name: str, config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan over the mesh of `[plans.NAME]` with `settings`. Raises PlanError."""
    given = dict(settings)
    word = given.pop("compensate", "off" if name == "calibrate" else "on")
    compensate = compensation(word)
    own: MeshConfig = getattr(config.plans, name)
    mesh = chosen(name, own, given, "compensate")
    check_held(config, mesh.torques_Nm, mesh.speeds_Hz)
    taken = points(mesh)
    if isinstance(mesh, CalibrateConfig):
        taken += gain_points(mesh, len(taken))
        check_held(config, {p.torque_Nm for p in taken}, (middle(mesh.speeds_Hz),))
    return Plan(
        name=name,
        points=taken,
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


def gain_points(mesh: CalibrateConfig, first_index: int) -> tuple[OperatingPoint, ...]:
    """Return the points at which one phase's current is scaled, phase by phase in turn.

    Then the phases' torques no longer add up to a constant, and their common gain shows.
    """
    torques_Nm = mesh.gain_torques_Nm or (middle(mesh.torques_Nm),)
    places = [(torque_Nm, step) for torque_Nm in torques_Nm for step in mesh.gain_steps]
    found = []
    for number, (torque_Nm, step) in enumerate(places):
        gain = [1.0, 1.0, 1.0]
        gain[number % 3] = step
        induced = Induced(gain=(gain[0], gain[1], gain[2]))
        index, speed_Hz = first_index + number, middle(mesh.speeds_Hz)
        found.append(OperatingPoint(index, torque_Nm, speed_Hz, mesh.turns, induced))
    return tuple(found)


def middle(values: Sequence[float]) -> float:
    """Return the value in the middle, of two the larger."""
    return sorted(values)[len(values) // 2]


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
