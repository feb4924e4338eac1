"""The bench file: TOML into validated, frozen models; every number carries its unit in its name.

`load(path)` reads a bench, `load_motor(path)` a file with `[motor]` and perhaps `[torque_sensor]`.
Whatever is wrong comes as one `ConfigError` naming file, line, key, what is wrong and what would
be right; unknown keys are errors.
"""

import difflib
import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]


class ConfigError(Exception):
    """A bench file that cannot be used; the message says where, what and what to do."""


class Section(BaseModel):
    """A table of the bench file: immutable, no unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class BackEmfHarmonic(Section):
    """One order h of the back-EMF of phase a: k_a = A sin(h pole_pairs theta + phase)."""

    order: Annotated[int, Field(ge=1)]
    amplitude_V_s_per_rad: Finite
    phase_rad: Finite = 0.0


class MotorConfig(Section):
    """`[motor]`: what the controller is told of the motor."""

    name: str
    serial: str = ""
    pole_pairs: Annotated[int, Field(ge=1, le=200)]
    slots: Annotated[int, Field(ge=1, le=1000)]
    counts: Annotated[int, Field(ge=16, le=1_048_576)]
    rated_torque_Nm: Positive
    connection: Literal["star", "independent"]
    back_emf: Annotated[tuple[BackEmfHarmonic, ...], Field(min_length=1)] | Path
    encoder_offset_rad: Finite = 0.0
    encoder_direction: Literal[1, -1] = 1

    def back_emf_table(self) -> np.ndarray:
        """Return k, shape (counts, 3), V s/rad: back-EMF over speed at angles 2 pi n / counts."""
        if isinstance(self.back_emf, Path):
            return _read_back_emf_table(self.back_emf, self.counts)
        theta_rad = 2 * np.pi * np.arange(self.counts) / self.counts + self.encoder_offset_rad
        table = np.zeros((self.counts, 3))
        for phase in range(3):
            electrical_rad = self.pole_pairs * theta_rad - phase * 2 * np.pi / 3
            for h in self.back_emf:
                table[:, phase] += h.amplitude_V_s_per_rad * np.sin(
                    h.order * electrical_rad + h.phase_rad
                )
        return table


class TorqueSensorConfig(Section):
    """`[torque_sensor]`: the sensor's data sheet; a high-pass of 0 s passes the mean."""

    highpass_time_constant_s: NonNegative = 0.0
    resonance_Hz: NonNegative = 0.0
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.0
    gain_Nm_per_V: Positive = 1.0


class BenchConfig(Section):
    """`[bench]`: its name (part of every Zenoh key) and, for a simulated bench, the rig's truth."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] = "bench"
    rig: Path | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    notes: str = ""


class LoopConfig(Section):
    """`[loop]`: the real-time loop and its observer."""

    rate_Hz: Annotated[int, Field(ge=100, le=20_000)] = 1000
    cpu: Annotated[int, Field(ge=0)] | None = None
    priority: Annotated[int, Field(ge=1, le=98)] = 80
    observer_bandwidth_Hz: Positive = 30.0
    supervisor_timeout_s: Positive = 0.25
    enable_timeout_s: Positive = 1.0
    overrun_ticks: Annotated[int, Field(ge=1)] = 50
    ring_s: Annotated[float, Field(ge=1, le=120)] = 15.0


class CanSignalMap(Section):
    """Names in the DBC of what motord sends and reads: `Message.Signal`.

    The command is one message; the feedback may lie in several, each with a counter and a CRC of
    its own, or none. `command_constants` sets other signals of the command. The masks tell which
    bits of the drive's status word mean what (0 = the drive does not say).
    """

    command_i_A: tuple[str, str, str]
    command_enable: str
    command_enable_value: Annotated[int, Field(ge=1)] = 1
    command_constants: dict[str, Finite] = {}
    command_counter: str = ""
    command_crc: str = ""
    feedback_i_A: tuple[str, str, str]
    feedback_u_V: tuple[str, str, str] | tuple[()] = ()
    feedback_u_bus_V: str = ""
    feedback_temperature_C: str = ""
    feedback_status: str
    feedback_counter: tuple[str, ...] = ()
    feedback_crc: tuple[str, ...] = ()
    status_ready_mask: Annotated[int, Field(ge=0)] = 1
    status_fault_mask: Annotated[int, Field(ge=0)] = 2
    status_timeout_mask: Annotated[int, Field(ge=0)] = 4
    status_enable_line_mask: Annotated[int, Field(ge=0)] = 8


class CanConfig(Section):
    """`[inverter.can]`: any interface of python-can, and the DBC with its signal map."""

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(gt=0)] | None = None
    fd: bool = True
    data_bitrate: Annotated[int, Field(gt=0)] | None = None
    options: dict[str, str | int | float | bool] = {}
    connect_timeout_s: Positive = 2.0
    dbc: Path
    signals: CanSignalMap


class InverterConfig(Section):
    """`[inverter]`: the drive's driver and timing."""

    driver: str = "sim"
    can: CanConfig | None = None
    stale_after_s: Positive = 0.02
    timeout_s: Positive = 0.05
    actuation_delay_s: NonNegative = 0.0008
    feedback_age_s: NonNegative = 0.0

    @model_validator(mode="after")
    def _needs_can(self) -> "InverterConfig":
        if self.driver == "can" and self.can is None:
            raise ValueError('driver = "can" needs a table [inverter.can]')
        return self


class BridgeConfig(Section):
    """`[bridge]`: the board that samples encoder and torque sensor."""

    driver: str = "sim"
    port: str = ""
    baud: Annotated[int, Field(gt=0)] = 2_000_000
    rate_Hz: Annotated[int, Field(ge=100, le=20_000)] | None = None
    stale_after_s: Positive = 0.02
    heartbeat_timeout_s: Positive = 0.05
    connect_timeout_s: Positive = 2.0
    adc_V_per_count: Positive = 10.0 / 32768

    @model_validator(mode="after")
    def _needs_port(self) -> "BridgeConfig":
        if self.driver == "serial" and not self.port:
            raise ValueError('driver = "serial" needs port, for example port = "/dev/ttyACM0"')
        return self


RegisterKind = Literal["u16", "i16", "u32", "i32"]
"""How a number lies in registers: unsigned or two's complement, one register or two."""


class ModbusConfig(Section):
    """`[brake.modbus]`, `[drive.modbus]`: transport, unit and registers of a Modbus device.

    `timeout_s` is for one request. `watchdog_s` tells when the device itself drops its set-point
    to zero if nobody writes it (0 = never): set in the device, and followed by the emulated one.
    """

    transport: Literal["tcp", "rtu"] = "tcp"
    host: str = "127.0.0.1"
    tcp_port: Annotated[int, Field(ge=1, le=65535)] = 502
    serial_port: str = ""
    baud: Annotated[int, Field(gt=0)] = 115_200
    parity: Literal["N", "E", "O"] = "N"
    stop_bits: Literal[1, 2] = 1
    unit: Annotated[int, Field(ge=1, le=247)] = 1
    timeout_s: Annotated[float, Field(gt=0, le=5)] = 0.1
    watchdog_s: NonNegative = 0.0
    word_order: Literal["big", "little"] = "big"
    setpoint_register: Annotated[int, Field(ge=0, le=65535)] = 0
    setpoint_kind: RegisterKind = "u16"
    setpoint_scale: Positive = 0.0001
    read_table: Literal["holding", "input"] = "holding"
    status_register: Annotated[int, Field(ge=0, le=65535)] = 16
    status_ready_mask: Annotated[int, Field(ge=0, le=65535)] = 1
    status_fault_mask: Annotated[int, Field(ge=0, le=65535)] = 2
    value_register: Annotated[int, Field(ge=0, le=65535)] = 17
    value_kind: RegisterKind = "i16"
    value_scale: Positive = 0.1

    @model_validator(mode="after")
    def _needs_serial_port(self) -> "ModbusConfig":
        if self.transport == "rtu" and not self.serial_port:
            raise ValueError('transport = "rtu" needs serial_port')
        return self

    @model_validator(mode="after")
    def _registers_apart(self) -> "ModbusConfig":
        taken: dict[int, str] = {}
        blocks = [
            ("status_register", self.status_register, "u16"),
            ("value_register", self.value_register, self.value_kind),
        ]
        if self.read_table == "holding":
            blocks.append(("setpoint_register", self.setpoint_register, self.setpoint_kind))
        for name, first, kind in blocks:
            for address in range(first, first + (2 if kind.endswith("32") else 1)):
                if address in taken:
                    raise ValueError(f"{name} and {taken[address]} both use register {address}")
                taken[address] = name
        return self


class _ModbusDevice(Section):
    driver: str = "sim"
    modbus: ModbusConfig | None = None
    poll_s: Positive = 0.05
    stale_after_s: Positive = 1.0

    @model_validator(mode="after")
    def _needs_modbus(self) -> "_ModbusDevice":
        if self.driver == "modbus" and self.modbus is None:
            raise ValueError('driver = "modbus" needs a table [brake.modbus] or [drive.modbus]')
        return self


class BrakeConfig(_ModbusDevice):
    """`[brake]`: eddy-current brake, T = excitation^2 2 Tmax / (w/wc + wc/w)."""

    torque_max_Nm: Positive = 20.0
    critical_speed_rad_s: Positive = 20.0
    excitation_time_constant_s: NonNegative = 0.2
    temperature_max_C: Finite = 150.0


class DriveConfig(_ModbusDevice):
    """`[drive]`: the external motor that turns the rotor through a belt."""

    speed_max_rad_s: Positive = 15.0


class LimitsConfig(Section):
    """`[limits]`: what the loop never exceeds (references) and what it trips at."""

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
    encoder_jump_rad: Positive = 0.15

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


def _loopback_only(endpoints: tuple[str, ...]) -> tuple[str, ...]:
    pattern = r"tcp/(127\.\d+\.\d+\.\d+|\[::1\]|localhost):\d{1,5}"
    if not endpoints or not all(re.fullmatch(pattern, endpoint) for endpoint in endpoints):
        raise ValueError(
            "whoever reaches the daemon may command it, so it listens on TCP ports of this "
            f'machine alone, such as "tcp/127.0.0.1:7447"; got {", ".join(endpoints) or "none"}'
        )
    return endpoints


Loopback = Annotated[tuple[str, ...], AfterValidator(_loopback_only)]
"""Zenoh endpoints that only this machine can reach, at least one."""


class RecordingConfig(Section):
    """`[recording]`: where runs go and how they are written."""

    directory: Path = Path("runs")
    auto: bool = True
    chunk_s: Annotated[float, Field(ge=0.01, le=10)] = 0.25
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    sync_s: Annotated[float, Field(ge=0.1, le=60)] = 1.0
    file_max_s: Positive = 3600.0
    file_max_MB: Positive = 4096.0
    free_min_MB: NonNegative = 500.0


class ZenohConfig(Section):
    """`[zenoh]`: endpoints and telemetry rate. Nothing beyond this machine may be listened on."""

    listen: Loopback = ("tcp/127.0.0.1:7447",)
    tick_rate_Hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    block_s: Annotated[float, Field(ge=0.01, le=1)] = 0.1
    lease_s: Annotated[float, Field(ge=0.2, le=60)] = 2.0


class MeshConfig(Section):
    """`[plans.calibrate]`, `[plans.verify]`: the operating points and how each is taken."""

    torques_Nm: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.0, 2.0, 3.0, 4.0, 5.0)
    speeds_Hz: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    settle_s: NonNegative = 2.0
    settle_timeout_s: Positive = 30.0
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02


class PlansConfig(Section):
    """`[plans.*]`: defaults of each experiment."""

    calibrate: MeshConfig = MeshConfig()
    verify: MeshConfig = MeshConfig()


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
    plans: PlansConfig = PlansConfig()

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
    def _bus_voltage_is_watched(self) -> "Config":
        can = self.inverter.can
        if self.inverter.driver == "can" and can and not can.signals.feedback_u_bus_V:
            raise ValueError(
                "[inverter.can.signals] has no feedback_u_bus_V: the interlock of the bus voltage "
                "needs it"
            )
        return self

    @property
    def simulated(self) -> bool:
        """True if the rig runs inside the loop process instead of on a wire."""
        return self.inverter.driver == "sim"


class MotorFile(Section):
    """A file with the motor and, if wanted, the torque sensor of recordings made elsewhere."""

    motor: MotorConfig
    torque_sensor: TorqueSensorConfig = TorqueSensorConfig()


def packaged(name: str) -> Path:
    """Return the path of a data file that ships with motord."""
    return Path(str(resources.files("motord") / "data" / name))


def load(path: Path | None = None) -> Config:
    """Read and check a bench file; None is the packaged simulated bench. Raises ConfigError."""
    return _load(path or packaged("sim.toml"), Config)


def load_motor(path: Path) -> MotorFile:
    """Read and check a motor file. Raises ConfigError."""
    return _load(path, MotorFile)


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Return text and content of a TOML file. Raises ConfigError for one that cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot read it: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not a text file in UTF-8 (byte {error.start})") from error
    try:
        return text, tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def resolve(base: Path, file: Path) -> Path:
    """Return `file` as seen from the folder of `base`; `package:NAME` is one that motord ships."""
    name = str(file)
    if name.startswith("package:"):
        return packaged(name.removeprefix("package:"))
    return file if file.is_absolute() else base.parent / file


_Model = TypeVar("_Model", bound=Section)


def validate(model: type[_Model], path: Path, text: str, data: dict[str, Any]) -> _Model:
    """Build `model` from the content of a TOML file. Raises ConfigError naming file and line."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise ConfigError(_explain(error, model, path, text)) from None


def _load(path: Path, model: type[_Model]) -> _Model:
    text, data = read_toml(path)
    _resolve_files(path, data)
    return validate(model, path, text, data)


def _resolve_files(path: Path, data: dict[str, Any]) -> None:
    """Make the file names of a bench absolute: they are relative to the bench file."""
    for keys in (("bench", "rig"), ("inverter", "can", "dbc"), ("motor", "back_emf")):
        table: Any = data
        for key in keys[:-1]:
            table = table.get(key) if isinstance(table, dict) else None
        if isinstance(table, dict) and isinstance(table.get(keys[-1]), str):
            table[keys[-1]] = resolve(path, Path(table[keys[-1]]))


def _explain(error: ValidationError, model: type[Section], path: Path, text: str) -> str:
    lines = []
    for item in error.errors(include_url=False):
        keys = [str(k) for k in item["loc"] if not str(k)[:1].isupper()]
        where = f"{path}:{_line_of(text, keys)}" if _line_of(text, keys) else str(path)
        what = item["msg"].removeprefix("Value error, ")
        if item["type"] == "extra_forbidden":
            what = "unknown key" + _suggestion(model, keys)
        elif item["type"] == "missing":
            what = "missing"
        elif not isinstance(item.get("input"), dict | list):
            what = f"{what[0].lower()}{what[1:]}, got {item['input']!r}"
        lines.append(f"{where}: {_dotted(keys)}: {what}" if keys else f"{where}: {what}")
    return "; ".join(dict.fromkeys(lines))


def _dotted(keys: list[str]) -> str:
    dotted = ""
    for key in keys:
        dotted += f"[{key}]" if key.isdigit() else f".{key}" if dotted else key
    return dotted


def _suggestion(model: type[BaseModel], keys: list[str]) -> str:
    known: type[BaseModel] = model
    for key in keys[:-1]:
        field = known.model_fields.get(key)
        if field is None or not isinstance(field.annotation, type):
            return ""
        if not issubclass(field.annotation, BaseModel):
            return ""
        known = field.annotation
    near = difflib.get_close_matches(keys[-1], list(known.model_fields), 1, 0.5)
    return f"; did you mean {near[0]}?" if near else f"; known: {', '.join(known.model_fields)}"


def _line_of(text: str, keys: list[str]) -> int:
    """Return the line that defines `keys`, or of the deepest part found, or 0."""
    names = [k for k in keys if not k.isdigit()]
    table: list[str] = []
    best, best_depth = 0, 0
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith("["):
            table = stripped.strip("[] ").split(".")
            path = table
        else:
            path = [*table, *stripped.split("=")[0].strip().split(".")]
        depth = len(path) if path == names[: len(path)] else 0
        if depth > best_depth:
            best, best_depth = number, depth
    return best


def _read_back_emf_table(path: Path, counts: int) -> np.ndarray:
    """Read a table that `analyse back-emf` wrote: JSON with k_V_s_per_rad, shape (counts, 3)."""
    import json

    try:
        table = np.asarray(json.loads(path.read_text())["k_V_s_per_rad"], dtype=float)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: not a back-EMF table: {error}") from error
    if table.shape != (counts, 3) or not np.isfinite(table).all():
        raise ConfigError(f"{path}: back-EMF table is {table.shape}, expected ({counts}, 3)")
    return table
