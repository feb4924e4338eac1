"""The state by name, as topic `/state` of a recording has it, from the published state."""

from typing import Any

from motord.api.messages import BenchState
from motord.sequencing.settings import COMPENSATE


def named_state(state: BenchState) -> dict[str, Any]:
    """Return the fields of `recording.topics.STATES`."""
    setpoint = state.setpoint
    plan = state.plan if state.plan is not None and not state.plan.over else None
    return {
        "t_ns": state.t_ns,
        "state": state.state,
        "fault": state.fault,
        "trips": [trip.name for trip in state.trips],
        "first_trip": state.first_trip,
        "holder": state.lease.holder or "",
        "plan": plan.plan if plan is not None else "",
        "plan_state": plan.state if plan is not None else "",
        "torque_Nm": setpoint.torque_Nm,
        "speed_Hz": setpoint.speed_Hz or 0.0,
        "drive_Hz": setpoint.drive_Hz,
        "compensate": int(COMPENSATE[setpoint.compensate]),
    }
