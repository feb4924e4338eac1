"""One operating point of the motor against the brake."""

import math
from collections.abc import Callable
from dataclasses import replace

from motord.config import BrakeConfig, MeshConfig
from motord.sequencing.brake_servo import LEAD_TIME_CONSTANTS, BrakeServo
from motord.sequencing.capture import account, capture
from motord.sequencing.demand import Demand, OperatingPoint
from motord.sequencing.motions import Capture, Motion, near_speed, restartable, wait, within
from motord.sequencing.observation import Observation
from motord.sequencing.quality import quality_at_speed

APPROACH_S = 3.0
"""How long a torque and a speed are expected to take, for the estimate."""


def operating_point_s(mesh: MeshConfig, brake: BrakeConfig, point: OperatingPoint) -> float:
    """Return an estimate of the time that `operating_point` takes (s)."""
    lead_s = LEAD_TIME_CONSTANTS * brake.excitation_time_constant_s
    return lead_s + APPROACH_S + mesh.settle_s + point.turns / abs(point.speed_Hz)


@restartable
def operating_point(point: OperatingPoint, mesh: MeshConfig, servo: BrakeServo) -> Motion[Capture]:
    """Hold torque by command and speed by the brake, then capture `point.turns` turns.

    While they are captured the brake is left alone.
    """
    servo.start(point.speed_Hz)
    demand = replace(
        (yield None).demand,
        enabled=True,
        torque_Nm=point.torque_Nm,
        speed_Hz=point.speed_Hz,
        plan_point=-1,
        induced=point.induced,
        label=f"{point.torque_Nm:g} Nm, {point.speed_Hz:g} Hz",
    )
    raised = yield from lead_torque(servo, demand.labelled("bringing the brake up"))
    near = near_speed(point.speed_Hz, mesh.speed_tolerance, since=raised)
    reached = yield from within(
        mesh.settle_timeout_s,
        hold_speed(servo, demand.labelled("waiting for the speed"), until=near),
        lambda seen: f"{demand.label}: {_why_not_reached(seen, mesh.settle_timeout_s)}",
    )
    yield from within(
        mesh.settle_s + mesh.settle_timeout_s,
        hold_speed(
            servo,
            demand.labelled("settling"),
            until=lambda seen: seen.since_s(reached) >= mesh.settle_s and near(seen),
        ),
        lambda seen: f"{demand.label}: {_why_not_reached(seen, mesh.settle_timeout_s)}",
    )
    brake = servo.excitation(point.induced.torque_part * point.torque_Nm, point.speed_Hz)
    seen = yield from capture(point, demand.labelled("capturing", brake=brake))
    return account(point, seen, quality_at_speed(seen, point.speed_Hz, mesh))


def lead_torque(servo: BrakeServo, demand: Demand) -> Motion[Observation]:
    """Let a rising brake lead the torque, so that the rotor does not run away meanwhile.

    What is induced waits, too.
    """
    seen = yield None
    brake = servo.excitation(demand.induced.torque_part * demand.torque_Nm, demand.speed_Hz)
    lead_s = servo.lead_s(seen.demand.brake, brake)
    if lead_s:
        before_Nm, torque_Nm = seen.demand.torque_Nm, demand.torque_Nm
        torque_Nm = min(before_Nm, torque_Nm, key=abs) if before_Nm * torque_Nm > 0 else 0.0
        induced = seen.demand.induced if torque_Nm else demand.induced
        before = replace(demand, brake=brake, torque_Nm=torque_Nm, induced=induced)
        seen = yield from wait(before, lead_s)
    return seen


def hold_speed(
    servo: BrakeServo, demand: Demand, until: Callable[[Observation], bool]
) -> Motion[Observation]:
    """Correct the brake with each observation until one fulfils `until`; return that one."""
    seen = yield None
    while True:
        part = demand.induced.torque_part
        brake = servo.follow(seen, demand.torque_Nm, demand.speed_Hz, part)
        seen = yield replace(demand, brake=brake)
        if until(seen):
            return seen


def _why_not_reached(seen: Observation, timeout_s: float) -> str:
    if not math.isclose(seen.torque_set_Nm, seen.demand.torque_Nm, rel_tol=1e-6):
        hint = "the torque still ramps: it needs a longer settle_timeout_s"
    elif abs(seen.speed_Hz) > abs(seen.demand.speed_Hz):
        hint = "does the brake answer?"
    else:
        hint = "is the rotor free?"
    return f"the speed was still {seen.turn_speed_Hz:.3g} Hz after {timeout_s:g} s; {hint}"
