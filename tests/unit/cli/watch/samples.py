"""States, ticks and a client that answers without a daemon."""

from contextlib import nullcontext

import numpy as np

from motord.api.messages import BenchState, Event
from motord.api.requests import CONFIG, NOTE, STOP
from motord.client import ClientError, Lease
from motord.schema import TICK_DTYPE

NOW_NS = 1_700_000_000_000_000_000
TRIP = {
    "state": "TRIPPED",
    "trips": [
        {"name": "OVER_TORQUE", "meaning": "the torque was above limits.trip_torque_Nm"},
        {"name": "OVER_SPEED", "meaning": "the rotor turned faster than limits.trip_speed_rad_s"},
    ],
    "first_trip": "OVER_SPEED",
    "trip": {
        "t_ns": NOW_NS,
        "reason": "",
        "first": ["OVER_SPEED"],
        "causes": ["OVER_SPEED", "OVER_TORQUE"],
        "values": {"speed, rad/s": {"value": 25.7, "limit": 25.0}},
        "action": "check that the brake answers and holds; lower the torque or raise the brake "
        "before the torque",
        "blackbox": "/runs/blackbox.mcap",
    },
}
LIMITS = {"torque_Nm": 6.0, "trip_speed_rad_s": 25.0, "current_A": 25.0}
LINKS = {
    "errors": 4, "errors_last_s": 0, "ticks_last_s": 10000, "without_encoder_last_s": 0,
    "without_inverter_last_s": 0, "bus_off": False,
}  # fmt: skip
PLAN = {
    "plan": "calibrate",
    "state": "running",
    "step": "3 Nm, 0.7 Hz: capturing",
    "points": 28,
    "points_done": 12,
    "fraction": 0.43,
    "eta_s": 192.0,
}


def state(**changes):
    """Return a state of a bench that is enabled at 3 Nm, with changes."""
    whole = {
        "bench": "bench1",
        "motor": "axial-flux 48/16 sim-1",
        "simulated": True,
        "version": "1.0",
        "t_ns": NOW_NS,
        "uptime_s": 10.0,
        "state": "ENABLED",
        "fault": "",
        "trips": [],
        "first_trip": "",
        "tick": {
            "tick": 5000, "t_ns": NOW_NS, "angle_rad": 1.0, "speed_Hz": 0.7, "torque_Nm": 3.0125,
            "torque_set_Nm": 3.0, "i_A": [12.25, -6.0, -6.25], "u_bus_V": 24.0,
            "temperature_C": 41.0, "brake_temperature_C": 63.0, "flags": [],
        },
        "setpoint": {
            "torque_Nm": 3.0, "torque_target_Nm": 3.0, "speed_Hz": 0.7, "brake": 0.4,
            "drive_Hz": 0.0, "compensate": "on",
        },
        "lease": {"holder": "anna@bench pts/3 4711", "remaining_s": 1.5, "duration_s": 2.0},
        "plan": None,
        "loop": {
            "rate_Hz": 10000.0, "ticks": 120000, "missed": 3, "lost_by_supervisor": 0,
            "wake_late_us_p50": 12.4, "wake_late_us_p99": 31.0, "wake_late_us_max": 80.0,
            "work_us_p99": 55.0, "age_s": 0.002,
        },
        "ages": {"encoder": 0.0003, "currents": 0.0009, "brake": 0.05},
        "links": LINKS,
        "realtime": {},
        "recording": {"recording": True, "path": "/runs/bench1-calibrate.mcap.part"},
        "calibration": {
            "id": "3fa2c1", "created": "2026-01-01", "age_s": 1.0, "age": "2 days",
            "method": "joint", "path": "/c.json",
        },
        "brake": {"health": "ok", "age_s": 0.05},
        "drive": {"health": "none"},
        "processes": {},
        "telemetry_dropped": 0,
    }  # fmt: skip
    return BenchState.model_validate({**whole, **changes})


def ticks(t_s, torque_Nm=0.0, rate_Hz=1000.0, from_ns=NOW_NS):
    """Return ticks of `t_s` before `from_ns`, all with this torque."""
    block = np.zeros(round(t_s * rate_Hz), TICK_DTYPE)
    block["t_ns"] = from_ns - np.arange(len(block))[::-1] * round(1e9 / rate_Hz)
    block["torque_Nm"] = torque_Nm
    return block


def no_columns(now_ns, columns):
    """Return columns without a value."""
    empty = np.full((5, columns), np.nan)
    return empty, empty


class FakeClient:
    """Publishes what a test says, keeps the requests and answers them."""

    bench, endpoint, identity = "bench1", "tcp/127.0.0.1:7447", None

    def __init__(self):
        self.requests = []
        self.replies = {
            "lease/acquire": {
                "token": "t0", "took_over_from": None, "lease_s": 60.0, "renew_within_s": 60.0
            },
            "lease/renew": {"lease_s": 60.0, "renew_within_s": 60.0},
            "lease/release": {},
            "config": {"toml": "", "config": {"limits": LIMITS}},
            "note": {"recording": "/runs/r.mcap", "t_ns": NOW_NS},
            "plan/pause": {"plan": "calibrate", "state": "pausing"},
            "plan/resume": {"plan": "calibrate", "state": "running"},
            "plan/abort": {"plan": "calibrate", "state": "ending"},
            "enable": {"state": "ENABLED"},
            "stop": {"state": "OFF"},
        }  # fmt: skip
        self.remembered = [Event(t_ns=NOW_NS - 5_000_000_000, kind="state", message="OFF -> READY")]
        self.publish_state = self.publish_event = self.publish_ticks = None

    def events(self):
        return self.remembered

    def subscribe_state(self, callback):
        self.publish_state = callback
        return nullcontext()

    def subscribe_events(self, callback):
        self.publish_event = callback
        return nullcontext()

    def subscribe_ticks(self, callback):
        self.publish_ticks = callback
        return nullcontext()

    def config(self):
        return self.call(CONFIG)

    def stop(self):
        return self.call(STOP, by="me")

    def note(self, text):
        return self.call(NOTE, text=text, by="me")

    def call(self, rpc, /, **arguments):
        self.requests.append((rpc.name, arguments))
        return rpc.reply.model_validate(self._reply(rpc.name))

    def _reply(self, name):
        reply = self.replies.get(name)
        if reply is None:
            raise ClientError("refused", f"no {name} now")
        if isinstance(reply, Exception):
            raise reply
        return reply() if callable(reply) else reply

    def lease(self, holder=None, *, force=False, alive=lambda: True):
        return Lease(self, holder or "me", force=force, alive=alive)

    def asked(self, name):
        """Return the arguments of every request of that name."""
        return [arguments for one, arguments in self.requests if one == name]
