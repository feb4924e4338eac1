"""The calibration file: gains and offsets of a motor's currents, and its cogging torque."""

from motord.calibration.file import Calibration as Calibration
from motord.calibration.file import CalibrationError as CalibrationError
from motord.calibration.file import format_duration as format_duration
from motord.calibration.file import from_json as from_json
from motord.calibration.file import load as load
from motord.calibration.parts import AddedOrder as AddedOrder
from motord.calibration.parts import BoundedQuantity as BoundedQuantity
from motord.calibration.parts import CalibratedMotor as CalibratedMotor
from motord.calibration.parts import CramerRao as CramerRao
from motord.calibration.parts import DegreesOfFreedom as DegreesOfFreedom
from motord.calibration.parts import Harmonic as Harmonic
from motord.calibration.parts import RmsErrors as RmsErrors
from motord.calibration.parts import RmsPoint as RmsPoint
from motord.calibration.parts import TorqueSpeed as TorqueSpeed
from motord.calibration.parts import VarianceShare as VarianceShare
from motord.calibration.parts import by_magnitude as by_magnitude
from motord.calibration.parts import half_widths as half_widths
from motord.calibration.parts import magnitudes_differ as magnitudes_differ
