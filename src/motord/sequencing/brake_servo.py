"""The brake as a slow actuator of speed: feed-forward from its curve, integral correction."""

import math
from dataclasses import dataclass

from motord.config import BrakeConfig

GAIN_PER_S = 1.2
"""Relative change of the squared excitation per second for a relative speed error of one."""
SHIFT_MAX = 8.0
"""Largest factor by which the servo may depart from the configured curve, either way."""
TRUST_ERROR = 0.1
TRUST_S = 0.5
"""What holds the speed within TRUST_ERROR of the wanted one for TRUST_S is learned of the brake."""
LEAD_TIME_CONSTANTS = 4.0
"""How long a rising brake leads a rising torque, in time constants of its excitation."""

RELEASE_TIME_CONSTANTS = 6.0
"""How long the brake needs to let go, in time constants of its excitation."""


def release_s(brake: BrakeConfig) -> float:
    """Return how long the brake needs to let go (s)."""
    return RELEASE_TIME_CONSTANTS * brake.excitation_time_constant_s


def brake_torque_Nm(brake: BrakeConfig, excitation: float, speed_rad_s: float) -> float:
    """Return the eddy-current brake's torque: e^2 2 Tmax / (w/wc + wc/w) (METHODS, section 1)."""
    if speed_rad_s == 0.0:
        return 0.0
    ratio = speed_rad_s / brake.critical_speed_rad_s
    return excitation**2 * brake.torque_max_Nm * 2 * ratio / (1 + ratio * ratio)


def speed_held_rad_s(brake: BrakeConfig, excitation: float, torque_Nm: float) -> float:
    """Return the speed at which the brake balances `torque_Nm`, of its sign.

    The one below the critical speed, which is stable; the critical speed itself for a torque that
    the brake does not hold.
    """
    half = torque_Nm / (2 * excitation**2 * brake.torque_max_Nm)
    ratio = 2 * half / (1 + math.sqrt(max(1 - 4 * half * half, 0.0)))
    return max(min(ratio, 1.0), -1.0) * brake.critical_speed_rad_s


def excitation_for(brake: BrakeConfig, torque_Nm: float, speed_rad_s: float) -> float:
    """Return the excitation (0 to 1) that balances `torque_Nm` at `speed_rad_s`."""
    full_Nm = abs(brake_torque_Nm(brake, 1.0, speed_rad_s))
    return min(math.sqrt(abs(torque_Nm) / full_Nm), 1.0) if full_Nm > 0 else 1.0


@dataclass
class BrakeServo:
    """Holds a speed by the brake. The state is the log of the departure from the configured curve.

    A speed far from the wanted one may be no more than an encoder that has lost the rotor, so a
    departure found meanwhile is not learned.
    """

    brake: BrakeConfig
    shift: float = 0.0
    _t_ns: int | None = None
    _learned: float = 0.0
    _on_speed_s: float = 0.0

    def start(self, t_ns: int) -> None:
        """Begin to integrate at `t_ns`, from what was learned of the brake."""
        self._t_ns = t_ns
        self.drop_unproven()

    def drop_unproven(self) -> None:
        """Go back to what was learned of the brake while the speed was right."""
        self.shift, self._on_speed_s = self._learned, 0.0

    def lead_s(self, before: float, after: float) -> float:
        """Return how long the brake must lead the torque if its excitation changes so (s)."""
        rises = after > before + 0.01
        return LEAD_TIME_CONSTANTS * self.brake.excitation_time_constant_s if rises else 0.0

    def excitation(self, torque_Nm: float, speed_Hz: float) -> float:
        """Return the excitation for a torque and speed with what is known of the brake."""
        configured = excitation_for(self.brake, torque_Nm, 2 * math.pi * speed_Hz)
        return min(configured * math.exp(0.5 * self.shift), 1.0)

    def correct(self, t_ns: int, speed_Hz: float, wanted_Hz: float) -> None:
        """Move towards more brake if `speed_Hz` is above `wanted_Hz`, towards less if below."""
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns
        dt_s = min(max(dt_s, 0.0), 0.5)
        error = max(min(speed_Hz / wanted_Hz - 1.0, 1.0), -1.0)
        limit = math.log(SHIFT_MAX)
        self.shift = max(min(self.shift + GAIN_PER_S * error * dt_s, limit), -limit)
        self._on_speed_s = self._on_speed_s + dt_s if abs(error) <= TRUST_ERROR else 0.0
        if self._on_speed_s >= TRUST_S:
            self._learned = self.shift
