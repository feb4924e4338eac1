"""The bench file: TOML into validated, frozen models; every number carries its unit in its name.

`load(path)` reads a bench, `load_motor(path)` a file with `[motor]` and perhaps `[torque_sensor]`.
Whatever is wrong comes as one `ConfigError` naming file, line, key, what is wrong and what would
be right; unknown keys are errors.
"""

from motord.config.accuracy import AccuracyConfig
from motord.config.back_emf import BackEmfHarmonic, BackEmfTable
from motord.config.base import (
    ConfigError,
    Finite,
    Fraction,
    NonNegative,
    Positive,
    Section,
)
from motord.config.bench import Config
from motord.config.can_signals import CanSignalMap, DqConfig
from motord.config.devices import (
    BridgeCanConfig,
    BridgeConfig,
    CanBusConfig,
    CanConfig,
    InverterConfig,
)
from motord.config.experiments import PlansConfig
from motord.config.inertia import (
    AccelerationConfig,
    EffectiveMass,
    OscillationConfig,
    SpringConfig,
)
from motord.config.motor import (
    SEQUENCE,
    MotorConfig,
    MotorFile,
    PhaseOrder,
    TorqueSensorConfig,
    back_emf_waves,
)
from motord.config.plans import (
    AlignConfig,
    CalibrateConfig,
    DrivenConfig,
    LearnConfig,
    MeshConfig,
    SensitivityConfig,
)
from motord.config.reading import (
    load,
    load_motor,
    packaged,
    read_toml,
    resolve,
    validate,
)
from motord.config.sections import (
    BenchConfig,
    LimitsConfig,
    LoopConfig,
    RecordingConfig,
    TlsConfig,
    ZenohConfig,
)
from motord.config.slow_devices import BrakeConfig, DriveConfig, ModbusConfig, RegisterKind

__all__ = [
    "SEQUENCE",
    "AccelerationConfig",
    "AccuracyConfig",
    "AlignConfig",
    "BackEmfHarmonic",
    "BackEmfTable",
    "BenchConfig",
    "BrakeConfig",
    "BridgeCanConfig",
    "BridgeConfig",
    "CalibrateConfig",
    "CanBusConfig",
    "CanConfig",
    "CanSignalMap",
    "Config",
    "ConfigError",
    "DqConfig",
    "DriveConfig",
    "DrivenConfig",
    "EffectiveMass",
    "Finite",
    "Fraction",
    "InverterConfig",
    "LearnConfig",
    "LimitsConfig",
    "LoopConfig",
    "MeshConfig",
    "ModbusConfig",
    "MotorConfig",
    "MotorFile",
    "NonNegative",
    "OscillationConfig",
    "PhaseOrder",
    "PlansConfig",
    "Positive",
    "RecordingConfig",
    "RegisterKind",
    "Section",
    "SensitivityConfig",
    "SpringConfig",
    "TlsConfig",
    "TorqueSensorConfig",
    "ZenohConfig",
    "back_emf_waves",
    "load",
    "load_motor",
    "packaged",
    "read_toml",
    "resolve",
    "validate",
]
