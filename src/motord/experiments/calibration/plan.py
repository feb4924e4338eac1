"""`calibrate`: the mesh without compensation, and points at which one phase's current is scaled."""

from collections.abc import Mapping, Sequence
from typing import Any

from motord.config import Config
from motord.config.plans import CalibrateConfig
from motord.experiments.calibration.quick_plan import quick_plan
from motord.sequencing import Induced, OperatingPoint, Plan
from motord.sequencing.mesh import Places, mesh_plan, serpentine
from motord.sequencing.settings import chosen


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan over the mesh of `[plans.calibrate]` with `settings`, or the quick one.

    Raises PlanError.
    """
    if settings.get("compensate", "off") == "off":
        mesh = chosen(config, "calibrate", CalibrateConfig, _without(settings), "compensate")
        if mesh.quick:
            return quick_plan(config, mesh)
    return mesh_plan("calibrate", CalibrateConfig, config, settings, "off", _gain_points, _places)


def _without(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name != "compensate"}


def _places(mesh: CalibrateConfig) -> Places:
    """Return the mesh's torques with speeds; in both directions, every other one backwards, last.

    Like the fields of a chessboard, so each direction has all torques and speeds.
    """
    places = serpentine(mesh.torques_Nm, mesh.speeds_Hz)
    if mesh.directions == "forwards":
        return places
    backwards = [(-torque_Nm, -speed_Hz) for torque_Nm, speed_Hz in places[1::2]]
    return places[::2] + backwards


def _gain_points(mesh: CalibrateConfig) -> tuple[OperatingPoint, ...]:
    """Return the points at which one phase's current is scaled, phase by phase in turn.

    Then the phases' torques no longer add up to a constant, and their common gain shows.
    """
    first_index = len(mesh.torques_Nm) * len(mesh.speeds_Hz)
    torques_Nm = mesh.gain_torques_Nm or (_middle(mesh.torques_Nm),)
    scaled = [(torque_Nm, step) for torque_Nm in torques_Nm for step in mesh.gain_steps]
    points = []
    for number, (torque_Nm, step) in enumerate(scaled):
        a, b, c = (step if phase == number % 3 else 1.0 for phase in range(3))
        points.append(
            OperatingPoint(
                first_index + number,
                torque_Nm,
                _middle(mesh.speeds_Hz),
                mesh.turns,
                Induced(gain=(a, b, c)),
            )
        )
    return tuple(points)


def _middle(values: Sequence[float]) -> float:
    """Return the value in the middle, of two the larger."""
    return sorted(values)[len(values) // 2]
