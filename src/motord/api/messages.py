"""Published messages, JSON: `state` and `event`. Readers skip unknown fields."""

from typing import Any, Literal

from pydantic import Field

from motord.api.plan_messages import PlanView
from motord.api.published_message import ChannelView, PublishedMessage, TripReport, TripView
from motord.api.queue_messages import QueueView
from motord.experiments.tracking.tracked import TrackedCalibration
from motord.schema import Compensation
from motord.section import SensorHighpass


class TickView(PublishedMessage):
    """The newest tick in short."""

    tick: int
    """Counter of the loop's periods."""
    t_ns: int
    """Unix time of the sample."""
    angle_rad: float | None
    """Mechanical angle."""
    speed_Hz: float | None
    """Turns per second."""
    torque_Nm: float | None
    """As the sensor gives it."""
    torque_set_Nm: float | None
    """Set-point in force after ramp and limits."""
    i_A: tuple[float | None, float | None, float | None]
    """Sensed currents of phases a, b, c."""
    u_bus_V: float | None
    """DC bus."""
    temperature_C: float | None
    """Of the inverter."""
    brake_temperature_C: float | None
    """Of the brake's disc."""
    flags: list[str]
    """Names of [flags](recording.md#flags)."""
    torque_ripple_Nm: float | None = None
    """Measured: RMS about its mean over the last second."""


class TorqueSensorView(SensorHighpass, PublishedMessage):
    """High-pass of the torque sensor; 0 s passes the mean."""

    highpass_time_constant_s: float = 0.0
    """0: the mean passes."""


class SetpointView(PublishedMessage):
    """The set-point in force."""

    torque_Nm: float
    """Asked of the loop now; 0 while the brake rises."""
    torque_target_Nm: float | None = None
    """What was set; follows once the brake has risen."""
    speed_Hz: float | None
    """Speed that the brake holds, turns per second."""
    brake: float
    """Excitation of the brake."""
    drive_Hz: float
    """Speed of the external drive, turns per second."""
    compensate: Compensation
    """Which parts of the calibration are applied."""

    @property
    def target_Nm(self) -> float:
        """The torque that was set."""
        return self.torque_Nm if self.torque_target_Nm is None else self.torque_target_Nm


class LeaseView(PublishedMessage):
    """The holder of the lease; a detached plan without one is shown as `plan NAME`."""

    holder: str | None
    """Who is in command."""
    remaining_s: float
    """Until the lease is lost without a renewal."""
    duration_s: float
    """`[zenoh] lease_s`."""


class LoopView(PublishedMessage):
    """Timing of the loop: over the last second, and since it started."""

    rate_Hz: float
    """Rate of the loop."""
    ticks: int
    """Since it started."""
    missed: int
    """Periods skipped since it started."""
    lost_by_supervisor: int
    """Ticks that the supervisor did not read in time."""
    wake_late_us_p50: float | None
    """Lateness of wake-up, median."""
    wake_late_us_p99: float | None
    """Lateness of wake-up, 99th percentile."""
    wake_late_us_max: float | None
    """Lateness of wake-up, largest."""
    work_us_p99: float | None
    """Work in a period, 99th percentile."""
    age_s: float | None
    """Of the newest tick."""


class LinksView(PublishedMessage):
    """The links to bridge and inverter."""

    errors: int
    """Frames lost or corrupt since the loop started, both links together."""
    errors_last_s: int
    """Frames lost or corrupt over the last second."""
    ticks_last_s: int
    """Ticks of the last second."""
    without_encoder_last_s: int
    """Ticks of the last second in which no new sample of the bridge had come."""
    without_inverter_last_s: int
    """The same of the inverter; one that sends half as often is missing in every other tick."""
    bus_off: bool
    """The CAN controller is off the bus."""
    bridge: str = ""
    """What kept the bridge board from closing the enable line in the last second, and what to do.
    """


Health = Literal["none", "simulated", "ok", "failing", "stale"]
"""Of a slow device; `failing` does not answer now, `stale` has not for its `stale_after_s`."""


class DeviceView(PublishedMessage):
    """A slow device."""

    health: Health
    """`failing` does not answer now, `stale` has not for its `stale_after_s`."""
    status: int | None = None
    """Its status register."""
    setpoint: float | None = None
    """What it was last asked for."""
    value: float | None = None
    """Temperature of the brake (°C), speed of the drive (rad/s)."""
    error: str = ""
    """Why it does not answer."""
    age_s: float | None = None
    """Of the last answer."""


class ClockView(PublishedMessage):
    """The bridge board's clock: drift against the host's, jitter of its samples' delay."""

    drift_ppm: float
    """Against the host's clock."""
    jitter_us: float
    """Of the delay of its samples."""


class ProcessView(PublishedMessage):
    """A child process."""

    pid: int | None
    """Number of the process."""
    running: bool
    """It runs."""
    restarts: int
    """How often it was started again."""
    exit: str
    """How it ended last; "": it never did."""
    bad_messages: int = 0
    """Lines of it that were no messages."""
    dropped_messages: int = 0
    """What it did not take in time."""


class CalibrationView(PublishedMessage):
    """The calibration in force."""

    id: str
    """Its hash."""
    created: str
    """When it was made."""
    age_s: float
    """Since then."""
    age: str
    """The same as text."""
    method: str
    """`joint` or `residual`."""
    path: str
    """Where the daemon keeps it; "" until it is written."""
    findings: list[str] = Field(default_factory=list)
    """Names of its serious findings, which were accepted when it was installed."""


class RecordingView(PublishedMessage):
    """State of the recorder."""

    recording: bool
    """It records now."""
    path: str
    """The newest file by its present name, with `.part` until it is complete."""
    final_path: str = ""
    """Its name from then on."""
    error: str = ""
    """Why the recording failed, or that the recorder, silent for long, may not record."""
    obstacle: str = ""
    """Why one could not begin now."""
    detail: dict[str, Any] = Field(default_factory=dict)
    """What the recorder reports of it."""


class BenchState(PublishedMessage):
    """`motord/<bench>/state`: the full state of bench and daemon."""

    bench: str
    """`[bench] name`."""
    motor: str
    """`[motor] name`."""
    simulated: bool
    """No device is real."""
    version: str
    """Of motord."""
    t_ns: int
    """Unix time of this state."""
    uptime_s: float
    """Of the daemon."""
    state: Literal["OFF", "READY", "ENABLED", "TRIPPED"]
    """State of the drive."""
    fault: str
    """What is wrong with the loop, or with a brake or drive that is needed; "": nothing."""
    remedy: str = ""
    """What to do about a loop that hangs or has ended; "": about none, and of older daemons."""
    trips: list[TripView]
    """Latched causes; in OFF: what bars enabling."""
    first_trip: str
    """The first cause alone."""
    trip: TripReport | None = None
    """The trip in force."""
    tick: TickView | None
    """The newest tick."""
    torque_sensor: TorqueSensorView = TorqueSensorView()
    """What of the torque the sensor shows."""
    setpoint: SetpointView
    """The set-point in force."""
    lease: LeaseView
    """Who is in command."""
    plan: PlanView | None
    """The plan under way, or how the last one ended."""
    queue: QueueView | None = None
    """The queue of plans in short; none of daemons without."""
    loop: LoopView
    """Timing of the loop."""
    ages: dict[str, float] = Field(default_factory=dict)
    """Seconds since each signal was sampled, by name."""
    links: LinksView | None = None
    """Errors of the links; none without a loop."""
    realtime: dict[str, Any]
    """Rights that the loop got."""
    recording: RecordingView
    """State of the recorder."""
    calibration: CalibrationView | None
    """The calibration in force."""
    tracking: TrackedCalibration | None = None
    """What ordinary operation shows of it; none unless `[tracking] enabled`."""
    brake: DeviceView
    """The brake."""
    drive: DeviceView
    """The external drive."""
    channels: list[ChannelView] = Field(default_factory=list)
    """Slow channels, as in the bench file."""
    bridge_clock: ClockView | None = None
    """The bridge board's clock."""
    processes: dict[str, ProcessView]
    """Children of the daemon, by name."""
    faults: dict[str, str] = Field(default_factory=dict)
    """By part of the daemon."""
    telemetry_dropped: int
    """Messages dropped before they reached the network."""


class Event(PublishedMessage):
    """`motord/<bench>/event`, at `t_ns` (Unix)."""

    t_ns: int
    """Unix time."""
    kind: str
    """As listed above."""
    message: str
    """What happened."""
    data: dict[str, Any] = Field(default_factory=dict)
    """Its particulars."""
