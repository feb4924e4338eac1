"""The bench file: TOML into validated, frozen models; every number carries its unit in its name.

`load(path)` reads a bench, `load_motor(path)` a file with `[motor]` and perhaps `[torque_sensor]`.
Whatever is wrong comes as one `ConfigError` naming file, line, key, what is wrong and what would
be right; unknown keys are errors.
"""

from motord.config.back_emf import BackEmfHarmonic, BackEmfTable
from motord.config.base import (
    ConfigError,
    Finite,
    Fraction,
    NonNegative,
    Positive,
    Section,
)
from motord.config.bench import (
    BenchConfig,
    Config,
    LimitsConfig,
    LoopConfig,
    RecordingConfig,
    ZenohConfig,
)
from motord.config.devices import (
    BrakeConfig,
    BridgeConfig,
    CanConfig,
    CanSignalMap,
    DriveConfig,
    InverterConfig,
    ModbusConfig,
    RegisterKind,
)
from motord.config.inertia import (
    AccelerationConfig,
    EffectiveMass,
    OscillationConfig,
    SpringConfig,
)
from motord.config.motor import MotorConfig, MotorFile, TorqueSensorConfig
from motord.config.plans import (
    CalibrateConfig,
    DrivenConfig,
    LearnConfig,
    MeshConfig,
    PlansConfig,
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

__all__ = [
    "AccelerationConfig",
    "BackEmfHarmonic",
    "BackEmfTable",
    "BenchConfig",
    "BrakeConfig",
    "BridgeConfig",
    "CalibrateConfig",
    "CanConfig",
    "CanSignalMap",
    "Config",
    "ConfigError",
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
    "PlansConfig",
    "Positive",
    "RecordingConfig",
    "RegisterKind",
    "Section",
    "SensitivityConfig",
    "SpringConfig",
    "TorqueSensorConfig",
    "ZenohConfig",
    "load",
    "load_motor",
    "packaged",
    "read_toml",
    "resolve",
    "validate",
]
