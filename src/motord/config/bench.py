"""A whole bench: `[bench] [loop] [limits] [recording] [zenoh] [plans.*]` and the devices."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from motord import DEFAULT_ENDPOINT
from motord.config.base import Finite, NonNegative, Positive, Section
from motord.config.devices import (
    BrakeConfig,
    BridgeConfig,
    DriveConfig,
    InverterConfig,
    shares_line,
)
from motord.config.experiments import Plans
from motord.config.motor import MotorConfig, TorqueSensorConfig
from motord.config.timing import (
    JUMP_MAX_RAD,
    RAMP_DOWN_MAX_S,
    RATE_MAX_HZ,
    RATE_MIN_HZ,
    SILENCE_MAX_S,
    refused,
)


class BenchConfig(Section):
    """`[bench]`: its name (part of every Zenoh key) and, for a simulated bench, the rig's truth.

    rig_patience_s is for the emulator on computers that stall: the rig's time stands still when the
    emulator has not run for so long and, with the power stage on, when no current command has come
    for so long, until one comes or the inverter's timeout is over. Without it the rig plays on, as
    a real one does. faults is a timeline of faults to inject (`config.faults`), for a simulated or
    an emulated bench.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] = "bench"
    rig: Path | None = None
    faults: Path | None = None
    rig_patience_s: Positive | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    notes: str = ""


class LoopConfig(Section):
    """`[loop]`: the real-time loop and its observer."""

    rate_Hz: Annotated[int, Field(ge=RATE_MIN_HZ, le=RATE_MAX_HZ)] = 1000
    cpu: Annotated[int, Field(ge=0)] | None = None
    priority: Annotated[int, Field(ge=1, le=98)] = 80
    spin: bool = True
    observer_bandwidth_Hz: Annotated[float, Field(ge=15, le=10_000)] = 30.0
    supervisor_timeout_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.25
    enable_timeout_s: Annotated[float, Field(gt=0, le=10)] = 1.0
    overrun_ticks: Annotated[int, Field(ge=1)] = 50
    ring_s: Annotated[float, Field(ge=1, le=120)] = 15.0


class LimitsConfig(Section):
    """`[limits]`: what the loop never exceeds (references) and what it trips at.

    current_error_A is how far a sensed current may be from its command, by default a quarter of
    current_A; torque_error_Nm how far the measured torque may be from the set-point, besides a
    fifth of it, by default 0.3 torque_Nm; for current_error_s and torque_error_s on end.
    """

    torque_Nm: Positive = 6.0
    torque_rate_Nm_per_s: Positive = 10.0
    current_A: Positive = 25.0
    trip_current_A: Positive = 35.0
    i2t_current_A: Positive = 20.0
    i2t_time_s: Positive = 10.0
    trip_speed_rad_s: Positive = 20.0
    trip_torque_Nm: Positive = 12.0
    trip_temperature_C: Finite = 100.0
    bus_V_min: NonNegative = 18.0
    bus_V_max: Positive = 32.0
    link_errors_per_s: Positive = 50.0
    encoder_jump_rad: Annotated[float, Field(gt=0, le=JUMP_MAX_RAD)] = 0.15
    current_error_A: Positive | None = None
    current_error_s: Annotated[float, Field(gt=0, le=1)] = 0.02
    torque_error_Nm: Positive | None = None
    torque_error_s: Annotated[float, Field(gt=0, le=1)] = 0.1

    @property
    def ramp_down_Nm_per_s(self) -> float:
        """How fast the torque goes to zero on disable, or without a supervisor or commander."""
        return max(self.torque_rate_Nm_per_s, self.torque_Nm / RAMP_DOWN_MAX_S)

    @model_validator(mode="after")
    def _trip_above_limit(self) -> "LimitsConfig":
        if self.trip_current_A <= self.current_A:
            raise ValueError(
                f"trip_current_A = {self.trip_current_A:g} must be above "
                f"current_A = {self.current_A:g}, or every full command would trip"
            )
        if self.bus_V_max <= self.bus_V_min:
            raise ValueError("bus_V_max must be above bus_V_min")
        return self


_LOOPBACK = r"tcp/(127\.\d+\.\d+\.\d+|\[::1\]|localhost):\d{1,5}"
_SOCKET = r"unixsock-stream/(?=.{2,100}$)(/[\w.@+-]+)+"
_TLS = r"tls/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+):\d{1,5}"


def _closed_to_others(endpoints: tuple[str, ...]) -> tuple[str, ...]:
    own = re.compile(f"{_LOOPBACK}|{_SOCKET}")
    form = re.compile(f"{own.pattern}|{_TLS}")
    if not any(own.fullmatch(endpoint) for endpoint in endpoints) or not all(
        form.fullmatch(endpoint) for endpoint in endpoints
    ):
        raise ValueError(
            "whoever reaches the daemon may command it, so it listens on TCP ports of this "
            'machine alone, such as "tcp/127.0.0.1:7447", or on a Unix socket, such as '
            f'"unixsock-stream//run/motord/bench.sock"; got {", ".join(endpoints) or "none"}. '
            'Other machines come in by "tls/0.0.0.0:7448" besides, with certificates and roles: '
            "`motord security init` makes them"
        )
    return endpoints


SUPERVISOR_ACTS_S = 0.05
"""Within this time the supervisor has acted on what the ticks or the clock tell it: two of its
steps, a plan's look and a tick."""
ORDER_S = 0.1
"""Longest time for which a set-point of the supervisor for a slow device is good."""
DRIVE_FALLS_S = 0.5
"""Within this time after anything of the daemon hangs, the speed of an external drive falls."""
DRIVE_REACTS_S = 0.1
"""Of it, what the drive itself may take."""
RENEWAL_S = 0.2
"""A lease must leave at least this time for its renewal."""


Endpoints = Annotated[tuple[str, ...], AfterValidator(_closed_to_others)]
"""Zenoh endpoints: TCP or Unix sockets of this machine alone, at least one, and TLS."""


class RecordingConfig(Section):
    """`[recording]`: where runs go and how they are written.

    auto: hand operation is recorded while the bench is powered, or "always". required: a plan that
    cannot be recorded is refused or ended.
    """

    directory: Path = Path("runs")
    auto: bool | Literal["always"] = True
    required: bool = True
    chunk_s: Annotated[float, Field(ge=0.01, le=10)] = 0.25
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    sync_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0
    file_max_s: Positive = 3600.0
    file_max_MB: Positive = 4096.0
    free_min_MB: NonNegative = 500.0
    blackbox_keep: Annotated[int, Field(ge=1, le=10_000)] = 50

    @property
    def blackbox_directory(self) -> Path:
        """Where black boxes go; the `blackbox_keep` newest of a bench are kept."""
        return self.directory / "blackbox"


class TlsConfig(Section):
    """`[zenoh.tls]`: who comes in from other machines; `motord security init` makes the files."""

    ca: Path
    certificate: Path
    key: Path
    roles: Path


class ZenohConfig(Section):
    """`[zenoh]`: endpoints and telemetry rate. Beyond this machine only by TLS with `tls`.

    socket_group is the group whose members may connect to Unix sockets among the endpoints, by
    default that of the daemon.
    """

    listen: Endpoints = (DEFAULT_ENDPOINT,)
    tick_rate_Hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    block_s: Annotated[float, Field(ge=0.01, le=1)] = 0.1
    lease_s: Annotated[float, Field(ge=0.2, le=60)] = 2.0
    socket_group: Annotated[str, Field(min_length=1, max_length=32)] | None = None
    tls: TlsConfig | None = None

    @property
    def local(self) -> tuple[str, ...]:
        """Endpoints of this machine alone."""
        return tuple(endpoint for endpoint in self.listen if not endpoint.startswith("tls/"))

    @property
    def remote(self) -> tuple[str, ...]:
        """Endpoints that other machines reach, with a certificate."""
        return tuple(endpoint for endpoint in self.listen if endpoint.startswith("tls/"))

    @model_validator(mode="after")
    def _a_group_needs_a_socket(self) -> "ZenohConfig":
        if self.socket_group and not any(e.startswith("unixsock-stream/") for e in self.listen):
            raise ValueError(
                f"socket_group = '{self.socket_group}' without an endpoint such as "
                '"unixsock-stream//run/motord/bench.sock" in listen'
            )
        return self

    @model_validator(mode="after")
    def _tls_is_all_or_nothing(self) -> "ZenohConfig":
        if self.remote and self.tls is None:
            raise ValueError(
                f"{', '.join(self.remote)} needs [zenoh.tls]: `motord security init` makes "
                "certificates and roles, and prints the section"
            )
        if self.tls is not None and not self.remote:
            raise ValueError('[zenoh.tls] without an endpoint such as "tls/0.0.0.0:7448" in listen')
        return self


_ON_CAN = ("can", "can-dq")
BUS_LOAD_MAX = 0.9
"""Most of a CAN bus that the bridge may take at worst; the rest is for Status, at 20 Hz, and for
frames sent again."""


class Config(Section):
    """A whole bench."""

    bench: BenchConfig = BenchConfig()
    loop: LoopConfig = LoopConfig()
    inverter: InverterConfig = InverterConfig()
    bridge: BridgeConfig = BridgeConfig()
    torque_sensor: TorqueSensorConfig = TorqueSensorConfig()
    brake: BrakeConfig = BrakeConfig()
    drive: DriveConfig = DriveConfig()
    motor: MotorConfig
    limits: LimitsConfig = LimitsConfig()
    recording: RecordingConfig = RecordingConfig()
    zenoh: ZenohConfig = ZenohConfig()
    plans: Plans

    @model_validator(mode="after")
    def _sim_is_all_or_nothing(self) -> "Config":
        drivers = {"inverter": self.inverter.driver, "bridge": self.bridge.driver}
        if len({driver == "sim" for driver in drivers.values()}) > 1:
            raise ValueError(
                "inverter and bridge are simulated together or not at all; got "
                + ", ".join(f'[{k}] driver = "{v}"' for k, v in drivers.items())
            )
        return self

    @model_validator(mode="after")
    def _interlocks_keep_their_times(self) -> "Config":
        if reasons := list(refused(self)):
            raise ValueError("; ".join(reasons))
        return self

    @model_validator(mode="after")
    def _bus_voltage_is_watched(self) -> "Config":
        can = self.inverter.can
        if self.inverter.driver in _ON_CAN and can and not can.signals.feedback_u_bus_V:
            raise ValueError(
                "[inverter.can.signals] has no feedback_u_bus_V: the interlock of the bus voltage "
                "needs it"
            )
        return self

    @model_validator(mode="after")
    def _bridge_fits_its_bus(self) -> "Config":
        can, sample_Hz = self.bridge.can, self.bridge.rate_Hz or self.loop.rate_Hz
        if self.bridge.driver != "can" or can is None:
            return self
        load = can.load(sample_Hz, self.loop.rate_Hz)
        if load > BUS_LOAD_MAX:
            raise ValueError(
                f"[bridge.can] samples at {sample_Hz} Hz and heartbeats at {self.loop.rate_Hz} Hz "
                f"take up to {load:.0%} of the bus; lower [bridge] rate_Hz or [loop] rate_Hz, or "
                "raise bitrate, or take CAN FD with a data_bitrate"
            )
        return self

    @model_validator(mode="after")
    def _lease_outlasts_the_ramp(self) -> "Config":
        least_s = self.wind_down_s(self.limits.torque_Nm) + RENEWAL_S
        if self.zenoh.lease_s < least_s:
            raise ValueError(
                f"[zenoh] lease_s = {self.zenoh.lease_s:g} is too short: no torque may be left "
                f"when it ends, and the ramp from [limits] torque_Nm = {self.limits.torque_Nm:g} "
                f"takes {self.limits.torque_Nm / self.limits.ramp_down_Nm_per_s:g} s, besides "
                f"[loop] supervisor_timeout_s = {self.loop.supervisor_timeout_s:g} and the time "
                f"for a renewal; make it at least {least_s:.2f}"
            )
        return self

    @property
    def order_s(self) -> float:
        """For this long after a step of the supervisor its set-points for slow devices are good."""
        return min(self.loop.supervisor_timeout_s, ORDER_S)

    @model_validator(mode="after")
    def _drive_stops_without_the_daemon(self) -> "Config":
        """Whatever of the daemon hangs, the drive's speed falls within DRIVE_FALLS_S.

        Its last set-point is written at most a timeout after the order's end; then its watchdog
        runs. A brake on the same serial line may keep it waiting besides.
        """
        modbus, brake = self.drive.modbus, self.brake.modbus
        if self.drive.driver != "modbus" or modbus is None:
            return self
        if modbus.watchdog_s == 0.0:
            raise ValueError(
                "[drive.modbus] has no watchdog_s: a drive that nobody writes to any more would "
                "turn the rotor for ever. Set a watchdog (communication timeout) in the drive and "
                "say here what it is, such as watchdog_s = 0.2; one without cannot be used"
            )
        wait_s, waits = modbus.timeout_s, "timeout_s"
        if self.brake.driver == "modbus" and brake is not None and shares_line(modbus, brake):
            wait_s, waits = wait_s + brake.timeout_s, "timeout_s, and that of the brake on its line"
        most_s = DRIVE_FALLS_S - DRIVE_REACTS_S - self.order_s
        if modbus.watchdog_s + wait_s > most_s * (1 + 1e-9):
            raise ValueError(
                f"[drive.modbus] watchdog_s = {modbus.watchdog_s:g} and {waits} ({wait_s:g} s) are "
                f"too long: the rotor's speed has to fall within {DRIVE_FALLS_S:g} s if the daemon "
                f"hangs. Together they may be {most_s:g} s, such as 0.2 and 0.1"
            )
        if 2 * self.drive.poll_s > modbus.watchdog_s:
            raise ValueError(
                f"[drive] poll_s = {self.drive.poll_s:g} is too long for [drive.modbus] "
                f"watchdog_s = {modbus.watchdog_s:g}: one failed exchange would stop the drive; "
                f"make it at most {modbus.watchdog_s / 2:g}"
            )
        return self

    def wind_down_s(self, torque_Nm: float) -> float:
        """Return within what time no torque is left, whatever the supervisor does meanwhile.

        One that hangs is missed by the loop after supervisor_timeout_s; the ramp follows.
        """
        ramp_s = abs(torque_Nm) / self.limits.ramp_down_Nm_per_s
        return ramp_s + self.loop.supervisor_timeout_s + SUPERVISOR_ACTS_S

    @property
    def renew_within_s(self) -> float:
        """Within this time a lease has to be renewed, whatever the torque."""
        return self.zenoh.lease_s - self.wind_down_s(self.limits.torque_Nm)

    @model_validator(mode="after")
    def _rotating_needs_a_star(self) -> "Config":
        if self.inverter.driver == "can-dq" and self.motor.connection != "star":
            raise ValueError(
                f'[inverter] driver = "can-dq" with [motor] connection = "{self.motor.connection}"'
                ": currents along d and q say nothing of the part that is common to all phases, "
                "which independent windings can carry; it takes a star"
            )
        return self

    @property
    def simulated(self) -> bool:
        """True if the rig runs inside the loop process instead of on a wire."""
        return self.inverter.driver == "sim"
