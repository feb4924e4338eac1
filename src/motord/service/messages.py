"""What goes over Zenoh as JSON: requests and replies of the RPCs, `state`, `event` and `plan`.

Requests take nothing that they do not know, nothing of another type and no number that is not
finite. Replies and published messages may grow, so that readers skip what they do not know.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from motord.service.refusal import Refusal

Compensation = Literal["off", "on", "currents", "cogging"]
Token = Annotated[str, Field(min_length=1, max_length=128)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.@: -]+$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Request(BaseModel):
    """The body of an RPC: JSON object, strict types, unknown fields refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class NoArguments(Request):
    """`config`, `plan/list`: nothing."""


class LeaseAcquire(Request):
    """`lease/acquire`: who asks; `force` takes over from whoever is in command."""

    holder: Name
    force: bool = False


class WithToken(Request):
    """`lease/renew`, `lease/release`, `enable`, `disable`, `reset`, `plan/pause|resume|abort`."""

    token: Token


class Stop(Request):
    """`stop`: from anyone, no token; `by` is for the log."""

    by: Annotated[str, Field(max_length=64)] = ""


class Set(Request):
    """`set`: what is left out stays as it is.

    With `speed_Hz` the brake is servoed until the rotor turns at that speed (turns per second);
    `brake` sets the excitation itself, 0 to 1, and ends the servo. `drive_Hz` turns the rotor with
    the external drive.
    """

    token: Token
    torque_Nm: Finite | None = None
    speed_Hz: Finite | None = None
    brake: Annotated[float, Field(ge=0, le=1)] | None = None
    drive_Hz: Finite | None = None
    compensate: Compensation | None = None

    @model_validator(mode="after")
    def _something_to_set(self) -> "Set":
        given = self.model_fields_set - {"token"}
        if not given:
            raise ValueError("nothing to set: torque_Nm, speed_Hz, brake, drive_Hz, compensate")
        if self.speed_Hz is not None and self.brake is not None:
            raise ValueError("speed_Hz servoes the brake and brake sets it: give one of them")
        return self


class PlanStart(Request):
    """`plan/start`: a plan by name; a dry run moves nothing and needs no token."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    token: Annotated[str, Field(max_length=128)] = ""
    settings: dict[str, Any] = {}
    detach: bool = False
    dry_run: bool = False
    notes: Annotated[str, Field(max_length=4000)] = ""


class CalibrationInstall(Request):
    """`calibration/install`: the file's content, or its path as the daemon's host sees it."""

    token: Token
    calibration: dict[str, Any] | None = None
    path: Annotated[str, Field(max_length=4096)] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> "CalibrationInstall":
        if (self.calibration is None) == (self.path is None):
            raise ValueError("give either calibration (its content) or path")
        return self


REQUESTS: dict[str, type[Request]] = {
    "lease/acquire": LeaseAcquire,
    "lease/renew": WithToken,
    "lease/release": WithToken,
    "enable": WithToken,
    "disable": WithToken,
    "stop": Stop,
    "reset": WithToken,
    "set": Set,
    "plan/start": PlanStart,
    "plan/pause": WithToken,
    "plan/resume": WithToken,
    "plan/abort": WithToken,
    "plan/list": NoArguments,
    "config": NoArguments,
    "calibration/install": CalibrationInstall,
}
"""Every RPC and the model of its request."""

MAX_REQUEST_BYTES = 64 * 1024
MAX_CALIBRATION_BYTES = 64 * 1024 * 1024


def parse(name: str, payload: bytes) -> Request:
    """Return the request of RPC `name`. Raises Refusal "invalid" that says which field is wrong."""
    limit = MAX_CALIBRATION_BYTES if name == "calibration/install" else MAX_REQUEST_BYTES
    if len(payload) > limit:
        raise Refusal("invalid", f"{name}: {len(payload)} bytes, more than the {limit} allowed")
    try:
        return REQUESTS[name].model_validate_json(payload or b"{}")
    except ValidationError as error:
        raise Refusal("invalid", f"{name}: {_in_words(error)}") from None


def _in_words(error: ValidationError) -> str:
    lines = []
    for item in error.errors(include_url=False, include_input=False):
        where = ".".join(str(part) for part in item["loc"])
        what = item["msg"].removeprefix("Value error, ")
        what = {"extra_forbidden": "unknown field", "missing": "missing"}.get(item["type"], what)
        lines.append(f"{where}: {what}" if where else what)
    return "; ".join(lines[:5])


class Reply(BaseModel):
    """What a client reads: fields that it does not know are skipped."""

    model_config = ConfigDict(extra="ignore")

    def to_json(self) -> bytes:
        """Return JSON in UTF-8; what is not finite becomes null."""
        return self.model_dump_json().encode()


class TripView(Reply):
    """A cause of a trip, by its name in `schema.Trip` and in words."""

    name: str
    meaning: str


class TickView(Reply):
    """The newest tick in short."""

    tick: int
    t_ns: int
    angle_rad: float | None
    speed_Hz: float | None
    torque_Nm: float | None
    torque_set_Nm: float | None
    i_A: tuple[float | None, float | None, float | None]
    u_bus_V: float | None
    temperature_C: float | None
    brake_temperature_C: float | None
    flags: list[str]


class SetpointView(Reply):
    """What is asked of the bench now."""

    torque_Nm: float
    speed_Hz: float | None
    brake: float
    drive_Hz: float
    compensate: Compensation


class LeaseView(Reply):
    """Who is in command; a detached plan without a commander shows as `plan NAME`."""

    holder: str | None
    remaining_s: float
    duration_s: float


class LoopView(Reply):
    """How the loop keeps time: over the last second, and since it started."""

    rate_Hz: float
    ticks: int
    missed: int
    lost_by_supervisor: int
    wake_late_us_p50: float | None
    wake_late_us_p99: float | None
    wake_late_us_max: float | None
    work_us_p99: float | None
    age_s: float | None  # of the newest tick


Health = Literal["none", "simulated", "ok", "failing", "stale"]
"""Of a slow device; `failing` does not answer now, `stale` has not for its `stale_after_s`."""


class DeviceView(Reply):
    """A slow device."""

    health: Health
    status: int | None = None
    setpoint: float | None = None
    value: float | None = None
    error: str = ""
    age_s: float | None = None


class ProcessView(Reply):
    """A child process."""

    pid: int | None
    running: bool
    restarts: int
    exit: str  # how it ended last, "" if it never did


class CalibrationView(Reply):
    """The calibration in force."""

    id: str
    created: str
    age_s: float
    age: str  # in words
    method: str
    path: str


class PlanView(Reply):
    """`motord/<bench>/plan`: a plan's progress. It is over in done, aborted and failed."""

    plan: str
    state: Literal["running", "pausing", "paused", "ending", "done", "aborted", "failed"]
    step: str = ""
    message: str = ""
    points: int = 0
    points_done: int = 0
    fraction: float = 0.0
    elapsed_s: float = 0.0
    eta_s: float = 0.0
    speed_set_Hz: float = 0.0
    torque_set_Nm: float = 0.0
    detached: bool = False
    started_by: str = ""
    recording: str = ""
    settings: dict[str, Any] = {}

    @property
    def over(self) -> bool:
        """True once the plan has ended, well or not."""
        return self.state in ("done", "aborted", "failed")


class RecordingView(Reply):
    """What the recorder says of itself."""

    recording: bool
    path: str
    error: str = ""
    detail: dict[str, Any] = {}


class State(Reply):
    """`motord/<bench>/state`: everything that an operator wants to know."""

    bench: str
    motor: str
    simulated: bool
    version: str
    t_ns: int
    uptime_s: float
    state: Literal["OFF", "READY", "ENABLED", "TRIPPED"]
    fault: str
    trips: list[TripView]
    first_trip: str
    tick: TickView | None
    setpoint: SetpointView
    lease: LeaseView
    plan: PlanView | None
    loop: LoopView
    realtime: dict[str, Any]
    recording: RecordingView
    calibration: CalibrationView | None
    brake: DeviceView
    drive: DeviceView
    processes: dict[str, ProcessView]
    telemetry_dropped: int


class Event(Reply):
    """`motord/<bench>/event`: something happened, at `t_ns` (Unix)."""

    t_ns: int
    kind: str
    message: str
    data: dict[str, Any] = {}


def error_json(code: str, message: str) -> bytes:
    """Return the body of an error reply."""
    return json.dumps({"code": code, "message": message}).encode()
