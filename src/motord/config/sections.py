"""The tables of a bench file, each checked by itself; `config.bench`: what holds between them."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config.base import CPUS_MAX, PlainName, Section
from motord.config.channels import Channels
from motord.config.devices import BridgeConfig, InverterConfig
from motord.config.devices.slow_devices import BrakeConfig, DriveConfig
from motord.config.experiments import Plans
from motord.config.motor import MotorConfig, TorqueSensorConfig
from motord.config.motor.accuracy import AccuracyConfig
from motord.config.timing import (
    CURRENT_ERROR,
    ENABLE_MAX_S,
    FILE_MIN_MB,
    FILE_MIN_S,
    INTERVALS_MIN,
    JUMP_MAX_RAD,
    ORDER_S,
    OVERRUN_TICKS_MAX,
    RAMP_DOWN_MAX_S,
    RATE_MAX_HZ,
    RATE_MIN_HZ,
    RING_MIN_S,
    SILENCE_MAX_S,
    SUPERVISOR_ACTS_S,
    SUPERVISOR_TIMEOUT_MIN_S,
    TORQUE_ERROR,
)
from motord.config.zenoh import ZenohConfig
from motord.section.quantities import (
    AngularSpeed,
    Current,
    Temperature,
    Torque,
    Voltage,
    VoltageFromZero,
    Wait,
)


class BenchConfig(Section):
    """`[bench]`: its name and, for a simulated or emulated bench, what is true of it."""

    name: PlainName = "bench"
    """Part of every Zenoh key and of every recording's name: letters, digits, `_.-`."""
    rig: Path | None = None
    """Truth of a simulated or emulated bench; next to the bench file, or `package:NAME`."""
    faults: Path | None = None
    """A timeline of faults to inject into a simulated or an emulated bench."""
    rig_patience_s: Wait | None = None
    """For an emulator on a computer that stalls: of the time of a stall the rig makes up for so
    much at most; and while the power stage is on, its time stands still once no current command
    has come for so long, until one comes or the inverter's timeout is over. Left out: the rig goes
    on, as a real one does."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of all that is random in a simulated rig."""
    notes: str = ""
    """Free text, for every recording."""


class LoopConfig(Section):
    """`[loop]`: the real-time loop and its observer."""

    rate_Hz: Annotated[int, Field(ge=RATE_MIN_HZ, le=RATE_MAX_HZ)] = 1000
    """Rate of the loop."""
    cpu: Annotated[int, Field(ge=0, lt=CPUS_MAX)] | None = None
    """Processor that the loop is bound to; left out: any."""
    priority: Annotated[int, Field(ge=1, le=98)] = 80
    """Priority in the scheduling class SCHED_FIFO."""
    spin: bool = True
    """Sleep until shortly before each deadline and spin until it; `false` sleeps all the way."""
    observer_bandwidth_Hz: Annotated[float, Field(ge=15, le=10_000)] = 30.0
    """Bandwidth of the observer that estimates angle and speed from the encoder: the higher, the
    more a count and the times of samples move the speed, so limits have to be larger."""
    supervisor_timeout_s: Annotated[float, Field(ge=SUPERVISOR_TIMEOUT_MIN_S, le=SILENCE_MAX_S)] = (
        0.25
    )
    """Without a sign of life from the supervisor for so long the torque ramps to zero, then trips.
    """
    enable_timeout_s: Annotated[float, Field(gt=0, le=ENABLE_MAX_S)] = 1.0
    """Inverter and enable line have to be ready within this time of being enabled, and say so. A
    status of before they can have been off, if they were disabled just before, does not count."""
    overrun_ticks: Annotated[int, Field(ge=INTERVALS_MIN, le=OVERRUN_TICKS_MAX)] = 50
    """Missed periods in a row that trip; a single one is no fault."""
    ring_s: Annotated[float, Field(ge=RING_MIN_S, le=120)] = 15.0
    """Ticks that the shared memory keeps for the recorder."""


class LimitsConfig(Section):
    """`[limits]`: what the loop never exceeds (references) and what it trips at."""

    torque_Nm: Torque = 6.0
    """Largest torque set-point, of either sign."""
    torque_rate_Nm_per_s: Annotated[float, Field(gt=0, le=1_000_000_000)] = 10.0
    """Rate of the ramp to a new set-point; down to zero, on disable, it takes a second at most."""
    current_A: Current = 25.0
    """Largest commanded phase current."""
    trip_current_A: Current = 35.0
    """A sensed phase current above it trips."""
    i2t_current_A: Current = 20.0
    """Phase current that may flow for ever; I2T trips at no command that is not above it."""
    i2t_time_s: Annotated[float, Field(gt=0, le=3600)] = 10.0
    """1.41 times i2t_current_A may flow for so long, 2 times for a third of it."""
    i2t_derating_from_C: Temperature | None = None
    """Above this temperature of the winding, the hottest channel with role = "winding", only a part
    of i2t_time_s is allowed; left out: the temperature makes no difference."""
    i2t_derating_to_C: Temperature | None = None
    """Down to nothing from this temperature on: then no more than i2t_current_A may flow."""
    trip_speed_rad_s: AngularSpeed = 20.0
    """A speed above it trips, of either sign; set-points end at 80 % of it."""
    trip_torque_Nm: Torque = 12.0
    """A measured torque above it trips, of either sign."""
    trip_temperature_C: Temperature = 100.0
    """An inverter that is hotter trips."""
    bus_V_min: VoltageFromZero = 18.0
    """A DC bus below it trips."""
    bus_V_max: Voltage = 32.0
    """A DC bus above it trips."""
    link_errors_per_s: Annotated[float, Field(ge=1, le=2 * RATE_MAX_HZ)] = 50.0
    """Frames lost or corrupt, both links, that trip; one now and then may be lost."""
    encoder_jump_rad: Annotated[float, Field(gt=0, le=JUMP_MAX_RAD)] = 0.15
    """How far an encoder sample may be from where the speed would have taken the rotor in 5 ms. At
    least as far as a sound one is, by its counts and the observer's lag, at 100 rad/s^2."""
    current_error_A: Current | None = None
    """How far a sensed current may be from its command; left out: a quarter of current_A. Less than
    0.866 of current_A, or a drive without any current would not trip at full current."""
    current_error_s: Annotated[float, Field(gt=0, le=1)] = 0.02
    """How long it may be further off, counted up and down; at least a period of the loop."""
    torque_error_Nm: Torque | None = None
    """How far the measured torque may be from the set-point, besides a fifth of it and what induced
    offsets of the currents make at most, as of the plan `align`; left out: 0.3 torque_Nm. Less than
    0.8 of torque_Nm, or a torque sensor that stays at zero would not trip. `motord check` says
    what a high-pass hides nevertheless."""
    torque_error_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    """How long it may be further off; at least until a step of the torque has settled and shows,
    and for as long as a ramp leaves it that far behind."""

    @property
    def greatest_current_error_A(self) -> float:
        """How far a sensed current may be from its command."""
        return self.current_error_A or CURRENT_ERROR * self.current_A

    @property
    def greatest_torque_error_Nm(self) -> float:
        """How far the measured torque may be from the set-point, besides TORQUE_SHARE of it."""
        return self.torque_error_Nm or TORQUE_ERROR * self.torque_Nm

    @property
    def ramp_down_Nm_per_s(self) -> float:
        """How fast the torque goes to zero on disable, or without a supervisor or commander."""
        return max(self.torque_rate_Nm_per_s, self.torque_Nm / RAMP_DOWN_MAX_S)

    @model_validator(mode="after")
    def _derating_rises(self) -> "LimitsConfig":
        begins_C, ends_C = self.i2t_derating_from_C, self.i2t_derating_to_C
        if (begins_C is None) != (ends_C is None):
            raise ValueError("i2t_derating_from_C and i2t_derating_to_C go together")
        if begins_C is not None and ends_C is not None and ends_C <= begins_C:
            raise ValueError(
                f"i2t_derating_to_C = {ends_C:g} must be above i2t_derating_from_C = {begins_C:g}"
            )
        return self

    @model_validator(mode="after")
    def _trip_above_limit(self) -> "LimitsConfig":
        for name, what in (("current_A", "command"), ("torque_Nm", "torque")):
            trip, limit = getattr(self, f"trip_{name}"), getattr(self, name)
            if trip <= limit:
                raise ValueError(
                    f"trip_{name} = {trip:g} must be above {name} = {limit:g}, or every full "
                    f"{what} would trip"
                )
        if self.bus_V_max <= self.bus_V_min:
            raise ValueError("bus_V_max must be above bus_V_min")
        return self


class RecordingConfig(Section):
    """`[recording]`: where runs go and how they are written."""

    directory: Path = Path("runs")
    """Relative to the folder in which the daemon is started."""
    auto: bool | Literal["always"] = True
    """Manual operation is recorded while the bench is powered, `"always"`, or not."""
    required: bool = True
    """A plan that cannot be recorded is refused, or ended."""
    chunk_s: Annotated[float, Field(ge=0.01, le=10)] = 0.25
    """Time span of a chunk: what is compressed at once, and lost with the recorder."""
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    """`zstd` makes the smallest files, `lz4` those read fastest."""
    sync_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0
    """Within this time what was recorded is confirmed by the disk."""
    file_max_s: Annotated[float, Field(ge=FILE_MIN_S, le=2_678_400)] = 3600.0
    """Length after which the recording goes on in the next file."""
    file_max_MB: Annotated[float, Field(ge=FILE_MIN_MB, le=1_000_000_000)] = 4096.0
    """Size after which it does so, too."""
    free_min_MB: Annotated[float, Field(ge=0, le=1_000_000_000)] = 500.0
    """With less free space a recording ends, and none begins."""
    blackbox_keep: Annotated[int, Field(ge=1, le=10_000)] = 50
    """Black boxes kept of a bench, the newest ones."""

    @property
    def blackbox_directory(self) -> Path:
        """Where black boxes go; the `blackbox_keep` newest of a bench are kept."""
        return self.directory / "blackbox"


class CalibrationConfig(Section):
    """`[calibration]`: what is asked of the calibration in force."""

    check_before_plans: bool = False
    """Before a plan that compensates, run `check-calibration`, ten seconds at 0.85 of the rated
    torque by default: the plan begins unless a drift is found."""


class TrackingConfig(Section):
    """`[tracking]`: gains, offsets and cogging torque in ordinary operation, with forgetting."""

    enabled: bool = False
    """Follow the calibration in force while it is applied, in a process of 200 MB."""
    memory_s: Annotated[float, Field(ge=10, le=3600)] = 300.0
    """Time after which a turn counts 1/e: a longer one makes intervals narrower, and slower."""


class Sections(Section):
    """All tables of a bench file, and the times that follow from several of them."""

    bench: BenchConfig = BenchConfig()
    loop: LoopConfig = LoopConfig()
    inverter: InverterConfig = InverterConfig()
    bridge: BridgeConfig = BridgeConfig()
    torque_sensor: TorqueSensorConfig = TorqueSensorConfig()
    accuracy: AccuracyConfig = AccuracyConfig()
    brake: BrakeConfig = BrakeConfig()
    drive: DriveConfig = DriveConfig()
    channels: Channels = ()
    motor: MotorConfig
    limits: LimitsConfig = LimitsConfig()
    recording: RecordingConfig = RecordingConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    tracking: TrackingConfig = TrackingConfig()
    zenoh: ZenohConfig = ZenohConfig()
    plans: Plans

    @property
    def sample_rate_Hz(self) -> int:
        """Samples that the bridge takes in a second."""
        return self.bridge.rate_Hz or self.loop.rate_Hz

    @property
    def sample_interval_s(self) -> float:
        """Time between two samples of the bridge as the loop sees them."""
        return 1.0 / min(self.loop.rate_Hz, self.sample_rate_Hz)

    @property
    def torque_Nm_per_count(self) -> float:
        """Torque for each count of the bridge's converter."""
        return self.bridge.adc_V_per_count * self.torque_sensor.gain_Nm_per_V

    @property
    def setpoint_valid_s(self) -> float:
        """For this long after a step of the supervisor its set-points for slow devices are good."""
        return min(self.loop.supervisor_timeout_s, ORDER_S)

    def wind_down_s(self, torque_Nm: float) -> float:
        """Return within what time no torque is left, whatever the supervisor does meanwhile.

        One that hangs is missed by the loop after supervisor_timeout_s; the ramp follows.
        """
        ramp_s = abs(torque_Nm) / self.limits.ramp_down_Nm_per_s
        return ramp_s + self.loop.supervisor_timeout_s + SUPERVISOR_ACTS_S

    @property
    def longest_wind_down_s(self) -> float:
        """Return `wind_down_s` from the largest torque that may be set."""
        return self.wind_down_s(self.limits.torque_Nm)

    @property
    def renew_within_s(self) -> float:
        """Within this time a lease has to be renewed, whatever the torque."""
        return self.zenoh.lease_s - self.longest_wind_down_s

    @property
    def simulated(self) -> bool:
        """True if the rig runs inside the loop process instead of on a wire."""
        return self.inverter.driver == "sim"
