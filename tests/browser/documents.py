"""What the stand-in publishes and answers: state, plans, mesh, trips, calibrations."""

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tests.browser.stand_in import StandIn

TORQUES_Nm = [1.0, 2.0, 3.0, 4.0, 5.0]
SPEEDS_Hz = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
TABLE = 1024


def state(stand_in: "StandIn", uptime_s: float, remaining_s: float) -> dict[str, Any]:
    """Return the full state."""
    bench = stand_in.bench
    newest = {} if stand_in.loop_ended else bench.newest
    fault, remedy = (
        (LOOP_ENDED, "`motord reset` starts it again") if stand_in.loop_ended else ("", "")
    )
    plan = stand_in.plan
    busy = plan is not None and not plan.over
    return {
        "bench": "sim", "motor": "axial-flux 48/16 sim-1", "simulated": True, "version": "0",
        "t_ns": newest.get("t_ns", 0), "uptime_s": uptime_s,
        "state": "OFF" if stand_in.loop_ended else bench.state.name,
        "fault": fault, "remedy": remedy,
        "trips": [{"name": "OVER_CURRENT", "meaning": OVER_CURRENT}] if stand_in.trip else [],
        "first_trip": "OVER_CURRENT" if stand_in.trip else "", "trip": stand_in.trip,
        "tick": _tick(newest) if newest else None,
        "setpoint": {
            "torque_Nm": bench.torque_Nm, "torque_target_Nm": bench.torque_target_Nm,
            "speed_Hz": bench.speed_target_Hz, "brake": 0.1 * bench.torque_Nm, "drive_Hz": 0.0,
            "compensate": "off" if bench.ripple_share == 1.0 else "on",
        },
        "lease": {
            "holder": stand_in.holder, "remaining_s": remaining_s, "duration_s": 20.0,
        },
        "plan": plan.model_dump() if plan is not None else None,
        "loop": {
            "rate_Hz": bench.rate_Hz, "ticks": bench.tick, "missed": bench.missed,
            "lost_by_supervisor": 0, "wake_late_us_p50": 14.8, "wake_late_us_p99": 33.1,
            "wake_late_us_max": 61.0, "work_us_p99": 49.7, "age_s": 0.0,
        },
        "ages": {
            "tick": 0.0, "encoder": 0.0002, "torque": 0.0002, "inverter": 0.0004,
            "heartbeat": 0.004,
        },
        "links": {
            "errors": 0, "errors_last_s": 0, "ticks_last_s": int(bench.rate_Hz),
            "without_encoder_last_s": 0, "without_inverter_last_s": 0, "bus_off": False,
            "bridge": stand_in.barred,
        },
        "realtime": {"granted": True, "lines": []},
        "recording": {
            "recording": busy, "path": plan.recording if busy and plan else "",
            "error": stand_in.unreported,
            "detail": {"ticks": bench.tick, "bytes": 115 * bench.tick, "lost": 0},
        },
        "calibration": {
            "id": "8f2c51d09ab3e7c4", "created": "2026-01-01T09:00:00Z", "age_s": 259200.0,
            "age": "3 days", "method": "joint", "path": "/calibrations/sim/8f2c51d09ab3e7c4.json",
        },
        "tracking": stand_in.tracking, "queue": stand_in.queue.view.model_dump(),
        "brake": {"health": "simulated"}, "drive": {"health": "simulated"},
        "channels": [
            {"name": "winding_C", "unit": "degC", "value": 131.5, "status": "trip", "age_s": 0.2},
            {"name": "oil_bar", "unit": "bar", "value": None, "status": "broken", "age_s": None,
             "error": "nothing has been read yet"},
        ],
        "processes": {
            name: {"pid": 4711, "running": True, "restarts": 0, "exit": ""}
            for name in ("loop", "recorder")
        },
        "telemetry_dropped": 0,
    }  # fmt: skip


def _tick(newest: dict[str, Any]) -> dict[str, Any]:
    return {
        "tick": newest["tick"], "t_ns": newest["t_ns"], "angle_rad": newest["angle_rad"],
        "speed_Hz": newest["speed_rad_s"] / (2 * math.pi), "torque_Nm": newest["torque_Nm"],
        "torque_set_Nm": newest["torque_set_Nm"], "i_A": [newest[f"i_{p}_A"] for p in "abc"],
        "u_bus_V": 24.0, "temperature_C": 31.5, "brake_temperature_C": None, "flags": [],
        "torque_ripple_Nm": 0.12,
    }  # fmt: skip


def tracking(*departed: str) -> dict[str, Any]:
    """Return what is tracked of the calibration in force; of alpha some phases have `departed`."""
    quantities = [
        {
            "name": f"alpha-{phase}", "meaning": f"the gain of phase {phase}", "unit": "1",
            "value": 1.0213, "half_width": 0.0042, "in_force": 1.0021, "in_force_half_width": 0.005,
            "departed": phase in departed, "adoptable": phase != "c",
        }
        for phase in "abc"
    ]  # fmt: skip
    return {
        "calibration": IDS[0], "t_ns": len(departed) + 1, "turns": 70, "memory_s": 300.0,
        "quantities": quantities, "unseen": ["the common offset of the currents"], "obstacle": "",
    }  # fmt: skip


LOOP_ENDED = "the loop ended: killed by SIGKILL"
OVER_CURRENT = "a phase current was above limits.trip_current_A"


def trip(t_ns: int) -> dict[str, Any]:
    """Return the report of a trip by over-current."""
    return {
        "t_ns": t_ns,
        "reason": f"ENABLED -> TRIPPED: {OVER_CURRENT}; largest phase current: 41.3 A, limit 40 A",
        "first": ["OVER_CURRENT"],
        "causes": ["OVER_CURRENT"],
        "values": {"largest phase current, A": {"value": 41.3, "limit": 40.0}},
        "action": "look for a short between phases, and whether the current loops are tuned",
        "blackbox": "/runs/sim-20260101T090211000Z-blackbox.mcap",
    }


def points(settings: dict[str, Any]) -> list[tuple[float, float]]:
    """Return torque and speed of the points of a mesh, back and forth."""
    speeds_Hz = list(settings.get("speeds_Hz", SPEEDS_Hz))
    found = []
    for row, torque_Nm in enumerate(settings.get("torques_Nm", TORQUES_Nm)):
        ordered = speeds_Hz if row % 2 == 0 else speeds_Hz[::-1]
        found += [(torque_Nm, speed_Hz) for speed_Hz in ordered]
    return found


def mesh(plan: str, of: list[tuple[float, float]], done: int) -> dict[str, Any]:
    """Return the mesh with the first `done` points taken; the fifth is poor."""
    return {
        "plan": plan, "run_id": "r", "points_total": len(of),
        "points": [_mesh_point(i, *point, done) for i, point in enumerate(of)],
    }  # fmt: skip


def _mesh_point(i: int, torque_Nm: float, speed_Hz: float, done: int) -> dict[str, Any]:
    poor = i == 4
    error = 1.1 + 0.42 * torque_Nm + 0.6 * abs(speed_Hz - 0.75) + 0.07 * math.sin(7 * i)
    taken = i < done
    return {
        "point": i, "torque_Nm": torque_Nm, "speed_Hz": speed_Hz, "turns": 24,
        "state": ("poor" if poor else "done") if taken else "taking" if i == done else "planned",
        "takes": (3 if poor else 1) if taken else 0,
        "quality": ("speed off by 3.1 %" if poor else "ok") if taken else "",
        "rms_error_percent": error if taken else None,
        "mean_error_percent": 0.4 if taken else None,
    }  # fmt: skip


def plans() -> list[dict[str, Any]]:
    """Return two plans of `plan/list`, one with its settings described."""
    fields = [
        _field("torques_Nm", "list", TORQUES_Nm, unit="Nm", minimum=0.0, help="of the mesh"),
        _field("speeds_Hz", "list", SPEEDS_Hz, unit="Hz", minimum=0.0, help="of the mesh"),
        _field("turns", "integer", 24, minimum=2, help="captured at each point"),
        _field("settle_s", "number", 2.0, unit="s", minimum=0.0, help="within the tolerance"),
        _field("speed_tolerance", "number", 0.02, minimum=0.0, minimum_excluded=True),
        _field("temperature_C", "list", None, unit="degC", optional=True, help="of the inverter"),
    ]
    calibrate = {
        "torques_Nm": TORQUES_Nm, "speeds_Hz": SPEEDS_Hz, "turns": 24, "settle_s": 2.0,
        "settle_timeout_s": 30.0, "speed_tolerance": 0.02, "temperature_C": None,
    }  # fmt: skip
    return [
        {
            "name": "calibrate",
            "summary": "torque/speed mesh without compensation, for alpha, beta and cogging",
            "settings": calibrate,
            "fields": fields,
        },
        {
            "name": "back-emf",
            "summary": "rotor driven from outside without current, for the back-EMF of the phases",
            "settings": {"speeds_Hz": [0.53, 0.87, 1.37], "turns": 24, "stator": False},
        },
    ]


def _field(name: str, kind: str, default: Any, **rest: Any) -> dict[str, Any]:
    return {"name": name, "type": kind, "default": default, **rest}


IDS = ("8f2c51d09ab3e7c4", "51b20c77d1e48a90")
EARLIER = "2025-12-01T16:30:00+01:00"


def calibrations() -> list[dict[str, Any]]:
    """Return the list of calibrations, the newest first."""
    return [
        {"id": IDS[0], "created": "2026-01-01T09:00:00Z", "method": "joint", "in_force": True},
        {"id": IDS[1], "created": EARLIER, "method": "residual", "in_force": False},
    ]


FINDINGS: list[dict[str, Any]] = [
    {
        "name": "current-age", "value": 131.0, "limit": 100.0, "unit": "us", "severity": "warning",
        "meaning": "the currents fit only if they are that much older than the recording says",
        "action": "align the encoder (`motord plan start align`)",
    },
    {
        "name": "encoder-error-order-1", "value": 0.284, "limit": 0.0123, "unit": "deg",
        "severity": "serious",
        "meaning": "the encoder is eccentric: it is off by 0.28 deg once a turn, seen in the "
        "neighbours of the torque's orders",
        "action": "centre the encoder, or measure its error on a coasting rotor",
    },
]  # fmt: skip


def calibration(which: str) -> dict[str, Any]:
    """Return a calibration as `calibration/show` does."""
    orders = ((48, 0.172, 0.0016), (96, 0.051, 0.0014), (16, 0.0405, 0.0015), (24, 0.029, 0.0015))
    angle = [2 * math.pi * i / TABLE for i in range(TABLE)]
    entry = next(one for one in calibrations() if one["id"] == which)
    alpha, beta_A = [0.9613, 1.0207, 1.0192], [0.213, -0.154, -0.061]
    return {
        **entry, "runs": ["sim-20260101T080000000Z-calibrate-000.mcap"],
        "alpha": alpha, "alpha_95": [[a - 0.0045, a + 0.0045] for a in alpha],
        "beta_A": beta_A, "beta_95_A": [[b - 0.022, b + 0.022] for b in beta_A],
        "findings": FINDINGS if entry["in_force"] else [],
        "angle_rad": angle,
        "tau_cog_Nm": [sum(a * math.sin(n * x + n) for n, a, _ in orders) for x in angle],
        "tau_cog_harmonics": [
            {"order": n, "amplitude_Nm": a, "phase_rad": 0.4, "stderr_Nm": e} for n, a, e in orders
        ],
        "tau_cog_half_widths_Nm": [1.98 * e for _, _, e in orders],
        "observable": ["the product of the gains: assumed 1"], "learned": False,
        "rms_error_percent": {
            "before": {"mean": 3.1, "max": 4.2},
            "after": {
                "mean": 0.38, "max": 0.61, "mean_half_width": 0.03, "max_half_width": 0.05,
            },
        },
    }  # fmt: skip
