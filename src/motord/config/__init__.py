"""The bench file: TOML into validated, frozen models; every number carries its unit in its name.

`load(path)` reads a bench, `reading.load_motor(path)` a file with `[motor]` and `[torque_sensor]`.
Whatever is wrong comes as one `ConfigError` naming file, line, key, what is wrong and what would
be right; unknown keys are errors.
"""

from motord.config.base import ConfigError as ConfigError
from motord.config.base import Finite as Finite
from motord.config.base import Fraction as Fraction
from motord.config.base import NonNegative as NonNegative
from motord.config.base import Positive as Positive
from motord.config.base import Section as Section
from motord.config.bench import Config as Config
from motord.config.channels import ChannelConfig as ChannelConfig
from motord.config.devices import BridgeCanConfig as BridgeCanConfig
from motord.config.devices import BridgeConfig as BridgeConfig
from motord.config.devices import CanBusConfig as CanBusConfig
from motord.config.devices import CanConfig as CanConfig
from motord.config.devices import InverterConfig as InverterConfig
from motord.config.devices.can_signals import CanopenConfig as CanopenConfig
from motord.config.devices.can_signals import CanSignalMap as CanSignalMap
from motord.config.devices.can_signals import DqConfig as DqConfig
from motord.config.devices.slow_devices import BrakeConfig as BrakeConfig
from motord.config.devices.slow_devices import ModbusConfig as ModbusConfig
from motord.config.devices.slow_devices import ModbusLinkConfig as ModbusLinkConfig
from motord.config.motor import SEQUENCE as SEQUENCE
from motord.config.motor import MotorConfig as MotorConfig
from motord.config.motor import MotorFile as MotorFile
from motord.config.motor import PhaseOrder as PhaseOrder
from motord.config.motor import TorqueSensorConfig as TorqueSensorConfig
from motord.config.motor.accuracy import AccuracyConfig as AccuracyConfig
from motord.config.motor.back_emf import BackEmfHarmonic as BackEmfHarmonic
from motord.config.named_files import keep as keep
from motord.config.named_files import packaged as packaged
from motord.config.named_files import resolve as resolve
from motord.config.plans import DrivenConfig as DrivenConfig
from motord.config.plans import MeshConfig as MeshConfig
from motord.config.plans.inertia import AccelerationConfig as AccelerationConfig
from motord.config.plans.inertia import OscillationConfig as OscillationConfig
from motord.config.reading import load as load
from motord.config.reading import load_started as load_started
from motord.config.reading import read_toml as read_toml
from motord.config.sections import LimitsConfig as LimitsConfig
from motord.config.sections import LoopConfig as LoopConfig
from motord.config.sections import RecordingConfig as RecordingConfig
