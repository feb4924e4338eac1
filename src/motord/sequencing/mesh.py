"""Operating points one after the other, as over a mesh of torques and speeds."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from motord.config import BrakeConfig, Config, MeshConfig
from motord.schema import Compensation
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.capture import take_points
from motord.sequencing.demand import OperatingPoint
from motord.sequencing.limits import check_operating_points
from motord.sequencing.motions import Motion
from motord.sequencing.operating_point import operating_point, operating_point_s
from motord.sequencing.plan import Plan
from motord.sequencing.settings import chosen, compensation

Mesh = TypeVar("Mesh", bound=MeshConfig)


Places = list[tuple[float, float]]
"""Torques with speeds (Nm, turns/s)."""


def serpentine(torques_Nm: Sequence[float], speeds_Hz: Sequence[float]) -> Places:
    """Return torques with speeds, torque by torque, speeds up and down so that steps are small."""
    return [
        (torque_Nm, speed_Hz)
        for row, torque_Nm in enumerate(torques_Nm)
        for speed_Hz in (speeds_Hz if row % 2 == 0 else speeds_Hz[::-1])
    ]


def mesh_plan(
    name: str,
    section: type[Mesh],
    config: Config,
    settings: Mapping[str, Any],
    compensate: Compensation,
    more_points: Callable[[Mesh], tuple[OperatingPoint, ...]] = lambda _: (),
    places: Callable[[Mesh], Places] = lambda mesh: serpentine(mesh.torques_Nm, mesh.speeds_Hz),
) -> Plan:
    """Return the plan over the mesh of `[plans.NAME]`, a `section`, with `settings`.

    compensate: what is applied unless set otherwise; more_points: what is taken after the mesh;
    places: the mesh's torques with speeds, in order.
    Raises PlanError.
    """
    given = dict(settings)
    applied = given.pop("compensate", compensate)
    flags = compensation(applied)
    mesh = chosen(config, name, section, given, "compensate")
    check_operating_points(config, mesh.torques_Nm, mesh.speeds_Hz)
    points = tuple(
        OperatingPoint(index, torque_Nm, speed_Hz, mesh.turns)
        for index, (torque_Nm, speed_Hz) in enumerate(places(mesh))
    )
    more = more_points(mesh)
    for point in more:
        check_operating_points(config, (point.torque_Nm,), (point.speed_Hz,))
    return Plan(
        name=name,
        points=points + more,
        motion=partial(operating_points, mesh, config.brake, int(flags)),
        point_s=partial(operating_point_s, mesh, config.brake),
        settings={**mesh.model_dump(mode="json"), "compensate": applied},
    )


make_verify = partial(mesh_plan, "verify", MeshConfig, compensate="on")
"""Makes the plan `verify` from a bench and settings: with the installed calibration applied."""


def operating_points(
    mesh: MeshConfig, brake: BrakeConfig, compensate: int, points: tuple[OperatingPoint, ...]
) -> Motion[None]:
    """Enable, take every operating point, ramp down."""
    take = partial(operating_point, mesh=mesh, servo=BrakeServo(brake))
    yield from take_points(take, points, compensate)
