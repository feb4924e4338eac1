"""One operating point of the motor against the brake."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from motord.config import BrakeConfig, MeshConfig
from motord.sequencing.brake_servo import LEAD_TIME_CONSTANTS, BrakeServo
from motord.sequencing.capture import account, capture
from motord.sequencing.demand import NOTHING_INDUCED, Demand, OperatingPoint
from motord.sequencing.motions import Capture, Motion, near_speed, restartable, wait, within
from motord.sequencing.observation import Observation
from motord.sequencing.quality import quality_at_speed

APPROACH_S = 3.0
"""How long a torque and a speed are expected to take, for the estimate."""


def operating_point_s(mesh: MeshConfig, brake: BrakeConfig, point: OperatingPoint) -> float:
    """Return an estimate of the time that `operating_point` takes (s)."""
    lead_s = LEAD_TIME_CONSTANTS * brake.excitation_time_constant_s
    return lead_s + APPROACH_S + mesh.settle_s + point.turns / point.speed_Hz


@restartable
def operating_point(point: OperatingPoint, mesh: MeshConfig, servo: BrakeServo) -> Motion[Capture]:
    """Hold torque by command and speed by the brake, then capture `point.turns` turns.

    While they are captured the brake is left alone.
    """
    servo.drop_unproven()
    began = yield None
    name = f"{point.torque_Nm:g} Nm, {point.speed_Hz:g} Hz"

    def demand(label: str) -> Demand:
        return replace(
            began.demand,
            enabled=True,
            torque_Nm=point.torque_Nm,
            speed_Hz=point.speed_Hz,
            brake=servo.excitation(point.torque_Nm, point.speed_Hz),
            plan_point=-1,
            induced=point.induced,
            label=f"{name}: {label}",
        )

    raised = yield from _lead_torque(demand("bringing the brake up"), servo)
    servo.start(raised.t_ns)
    reached = yield from within(
        mesh.settle_timeout_s,
        _hold_speed(
            lambda: demand("waiting for the speed"),
            servo,
            until=near_speed(point.speed_Hz, mesh.speed_tolerance, since=raised),
        ),
        lambda seen: (
            f"{name}: the speed was still {seen.turn_speed_Hz:.3g} Hz after "
            f"{mesh.settle_timeout_s:g} s; "
            + ("does the brake answer?" if seen.speed_Hz > point.speed_Hz else "is the rotor free?")
        ),
    )
    yield from _hold_speed(
        lambda: demand("settling"),
        servo,
        until=lambda seen: seen.since_s(reached) >= mesh.settle_s,
    )
    seen = yield from capture(point, demand("capturing"))
    induced: dict[str, Any] = {"induced": asdict(point.induced)}
    return account(
        point,
        seen,
        quality_at_speed(seen, point.speed_Hz, mesh),
        **(induced if point.induced != NOTHING_INDUCED else {}),
    )


def _lead_torque(demand: Demand, servo: BrakeServo) -> Motion[Observation]:
    """Let a rising brake lead the torque, so that the rotor does not run away meanwhile."""
    seen = yield None
    lead_s = servo.lead_s(seen.demand.brake, demand.brake)
    if lead_s:
        torque_Nm = min(seen.demand.torque_Nm, demand.torque_Nm)
        seen = yield from wait(replace(demand, torque_Nm=torque_Nm), lead_s)
    return seen


def _hold_speed(
    demand: Callable[[], Demand], servo: BrakeServo, until: Callable[[Observation], bool]
) -> Motion[Observation]:
    """Correct the brake with each observation until one fulfils `until`; return that one."""
    while True:
        asked = demand()
        seen = yield asked
        servo.correct(seen.t_ns, seen.speed_Hz, asked.speed_Hz)
        if until(seen):
            return seen
