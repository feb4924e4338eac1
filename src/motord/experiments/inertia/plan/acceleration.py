"""`inertia-acceleration`: steps of the motor's own torque, from rest and with the brake open."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from motord.config import AccelerationConfig, BrakeConfig, Config, LimitsConfig
from motord.experiments.free_rotor import SLOW_RISE_S, FreeRotor, probe, raise_torque, runaway
from motord.sequencing import Demand, Observation, OperatingPoint, Plan
from motord.sequencing.brake_servo import release_s
from motord.sequencing.capture import account, retaken_if_poor
from motord.sequencing.limits import check_speed, check_torque
from motord.sequencing.motions import (
    Capture,
    Motion,
    brake_to_rest,
    enable,
    guarded,
    ramp_down,
    restartable,
    wait,
    within,
)
from motord.sequencing.quality import quality
from motord.sequencing.settings import chosen, compensation

NAME = "inertia-acceleration"

STANDSTILL_RAD = 0.01
"""Movement from one observation to the next below which the rotor counts as standing."""

ENDS_S = 1.5 + 0.5 * SLOW_RISE_S
"""Time before the first step, with its probe, and after the last."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.inertia-acceleration]` with `settings`. Raises PlanError."""
    given = dict(settings)
    applied = given.pop("compensate", "off")
    flags = compensation(applied)
    own = chosen(config, NAME, AccelerationConfig, given, "compensate")
    check_torque(config, own.torque_Nm)
    check_speed(config, own.stop_speed_Hz)
    torques_Nm = [own.torque_Nm * (-1) ** index for index in range(own.repeats)]
    return Plan(
        name=NAME,
        points=tuple(
            OperatingPoint(index, torque_Nm, 0.0, 0, aim=f"a torque step of {torque_Nm:g} Nm")
            for index, torque_Nm in enumerate(torques_Nm)
        ),
        motion=partial(
            torque_steps, own=own, brake=config.brake, limits=config.limits, compensate=int(flags)
        ),
        point_s=partial(torque_step_s, own, config.brake),
        settings={**own.model_dump(mode="json"), "compensate": applied},
        ends_s=ENDS_S,
    )


def torque_step_s(own: AccelerationConfig, brake: BrakeConfig, _: OperatingPoint) -> float:
    """Return an estimate of the time that `torque_step` takes (s)."""
    return 1.5 + release_s(brake) + own.rest_s + own.coast_s


def torque_steps(
    points: tuple[OperatingPoint, ...],
    own: AccelerationConfig,
    brake: BrakeConfig,
    limits: LimitsConfig,
    compensate: int,
) -> Motion[None]:
    """Enable, estimate the inertia roughly, take every step, ramp down."""
    yield from enable(compensate)
    if points:
        rotor = yield from probe_rotor(points[0], own, brake, limits)
        rise_s = rotor.rise_s(limits, own.torque_Nm, own.stop_speed_Hz)
        take = partial(torque_step, own=own, brake=brake, limits=limits, rise_s=rise_s)
        for point in points:
            yield from retaken_if_poor(take, point)
    yield from ramp_down()


@restartable
def probe_rotor(
    point: OperatingPoint, own: AccelerationConfig, brake: BrakeConfig, limits: LimitsConfig
) -> Motion[FreeRotor]:
    """Accelerate the rotor gently, in the direction of a step; return its inertia, roughly."""
    began = yield None
    free = began.demand.at_rest(enabled=True, brake=0.0, label="estimating the inertia")
    yield from _stopped(free, own.timeout_s, brake)
    pushed = free.labelled("accelerating gently", torque_Nm=point.torque_Nm)
    push = guarded(probe(pushed, limits, own.stop_speed_Hz), runaway(limits, point.torque_Nm))
    limit_s = SLOW_RISE_S + own.timeout_s
    return (yield from within(limit_s, push, partial(_too_slow, own.stop_speed_Hz)))


@restartable
def torque_step(
    point: OperatingPoint,
    own: AccelerationConfig,
    brake: BrakeConfig,
    limits: LimitsConfig,
    rise_s: float,
) -> Motion[Capture]:
    """Stop the rotor and let it rest, step the torque up to a speed, follow it while it coasts.

    The capture begins with the rest and ends with the coasting. rise_s: of the torque.
    """
    began = yield None
    free = began.demand.at_rest(
        enabled=True, brake=0.0, label=f"step {point.index + 1}, {point.torque_Nm:g} Nm"
    )
    captured = replace(free, plan_point=point.index)
    limit_s = own.timeout_s + own.rest_s + rise_s
    yield from _stopped(free, limit_s, brake)
    rest = _rest(captured.labelled("resting"), own.rest_s)
    moved_rad = yield from within(limit_s, rest, _not_at_rest, since=began)
    accelerate = raise_torque(
        captured.labelled("accelerating", torque_Nm=point.torque_Nm),
        rise_s,
        lambda seen: abs(seen.speed_Hz) >= own.stop_speed_Hz,
    )
    accelerate = guarded(accelerate, runaway(limits, point.torque_Nm))
    yield from within(limit_s, accelerate, partial(_too_slow, own.stop_speed_Hz), since=began)
    seen = yield from wait(captured.labelled("coasting"), own.coast_s)
    moved = f"not settled: moved by {moved_rad:.2g} rad at rest"
    fault = moved if moved_rad > own.rest_rad else ""
    turns = round(abs(seen.point_turns), 3)
    return account(point, seen, quality(seen, own.temperature_C, fault), turns=turns)


def _stopped(free: Demand, limit_s: float, brake: BrakeConfig) -> Motion[None]:
    """Brake until the rotor stands, and release the brake."""
    stop = brake_to_rest(free.labelled("stopping the rotor"), _stands)
    yield from within(limit_s, stop, _not_at_rest)
    yield from wait(free.labelled("releasing the brake"), release_s(brake))


def _stands(seen: Observation) -> bool:
    return seen.highest_rad - seen.lowest_rad <= STANDSTILL_RAD and seen.torque_set_Nm == 0.0


def _rest(demand: Demand, for_s: float) -> Motion[float]:
    """Return by how much the rotor moved (rad) in some time of rest."""
    began = seen = yield None
    lowest_rad = highest_rad = began.turned_rad
    while True:
        seen = yield demand
        lowest_rad = min(lowest_rad, seen.lowest_rad)
        highest_rad = max(highest_rad, seen.highest_rad)
        if seen.since_s(began) >= for_s:
            return highest_rad - lowest_rad


def _too_slow(speed_Hz: float, seen: Observation) -> str:
    return (
        f"{seen.demand.label}: {speed_Hz:g} Hz not reached; is the rotor free, and torque_Nm more "
        "than friction and cogging torque?"
    )


def _not_at_rest(seen: Observation) -> str:
    return f"{seen.demand.label}: the rotor did not come to rest; does the brake answer?"
