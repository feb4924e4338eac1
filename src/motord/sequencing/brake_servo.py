"""The brake as a slow actuator of speed: feed-forward from its curve, integral correction.

The integral acts on the error of torque that an error of speed stands for, by the slope of the
brake's curve: towards the critical speed, where the curve is flat, a little excitation moves the
speed a lot. It waits while the torque ramps: a rotor that is on its way is no departure from the
curve. A speed is approached from below, with a reserve of torque: a rotor beyond the critical speed
runs away from a brake whose torque falls with the speed.

The gain is also scheduled by the rotor: J dw/dt = T - T_brake(w) is a lag of J w / (T slope), long
for a heavy rotor at little torque, in which an integral of the usual gain winds up. J is taken from
the impulse that each approach needed.
"""

import math
from dataclasses import dataclass

from motord.config import BrakeConfig
from motord.sequencing.observation import Observation

GAIN_PER_S = 2.0
"""Relative change of the squared excitation per second for a relative torque error of one."""
CROSSOVER = 0.4
"""The largest gain, in parts of the excitation's corner frequency (rad/s)."""
ROTOR_CROSSOVER = 0.5
"""The largest gain, in parts of T / (J w), the rotor's corner frequency where the slope is 1:
damping of 0.7 there, and more towards the critical speed."""
APPROACH_PART = 0.25
"""Part of the wanted speed that a rotor has gained when its inertia is taken from it."""
STANDS_PER_S = 0.1
"""Part of the wanted speed, a second, below which a rotor is not on its way."""
SLOPE_MIN = 0.1
"""The least slope of the curve at which a speed is held: below 0.9 of the critical speed."""
RESERVE = 1.25
"""A speed is approached with an excitation that could hold this much more than the torque."""
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


def slope(brake: BrakeConfig, speed_rad_s: float) -> float:
    """Return d ln(torque) / d ln(speed) of the brake: 1 at rest, 0 at the critical speed."""
    squared = (speed_rad_s / brake.critical_speed_rad_s) ** 2
    return (1 - squared) / (1 + squared)


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
    _set_Nm: float | None = None
    _excitation: float = 0.0
    _inertia_kg_m2: float = 0.0
    _inertia_estimated: bool = False
    _on_its_way: bool = False
    _before_rad_s: float = 0.0
    _gained_rad_s: float = 0.0
    _impulse_Nm_s: float = 0.0

    def start(self, speed_Hz: float = 0.0) -> None:
        """Begin to integrate anew, from what was learned of the brake while the speed was right.

        With the RESERVE for an approach to `speed_Hz`: none where the curve itself leaves so much.
        """
        part = abs(brake_torque_Nm(self.brake, 1.0, 2 * math.pi * speed_Hz))
        reserve = math.log(max(RESERVE * part / self.brake.torque_max_Nm, 1.0))
        self.shift, self._on_speed_s = self._learned + reserve, 0.0
        self._t_ns = self._set_Nm = None
        self._inertia_estimated = self._on_its_way = False
        self._gained_rad_s = self._impulse_Nm_s = 0.0

    @property
    def on_speed(self) -> bool:
        """Whether the newest speed was within TRUST_ERROR of the wanted one."""
        return self._on_speed_s > 0.0

    def lead_s(self, before: float, after: float) -> float:
        """Return how long the brake must lead the torque if its excitation changes so (s)."""
        rises = after > before + 0.01
        return LEAD_TIME_CONSTANTS * self.brake.excitation_time_constant_s if rises else 0.0

    def excitation(self, torque_Nm: float, speed_Hz: float) -> float:
        """Return the excitation for a torque and speed with what is known of the brake."""
        configured = excitation_for(self.brake, torque_Nm, 2 * math.pi * speed_Hz)
        return min(configured * math.exp(0.5 * self.shift), 1.0)

    def follow(
        self, seen: Observation, torque_Nm: float, speed_Hz: float, torque_part: float = 1.0
    ) -> float:
        """Return the excitation for a torque and a speed, after what was seen of the rotor.

        The motor makes torque_part times what it is asked for, by gains that are induced.

        While the torque ramps, the brake is not corrected, and holds the larger of the torque asked
        for and the one that is in force when the excitation has followed.
        """
        dt_s = self._elapsed_s(seen.t_ns)
        self._estimate_inertia(dt_s, torque_part * seen.torque_set_Nm, seen.speed_Hz, speed_Hz)
        if math.isclose(seen.torque_set_Nm, torque_Nm, rel_tol=1e-6):
            passed_s = 0.0 if self._approaches(seen.speed_Hz, speed_Hz) else dt_s
            lead = self._integrate(passed_s, seen.speed_Hz, speed_Hz, torque_part * torque_Nm)
            held = self.excitation(torque_part * torque_Nm, speed_Hz)
            self._excitation = min(held * math.exp(0.5 * lead), 1.0)
        else:
            then_Nm = max(abs(torque_Nm), self._falling_Nm(dt_s, seen.torque_set_Nm))
            self._excitation = self.excitation(torque_part * then_Nm, speed_Hz)
        self._set_Nm = seen.torque_set_Nm
        return self._excitation

    def _approaches(self, speed_Hz: float, wanted_Hz: float) -> bool:
        """Return whether a rotor of unknown inertia is far from a speed and on its way to it."""
        far = speed_Hz / wanted_Hz < 1.0 - APPROACH_PART
        return far and not self._inertia_estimated and self._on_its_way

    def _falling_Nm(self, dt_s: float, set_Nm: float) -> float:
        """Return the torque that is in force when the excitation has followed, if it falls."""
        fallen_Nm = 0.0 if self._set_Nm is None else max(abs(self._set_Nm) - abs(set_Nm), 0.0)
        falls_Nm_per_s = fallen_Nm / dt_s if dt_s else 0.0
        return abs(set_Nm) - falls_Nm_per_s * self.brake.excitation_time_constant_s

    def _estimate_inertia(
        self, dt_s: float, torque_Nm: float, speed_Hz: float, wanted_Hz: float
    ) -> None:
        """Take the inertia from the first good part of an approach, without a stop in between.

        A rotor that still turns the other way is no such part: the brake that slows it, which the
        torque there hardly does, lags behind its excitation.
        """
        if self._inertia_estimated:
            return
        speed_rad_s, wanted_rad_s = 2 * math.pi * speed_Hz, 2 * math.pi * wanted_Hz
        before_rad_s, self._before_rad_s = self._before_rad_s, speed_rad_s
        gained_rad_s = speed_rad_s - before_rad_s
        self._on_its_way = dt_s > 0.0 and gained_rad_s / wanted_rad_s > STANDS_PER_S * dt_s
        if not self._on_its_way or before_rad_s * wanted_rad_s < 0.0:
            self._gained_rad_s = self._impulse_Nm_s = 0.0
            return
        configured_Nm = brake_torque_Nm(self.brake, self._excitation, speed_rad_s)
        self._impulse_Nm_s += (torque_Nm - configured_Nm * math.exp(-self._learned)) * dt_s
        self._gained_rad_s += gained_rad_s
        if self._gained_rad_s / wanted_rad_s > APPROACH_PART:
            self._inertia_kg_m2 = max(self._impulse_Nm_s / self._gained_rad_s, 0.0)
            self._inertia_estimated = True

    def correct(self, t_ns: int, speed_Hz: float, wanted_Hz: float) -> None:
        """Move towards more brake if `speed_Hz` is above `wanted_Hz`, towards less if below."""
        self._integrate(self._elapsed_s(t_ns), speed_Hz, wanted_Hz)

    def _elapsed_s(self, t_ns: int) -> float:
        """Return the time since the observation before, 0 if there was none."""
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns
        return min(max(dt_s, 0.0), 0.5)

    def _gain_per_s(self, torque_Nm: float, wanted_rad_s: float) -> float:
        """Return the integral gain; torque_Nm: that holds the speed, 0 if it is not known."""
        lag_s = self.brake.excitation_time_constant_s
        gain_per_s = CROSSOVER / max(lag_s, CROSSOVER / GAIN_PER_S)
        momentum_Nm_s = self._inertia_kg_m2 * abs(wanted_rad_s)
        if gain_per_s * momentum_Nm_s > ROTOR_CROSSOVER * abs(torque_Nm) > 0.0:
            return ROTOR_CROSSOVER * abs(torque_Nm) / momentum_Nm_s
        return gain_per_s

    def _integrate(
        self, dt_s: float, speed_Hz: float, wanted_Hz: float, torque_Nm: float = 0.0
    ) -> float:
        """Move the departure; return what is added to it until the speed is right.

        That part is proportional, its zero is the pole of the excitation.
        """
        error = max(min(speed_Hz / wanted_Hz - 1.0, 1.0), -1.0)
        limit = math.log(SHIFT_MAX)
        gain_per_s = self._gain_per_s(torque_Nm, 2 * math.pi * wanted_Hz)
        torque_error = error * max(slope(self.brake, 2 * math.pi * wanted_Hz), SLOPE_MIN)
        self.shift = max(min(self.shift + gain_per_s * torque_error * dt_s, limit), -limit)
        self._on_speed_s = self._on_speed_s + dt_s if abs(error) <= TRUST_ERROR else 0.0
        if self._on_speed_s >= TRUST_S:
            self._learned = self.shift
        return gain_per_s * torque_error * self.brake.excitation_time_constant_s
