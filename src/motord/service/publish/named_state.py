"""The state by name, as it is recorded for programs that know nothing of motord."""

from typing import Any

from motord.api.descriptions import trip_names
from motord.service.bench.bench import Bench


def named_state(bench: Bench, now_ns: int) -> dict[str, Any]:
    """Return state, trips, set-point, holder of the lease and plan; cheap. Monotonic ns."""
    setpoint, view = bench.setpoint, bench.plans.view
    plan = view if view is not None and bench.plans.active else None
    trips, first = bench.monitor.trip_bits, bench.monitor.first_trip
    return {
        "state": bench.state.name,
        "fault": bench.fault,
        "trips": trip_names(trips) if trips else [],
        "first_trip": trip_names(first)[0] if first else "",
        "holder": bench.commander(now_ns) or "",
        "plan": plan.plan if plan else "",
        "plan_state": plan.state if plan else "",
        "torque_Nm": setpoint.torque_Nm,
        "speed_Hz": setpoint.speed_Hz or 0.0,
        "drive_Hz": setpoint.drive_Hz,
        "compensate": int(setpoint.compensate),
    }
