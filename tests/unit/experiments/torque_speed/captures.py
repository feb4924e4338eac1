"""Captures of a motor whose powers are known, as ticks and as readings of the electrical power."""

from dataclasses import dataclass

import numpy as np

from motord.config import AccuracyConfig, MotorConfig, load
from motord.experiments.torque_speed.power_series import PowerSeries
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.identification.operating_points import PointData

MOTOR: MotorConfig = load().motor
RATE_HZ = 1000
EPOCH_NS = 1_767_225_600_000_000_000
ACCURACY = AccuracyConfig(
    torque_gain_percent=0.2, torque_zero_Nm=0.005, power_gain_percent=0.2, power_zero_W=0.05
)
DTYPE = [("t_ns", "i8"), ("encoder_count", "i4"), ("torque_Nm", "f8"), ("u_bus_V", "f8")]


@dataclass(frozen=True)
class Machine:
    """Torque and speed with ripple of an order per turn; losses; noise of the torque sensor."""

    torque_Nm: float = 3.0
    speed_Hz: float = 4.0
    ripple_Nm: float = 0.3
    ripple_order: int = 6
    speed_ripple: float = 0.01
    loss_W: float = 20.0
    noise_Nm: float = 0.02
    seconds_s: float = 12.0
    loss_rate_W_per_s: float = 0.0

    def path(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return time (s), angle (rad), torque (Nm) and electrical energy (J), finely."""
        t_s = np.arange(0, self.seconds_s, 1 / RATE_HZ)
        mean_rad = 2 * np.pi * self.speed_Hz * t_s
        turned = self.ripple_order * mean_rad
        angle_rad = mean_rad + self.speed_ripple / self.ripple_order * np.sin(turned)
        speed_rad_s = 2 * np.pi * self.speed_Hz * (1 + self.speed_ripple * np.cos(turned))
        torque_Nm = self.torque_Nm + self.ripple_Nm * np.cos(turned)
        power_W = torque_Nm * speed_rad_s + self.loss_W + self.loss_rate_W_per_s * t_s
        energy_J = np.concatenate([[0.0], np.cumsum(0.5 * (power_W[1:] + power_W[:-1]) / RATE_HZ)])
        return t_s, angle_rad, torque_Nm, energy_J

    def mechanical_W(self) -> float:
        """Return the mean over whole turns; ripples of torque and speed are in phase."""
        ripple_Nm = 0.5 * self.ripple_Nm * self.speed_ripple
        return 2 * np.pi * self.speed_Hz * (self.torque_Nm + ripple_Nm)

    def captured(
        self, rng: np.random.Generator, gain: float = 1.0, zero_Nm: float = 0.0
    ) -> PointData:
        """Return the ticks, with an error of the torque sensor."""
        t_s, angle_rad, torque_Nm, _ = self.path()
        ticks = np.zeros(t_s.size, DTYPE)
        ticks["t_ns"] = EPOCH_NS + np.round(t_s * 1e9).astype(np.int64)
        ticks["encoder_count"] = np.floor(angle_rad / (2 * np.pi) * MOTOR.counts) % MOTOR.counts
        noise_Nm = self.noise_Nm * rng.standard_normal(t_s.size)
        ticks["torque_Nm"] = gain * torque_Nm + zero_Nm + noise_Nm
        ticks["u_bus_V"] = 24.0
        return PointData(self.torque_Nm, self.speed_Hz, ticks)

    def turns(
        self, rng: np.random.Generator, gain: float = 1.0, zero_Nm: float = 0.0
    ) -> CapturedTurns:
        """Return the turns of the capture."""
        return CapturedTurns.of(self.captured(rng, gain, zero_Nm), MOTOR)

    def readings(
        self, rng: np.random.Generator, every_s: float, means: bool = True, noise_W: float = 0.0
    ) -> PowerSeries:
        """Return readings at a random phase, each up to half a period away from its time."""
        t_s, _, _, energy_J = self.path()
        at_s = np.arange(rng.uniform(1, 2) * every_s, self.seconds_s - 2 * every_s, every_s)
        if means:
            power_W = np.diff(np.interp(at_s, t_s, energy_J), prepend=np.nan) / every_s
        else:
            power_W = np.interp(at_s, t_s, np.gradient(energy_J, t_s))
        power_W = (power_W + noise_W * rng.standard_normal(at_s.size))[1:]
        return PowerSeries(at_s[1:] + rng.uniform(-0.5, 0.5) * every_s, power_W, means)
