"""What the daemon tells: the replies and published messages, `state`, `event` and `plan`.

They may grow: a reader skips what it does not know.
"""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from motord.sequencing.settings import Compensation


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


class TripValue(Reply):
    """A quantity that an interlock watches, at the trip, and its limit."""

    value: float | None
    limit: float | None


class TripReport(Reply):
    """What is known of a trip: why, what to do about it, where the black box goes ("": nowhere).

    `values` are by quantity and unit; `first` are the causes of the tick that tripped.
    """

    t_ns: int
    reason: str
    first: list[str]
    causes: list[str]
    values: dict[str, TripValue]
    action: str
    blackbox: str

    def further(self, causes: list[str], values: Mapping[str, Mapping[str, float]]) -> "TripReport":
        """Return the report with causes that came later."""
        added = {what: TripValue.model_validate(value) for what, value in values.items()}
        changes = {"causes": [*self.causes, *causes], "values": {**self.values, **added}}
        return self.model_copy(update=changes)

    def in_words(self) -> str:
        """Return the report in one line."""
        reason = self.reason.partition("-> TRIPPED: ")[2] or self.reason
        box = f"; black box: {self.blackbox}" if self.blackbox else ""
        return f"{reason}; {self.action}; then `motord reset`{box}"


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
    torque_ripple_Nm: float | None = None  # measured: RMS about its mean over the last second


class TorqueSensorView(Reply):
    """What the torque sensor can show; a high-pass of 0 s passes the mean."""

    highpass_time_constant_s: float = 0.0

    @property
    def passes_mean(self) -> bool:
        """False for a piezoelectric sensor, say: what it shows of a steady torque is nothing."""
        return self.highpass_time_constant_s == 0.0


class SetpointView(Reply):
    """What is asked of the bench now; torque_target_Nm comes once the brake has risen."""

    torque_Nm: float
    torque_target_Nm: float | None = None
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


class ClockView(Reply):
    """The bridge board's clock: drift against the computer's, jitter of its samples' delay."""

    drift_ppm: float
    jitter_us: float


class ProcessView(Reply):
    """A child process. bad_messages: lines of it that were no messages; dropped_messages: what it
    did not take in time."""

    pid: int | None
    running: bool
    restarts: int
    exit: str  # how it ended last, "" if it never did
    bad_messages: int = 0
    dropped_messages: int = 0


class CalibrationView(Reply):
    """The calibration in force."""

    id: str
    created: str
    age_s: float
    age: str  # in words
    method: str
    path: str


class PlanView(Reply):
    """`motord/<bench>/plan`: a plan's progress. It is over in done, aborted and failed.

    In interrupted the daemon had ended meanwhile; it can be resumed. `run_id` stays the same then,
    and `continues` names the recording that the one of now goes on from.
    """

    plan: str
    state: Literal[
        "running", "pausing", "paused", "ending", "done", "aborted", "failed", "interrupted"
    ]
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
    run_id: str = ""
    continues: str = ""

    @property
    def over(self) -> bool:
        """True once the plan is no longer under way, well or not."""
        return self.state in ("done", "aborted", "failed", "interrupted")


class RecordingView(Reply):
    """What the recorder says of itself.

    path: the newest file by the name that it has now, with `.part` until it is whole; final_path:
    the name that it gets then. error: why what should be recorded is not; obstacle: why a recording
    could not begin now, though none has to.
    """

    recording: bool
    path: str
    final_path: str = ""
    error: str = ""
    obstacle: str = ""
    detail: dict[str, Any] = {}


class BenchState(Reply):
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
    trip: TripReport | None = None
    tick: TickView | None
    torque_sensor: TorqueSensorView = TorqueSensorView()
    setpoint: SetpointView
    lease: LeaseView
    plan: PlanView | None
    loop: LoopView
    realtime: dict[str, Any]
    recording: RecordingView
    calibration: CalibrationView | None
    brake: DeviceView
    drive: DeviceView
    bridge_clock: ClockView | None = None
    processes: dict[str, ProcessView]
    faults: dict[str, str] = {}  # what is wrong with a part of the daemon, by part
    telemetry_dropped: int


class Event(Reply):
    """`motord/<bench>/event`: something happened, at `t_ns` (Unix)."""

    t_ns: int
    kind: str
    message: str
    data: dict[str, Any] = {}
