"""Published messages, JSON: `state`, `event`, `plan` and `mesh`. Readers skip unknown fields."""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from motord.sequencing.settings import Compensation


class PublishedMessage(BaseModel):
    """A published message, or a part of one."""

    model_config = ConfigDict(extra="ignore")

    def to_json(self) -> bytes:
        """Return JSON in UTF-8; numbers that are not finite become null."""
        return self.model_dump_json().encode()


class TripView(PublishedMessage):
    """A cause of a trip: its name in `schema.Trip`, and what it means."""

    name: str
    meaning: str


class TripValue(PublishedMessage):
    """A quantity that an interlock watches, at the trip, and its limit."""

    value: float | None
    limit: float | None


class TripReport(PublishedMessage):
    """A trip: causes, values, what to do, and the path of the black box ("": none).

    `values` are by quantity and unit; `first` are the causes of the tick that tripped.
    """

    t_ns: int
    reason: str
    first: list[str]
    causes: list[str]
    values: dict[str, TripValue]
    action: str
    blackbox: str

    def extended(
        self, causes: list[str], values: Mapping[str, Mapping[str, float]]
    ) -> "TripReport":
        """Return the report with later causes added."""
        added = {what: TripValue.model_validate(value) for what, value in values.items()}
        changes = {"causes": [*self.causes, *causes], "values": {**self.values, **added}}
        return self.model_copy(update=changes)

    def in_words(self) -> str:
        """Return the report as one line of text."""
        reason = self.reason.partition("-> TRIPPED: ")[2] or self.reason
        box = f"; black box: {self.blackbox}" if self.blackbox else ""
        return f"{reason}; {self.action}; then `motord reset`{box}"


class TickView(PublishedMessage):
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


class TorqueSensorView(PublishedMessage):
    """High-pass of the torque sensor; 0 s passes the mean."""

    highpass_time_constant_s: float = 0.0

    @property
    def passes_mean(self) -> bool:
        """False for a sensor, piezoelectric for instance, that cannot measure a steady torque."""
        return self.highpass_time_constant_s == 0.0


class SetpointView(PublishedMessage):
    """The set-point in force; torque_target_Nm follows once the brake has risen."""

    torque_Nm: float
    torque_target_Nm: float | None = None
    speed_Hz: float | None
    brake: float
    drive_Hz: float
    compensate: Compensation


class LeaseView(PublishedMessage):
    """The holder of the lease; a detached plan without one is shown as `plan NAME`."""

    holder: str | None
    remaining_s: float
    duration_s: float


class LoopView(PublishedMessage):
    """Timing of the loop: over the last second, and since it started."""

    rate_Hz: float
    ticks: int
    missed: int
    lost_by_supervisor: int
    wake_late_us_p50: float | None
    wake_late_us_p99: float | None
    wake_late_us_max: float | None
    work_us_p99: float | None
    age_s: float | None  # of the newest tick


class LinksView(PublishedMessage):
    """The links to bridge and inverter, over the last second or, `errors`, since the loop started.

    errors: frames lost or corrupt, both links together; without_*: ticks in which nothing new had
    come, as in every other one of an inverter that sends half as often.
    """

    errors: int
    errors_last_s: int
    ticks_last_s: int
    without_encoder_last_s: int
    without_inverter_last_s: int
    bus_off: bool


Health = Literal["none", "simulated", "ok", "failing", "stale"]
"""Of a slow device; `failing` does not answer now, `stale` has not for its `stale_after_s`."""


class DeviceView(PublishedMessage):
    """A slow device."""

    health: Health
    status: int | None = None
    setpoint: float | None = None
    value: float | None = None
    error: str = ""
    age_s: float | None = None


class ClockView(PublishedMessage):
    """The bridge board's clock: drift against the host's, jitter of its samples' delay."""

    drift_ppm: float
    jitter_us: float


class ProcessView(PublishedMessage):
    """A child process. bad_messages: lines of it that were no messages; dropped_messages: what it
    did not take in time."""

    pid: int | None
    running: bool
    restarts: int
    exit: str  # how it ended last, "" if it never did
    bad_messages: int = 0
    dropped_messages: int = 0


class CalibrationView(PublishedMessage):
    """The calibration in force."""

    id: str
    created: str
    age_s: float
    age: str  # as text
    method: str
    path: str


class PlanView(PublishedMessage):
    """`motord/<bench>/plan`: a plan's progress. It is over in done, aborted and failed.

    In interrupted the daemon had ended meanwhile; it can be resumed. `run_id` stays the same then,
    and `continues` names the recording that the present one continues.
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


MESH_POINTS_MAX = 1024
"""Points in a published mesh."""


class MeshPoint(PublishedMessage):
    """An operating point of a plan, and what has become of it.

    takes: how often it was taken; quality: "" before the first take, "ok", or what is wrong with
    the last one. The errors, in percent of rated torque, are of the last take, None where not
    measured; see docs/api.md.
    """

    point: int  # `plan_point` of its ticks
    torque_Nm: float
    speed_Hz: float
    turns: int = 0
    aim: str = ""  # what is done there, if that is no torque held at a speed
    induced: dict[str, Any] = {}  # errors that are induced there on purpose
    state: Literal["planned", "taking", "done", "poor"] = "planned"
    takes: int = 0
    quality: str = ""
    rms_error_percent: float | None = None
    mean_error_percent: float | None = None


class MeshView(PublishedMessage):
    """`motord/<bench>/mesh`: the operating points of the plan under way, or of the last one.

    Of more than `MESH_POINTS_MAX` points, `points_total` in all, those about the one under way.
    """

    plan: str
    run_id: str
    points_total: int
    points: list[MeshPoint]


class RecordingView(PublishedMessage):
    """State of the recorder.

    path: the newest file by its present name, with `.part` until it is complete; final_path: its
    name from then on. error: why the recording failed; obstacle: why one could not begin now.
    """

    recording: bool
    path: str
    final_path: str = ""
    error: str = ""
    obstacle: str = ""
    detail: dict[str, Any] = {}


class BenchState(PublishedMessage):
    """`motord/<bench>/state`: the full state of bench and daemon."""

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
    ages: dict[str, float] = {}  # s, by signal; see docs/api.md
    links: LinksView | None = None  # None without a loop
    realtime: dict[str, Any]
    recording: RecordingView
    calibration: CalibrationView | None
    brake: DeviceView
    drive: DeviceView
    bridge_clock: ClockView | None = None
    processes: dict[str, ProcessView]
    faults: dict[str, str] = {}  # by part of the daemon
    telemetry_dropped: int


class Event(PublishedMessage):
    """`motord/<bench>/event`, at `t_ns` (Unix)."""

    t_ns: int
    kind: str
    message: str
    data: dict[str, Any] = {}
