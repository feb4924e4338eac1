"""The bench file: TOML into validated, frozen models; every number carries its unit in its name.

`load(path)` reads a bench, `load_motor(path)` a file with `[motor]` and perhaps `[torque_sensor]`.
Whatever is wrong comes as one `ConfigError` naming file, line, key, what is wrong and what would
be right; unknown keys are errors.
"""

from motord.config.back_emf import BackEmfHarmonic
from motord.config.base import ConfigError, Finite, NonNegative, Positive, Section
from motord.config.bench import Config
from motord.config.can_signals import CanSignalMap, DqConfig
from motord.config.devices import BrakeConfig, CanBusConfig, CanConfig, ModbusConfig
from motord.config.inertia import AccelerationConfig, OscillationConfig
from motord.config.motor import SEQUENCE, MotorConfig, MotorFile, PhaseOrder, TorqueSensorConfig
from motord.config.plans import DrivenConfig, MeshConfig
from motord.config.reading import load, packaged, read_toml
from motord.config.sections import LoopConfig, RecordingConfig

__all__ = [
    "SEQUENCE",
    "AccelerationConfig",
    "BackEmfHarmonic",
    "BrakeConfig",
    "CanBusConfig",
    "CanConfig",
    "CanSignalMap",
    "Config",
    "ConfigError",
    "DqConfig",
    "DrivenConfig",
    "Finite",
    "LoopConfig",
    "MeshConfig",
    "ModbusConfig",
    "MotorConfig",
    "MotorFile",
    "NonNegative",
    "OscillationConfig",
    "PhaseOrder",
    "Positive",
    "RecordingConfig",
    "Section",
    "TorqueSensorConfig",
    "load",
    "packaged",
    "read_toml",
]
