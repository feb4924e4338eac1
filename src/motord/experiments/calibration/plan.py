"""`calibrate`: the mesh without compensation, and points at which one phase's current is scaled.

Or, with a time limit or targets, points by what they tell in a second, no waits between.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from motord.config import Config
from motord.config.plans import CalibrateConfig
from motord.experiments.calibration.design import TICKS_PER_CYCLE, Design
from motord.experiments.calibration.visits import LEAST_VISITS, TURNS, Objective, Visit, visits
from motord.sequencing import Induced, OperatingPoint, Plan, PlanError
from motord.sequencing.brake_servo import brake_torque_Nm, excitation_for
from motord.sequencing.continuous import (
    END_S,
    START_S,
    Continuous,
    continuous_points,
    fastest_Hz,
    lead_s,
)
from motord.sequencing.limits import check_speed, check_torque
from motord.sequencing.mesh import Places, mesh_plan, serpentine
from motord.sequencing.settings import chosen

ESTIMATOR = "motord.experiments.calibration.estimate.live:LiveCalibration"

LIMIT_S = 120.0
"""Bench time of a plan with targets alone."""

FAR = 3.0
"""Factor by which a target must be below what is expected to be refused: noise is not known yet."""

ONE_DIRECTION = '; directions = "both" would separate friction from cogging torque'


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan over the mesh of `[plans.calibrate]` with `settings`, or the quick one.

    Raises PlanError.
    """
    if settings.get("compensate", "off") == "off":
        others = {name: value for name, value in settings.items() if name != "compensate"}
        mesh = chosen(config, "calibrate", CalibrateConfig, others, "compensate")
        if mesh.quick:
            return quick_plan(config, mesh)
    return mesh_plan("calibrate", CalibrateConfig, config, settings, "off", _gain_points, _places)


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


def quick_plan(config: Config, mesh: CalibrateConfig) -> Plan:
    """Return the plan of a mesh with a time limit or targets. Raises PlanError."""
    for torque_Nm in mesh.torques_Nm:
        check_torque(config, torque_Nm)
    torque_Nm = _largest_torque_Nm(config, mesh)
    directions = (1,) if mesh.directions == "forwards" else (1, -1)
    design = Design(config, torque_Nm, directions)
    objective = Objective.of(design, mesh.targets, mesh.torques_Nm)
    limit_s = mesh.time_limit_s or LIMIT_S
    start_s = max(START_S, lead_s(config.brake))
    chosen = _within(config, design, objective, torque_Nm, limit_s, start_s)
    _check_reachable(chosen, mesh, limit_s)
    points = tuple(_point(number, visit) for number, visit in enumerate(chosen))
    for point in points:
        check_speed(config, point.speed_Hz)
    speed_rad_s = 2 * math.pi * max(abs(visit.speed_Hz) for visit in chosen)
    settings = Continuous(
        excitation_for(config.brake, torque_Nm, speed_rad_s),
        lead_s(config.brake),
        config.limits.torque_rate_Nm_per_s,
        tuple(visit.duration_s for visit in chosen),
        limit_s,
        LEAST_VISITS,
        band_C=mesh.temperature_C,
        targets=mesh.targets,
    )
    return Plan(
        name="calibrate",
        points=points,
        motion=partial(continuous_points, settings),
        point_s=settings.duration_s,
        settings={**mesh.model_dump(mode="json"), "compensate": "off"},
        ends_s=start_s + END_S + torque_Nm / config.limits.torque_rate_Nm_per_s,
        estimator=ESTIMATOR if mesh.targets else "",
        targets=mesh.targets,
        outlook=outlook(chosen, mesh.targets),
        continuous=True,
    )


def _point(number: int, visit: Visit) -> OperatingPoint:
    one = visit.candidate
    return OperatingPoint(number, one.torque_Nm, visit.speed_Hz, visit.turns, one.induced)


def _largest_torque_Nm(config: Config, mesh: CalibrateConfig) -> float:
    """Return the mesh's largest torque, or what the motor may have for long, if that is less."""
    motor, limits = config.motor, config.limits
    largest_Nm = max(mesh.torques_Nm)
    current_A = motor.rated_current_A() * largest_Nm / motor.rated_torque_Nm
    return largest_Nm * min(limits.i2t_current_A / current_A, 1.0)


def _within(
    config: Config,
    design: Design,
    objective: Objective,
    torque_Nm: float,
    limit_s: float,
    start_s: float,
) -> list[Visit]:
    """Return the visits for a time limit, at the speed wanted or, if need be, a higher one."""
    rate_Nm_per_s = config.limits.torque_rate_Nm_per_s
    found: list[Visit] = []
    for ticks in TICKS_PER_CYCLE:
        speed_Hz = _speed_Hz(config, torque_Nm, ticks)
        found = visits(design, objective, speed_Hz, rate_Nm_per_s, limit_s - start_s)
        if sum(visit.turns for visit in found) >= LEAST_VISITS * TURNS:
            return found
    turns_s = LEAST_VISITS * TURNS / speed_Hz
    raise PlanError(
        f"calibrate: time_limit_s = {limit_s:g} is too short: {LEAST_VISITS * TURNS} turns at "
        f"{speed_Hz:.2g} Hz take {turns_s:.2g} s, and the brake and the torque's ramps come on top"
    )


def _speed_Hz(config: Config, torque_Nm: float, ticks_per_cycle: int) -> float:
    """Return the speed of the largest torque: as sampling, over-speed trip and brake allow."""
    sampled_Hz = config.loop.rate_Hz / (ticks_per_cycle * config.motor.pole_pairs)
    speed_Hz = min(sampled_Hz, fastest_Hz(config))
    held_Nm = brake_torque_Nm(config.brake, 1.0, 2 * math.pi * speed_Hz)
    if torque_Nm > held_Nm:
        raise PlanError(
            f"calibrate: the brake holds at most {held_Nm:.3g} Nm at {speed_Hz:.2g} Hz "
            f"([brake] torque_max_Nm, critical_speed_rad_s); torques_Nm has {torque_Nm:g}"
        )
    return speed_Hz


def _check_reachable(chosen: Sequence[Visit], mesh: CalibrateConfig, limit_s: float) -> None:
    """Refuse targets far below what is to be expected. Raises PlanError."""
    for name, target in mesh.targets.items():
        expected = chosen[-1].half_widths[name]
        if expected > FAR * target:
            raise PlanError(
                f"calibrate: {name} = {target:g} cannot be reached in {limit_s:g} s: about "
                f"{expected:.2g} is to be expected, by what the bench file says of the bench"
                + ONE_DIRECTION
                * (mesh.directions == "forwards")
            )


def outlook(chosen: Sequence[Visit], targets: dict[str, float]) -> str:
    """Return when the targets should be reached, or what to expect at the end."""
    at_s = 0.0
    for visit in chosen:
        at_s += visit.duration_s
        if targets and all(visit.half_widths[name] <= targets[name] for name in targets):
            return f"the targets should be reached after about {at_s:.0f} s"
    names = list(targets) or ["ripple_percent"]
    parts = [f"{name} {chosen[-1].half_widths[name]:.2g}" for name in names]
    return f"to be expected after {at_s:.0f} s: {', '.join(parts)}"
