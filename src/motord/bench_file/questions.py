"""What is asked for a new bench file, in this order; each question is about one key of it.

The command line makes an option of each, so that nothing heavy is imported here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from motord.bench_file.templates import Tables

BACK_EMF = "motor.back_emf"


@dataclass(frozen=True)
class Question:
    """What is asked for a key. applies: whether a bench with these tables is asked for it.

    choices: the values that there are to choose from, none for a number or a text.
    """

    key: str
    prompt: str
    applies: Callable[[Tables], bool]
    choices: tuple[str, ...] = ()

    @property
    def option(self) -> str:
        """Return the option of the command line that answers it."""
        return "--" + self.key.replace(".", "-").replace("_", "-")


def get(tables: Tables, key: str) -> Any:
    """Return the value of a key, None if it is not there."""
    *names, last = key.split(".")
    for name in names:
        tables = tables.get(name) or {}
    return tables.get(last)


def _always(tables: Tables) -> bool:
    return True


def is_real(tables: Tables) -> bool:
    """Return whether these tables are of a bench of hardware, not simulated or emulated."""
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
        Question(f"{wire}.transport", f"{name}: Modbus over", _modbus(device), ("rtu", "tcp")),
        Question(f"{wire}.serial_port", f"{name}: serial port", _modbus(device, "rtu")),
        Question(f"{wire}.baud", f"{name}: baud", _modbus(device, "rtu")),
        Question(f"{wire}.parity", f"{name}: parity", _modbus(device, "rtu"), ("N", "E", "O")),
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
    Question("motor.connection", "Motor: windings", is_real, ("star", "independent")),
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
    Question("brake.driver", "Brake", is_real, choices=("modbus", "none")),
    Question("brake.torque_max_Nm", "Brake: largest torque (Nm)", _where("brake.driver", "modbus")),
    Question("brake.critical_speed_rad_s", "Brake: speed of its largest torque (rad/s)",
             _where("brake.driver", "modbus")),
    *_modbus_questions("brake", "Brake"),
    Question("drive.driver", "External drive, which turns the rotor", is_real,
             choices=("modbus", "none")),
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
