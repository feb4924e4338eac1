"""What is asked for a new bench file, in this order; each question is about one key of it."""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import TypeAdapter, ValidationError

from motord.bench_file.templates import Tables
from motord.config import ConfigError
from motord.config.base import what_is_wrong
from motord.config.descriptions import field_of

BACK_EMF = "motor.back_emf"


@dataclass(frozen=True)
class Question:
    """A key, in words. applies: whether a bench with these tables is asked for it.

    only: the values that there are to choose from, if not those of the key's type.
    """

    key: str
    words: str
    applies: Callable[[Tables], bool]
    only: tuple[str, ...] = ()

    @property
    def option(self) -> str:
        """Return the option of the command line that answers it."""
        return "--" + self.key.replace(".", "-").replace("_", "-")

    @property
    def choices(self) -> tuple[str, ...]:
        """Return the values to choose from, none for a number or a text."""
        values = () if self.key == BACK_EMF else get_args(field_of(self.key).annotation)
        literal = all(isinstance(value, str | int) for value in values)
        return self.only or (tuple(map(str, values)) if literal else ())

    def parse(self, text: str) -> Any:
        """Return an answer as a value of the bench file. Raises ConfigError."""
        if self.key == BACK_EMF:
            return _back_emf(text)
        if self.choices and text not in self.choices:
            raise ConfigError(f"one of {', '.join(self.choices)}, not {text!r}")
        value = text if _takes_text(self.key) else _value(text)
        try:
            strict = field_of(self.key).annotation in (int, float)  # a bool is no number
            checked = _adapter(self.key).validate_python(value, strict=strict)
        except ValidationError as error:
            raise ConfigError(f"{'; '.join(what_is_wrong(error))}, not {text!r}") from None
        return value if isinstance(checked, Path) else checked


def get(tables: Tables, key: str) -> Any:
    """Return the value of a key, None if it is not there."""
    *names, last = key.split(".")
    for name in names:
        tables = tables.get(name) or {}
    return tables.get(last)


def _always(tables: Tables) -> bool:
    return True


def is_real(tables: Tables) -> bool:
    """Return whether the devices of these tables are made of metal."""
    return "rig" not in tables["bench"]


def _where(key: str, *values: str) -> Callable[[Tables], bool]:
    """Of a real bench in which a key has one of these values."""
    return lambda tables: is_real(tables) and get(tables, key) in values


def _modbus(device: str, *transports: str) -> Callable[[Tables], bool]:
    on_modbus = _where(f"{device}.driver", "modbus")
    return lambda tables: (
        on_modbus(tables)
        and (not transports or get(tables, f"{device}.modbus.transport") in transports)
    )


def _modbus_questions(device: str, name: str) -> tuple[Question, ...]:
    wire = f"{device}.modbus"
    return (
        Question(f"{wire}.transport", f"{name}: Modbus over", _modbus(device)),
        Question(f"{wire}.serial_port", f"{name}: serial port", _modbus(device, "rtu")),
        Question(f"{wire}.baud", f"{name}: baud", _modbus(device, "rtu")),
        Question(f"{wire}.parity", f"{name}: parity", _modbus(device, "rtu")),
        Question(f"{wire}.host", f"{name}: address", _modbus(device, "tcp")),
        Question(f"{wire}.tcp_port", f"{name}: TCP port", _modbus(device, "tcp")),
        Question(f"{wire}.unit", f"{name}: Modbus unit", _modbus(device)),
    )


QUESTIONS = (
    Question("bench.name", "Name of the bench, part of every key and recording", _always),
    Question("loop.rate_Hz", "Rate of the control loop (Hz)", _always),
    Question("motor.name", "Motor: name", is_real),
    Question("motor.serial", "Motor: serial number", is_real),
    Question("motor.pole_pairs", "Motor: pole pairs", is_real),
    Question("motor.slots", "Motor: slots", is_real),
    Question("motor.connection", "Motor: windings", is_real),
    Question("motor.rated_torque_Nm", "Motor: rated torque (Nm)", is_real),
    Question(
        BACK_EMF,
        "Motor: back-EMF of a phase, amplitude (V s/rad, mechanical), or a file of "
        "`motord analyse back-emf`",
        is_real,
    ),
    Question("motor.counts", "Encoder: counts in a turn", is_real),
    Question("inverter.can.interface", "Inverter: CAN interface of python-can", is_real),
    Question("inverter.can.channel", "Inverter: CAN channel", is_real),
    Question("inverter.can.dbc", "Inverter: its DBC file", is_real),
    Question("bridge.port", "Bridge board: serial port", _where("bridge.driver", "serial")),
    Question("bridge.can.interface", "Bridge board: CAN interface of python-can",
             _where("bridge.driver", "can")),
    Question("bridge.can.channel", "Bridge board: CAN channel", _where("bridge.driver", "can")),
    Question("torque_sensor.highpass_time_constant_s",
             "Torque sensor: time constant of its high-pass (s); piezo 0.1 to 10, "
             "0 if it passes the mean", is_real),
    Question("torque_sensor.gain_Nm_per_V", "Torque sensor: gain (Nm/V)", is_real),
    Question("torque_sensor.resonance_Hz",
             "Torque sensor: resonance with what is mounted on it (Hz), 0 if above all of interest",
             is_real),
    Question("brake.driver", "Brake", is_real, only=("modbus", "none")),
    Question("brake.torque_max_Nm", "Brake: largest torque (Nm)", _where("brake.driver", "modbus")),
    Question("brake.critical_speed_rad_s", "Brake: speed of its largest torque (rad/s)",
             _where("brake.driver", "modbus")),
    *_modbus_questions("brake", "Brake"),
    Question("drive.driver", "External drive, which turns the rotor", is_real,
             only=("modbus", "none")),
    Question("drive.speed_max_rad_s", "External drive: highest speed (rad/s)",
             _where("drive.driver", "modbus")),
    *_modbus_questions("drive", "External drive"),
    Question("drive.modbus.watchdog_s", "External drive: its communication timeout (s)",
             _modbus("drive")),
    Question("limits.torque_Nm", "Limit: torque (Nm), small to begin with", is_real),
    Question("limits.current_A", "Limit: phase current (A)", is_real),
    Question("limits.trip_speed_rad_s", "Limit: speed (rad/s), beyond which it trips", is_real),
    Question("limits.bus_V_min", "Limit: lowest DC bus voltage (V)", is_real),
    Question("limits.bus_V_max", "Limit: highest DC bus voltage (V)", is_real),
)  # fmt: skip


@cache
def _adapter(key: str) -> TypeAdapter[Any]:
    field = field_of(key)
    kind: Any = Annotated[field.annotation, field]
    return TypeAdapter(kind)


def _takes_text(key: str) -> bool:
    kinds = {field_of(key).annotation, *map(type, get_args(field_of(key).annotation))}
    return bool(kinds & {str, Path})


def _value(text: str) -> Any:
    """Return a number or a bool as TOML has it, anything else as text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _back_emf(text: str) -> Any:
    """Return one harmonic with this amplitude, or the name of a file with a table."""
    value = _value(text)
    if isinstance(value, int | float) and not isinstance(value, bool):
        if not 0 < value < math.inf:
            raise ConfigError(f"an amplitude above 0, not {text!r}")
        return [{"order": 1, "amplitude_V_s_per_rad": float(value), "phase_rad": 0.0}]
    if not text:
        raise ConfigError("a number, or a file that `motord analyse back-emf -o` wrote")
    return text
