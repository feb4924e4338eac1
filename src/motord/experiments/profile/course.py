"""A trace as it is played: with the start from standstill to its first row, and the brake.

The brake balances the torque less that of the acceleration,

    T_brake = T - J dw/dt,    e = sqrt(T_brake / T_full(w)),

with T_full its torque at full excitation. The excitation e answers with a time constant; as the
whole trace is known, the set-point is the one that brings e where it has to be a step later, and
begins early where a step would need more than full excitation.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.config import BrakeConfig, Config
from motord.experiments.profile.trace import Trace
from motord.sequencing.brake_servo import LEAD_TIME_CONSTANTS

STEP_S = 0.05
"""Time between two set-points of the brake."""

RATE_SHARE = 0.5
"""Part of the torque's ramp that the start uses."""

ACCELERATION_Hz_per_s = 0.5
"""Largest acceleration of the start."""

SETTLE_S = 2.0
"""Time at the first row before the trace begins, unless it begins at rest."""

STANDING_Hz = 0.02
"""Speed below which the brake has no torque that counts."""

WEAK = 0.85
"""Brake torque that is assumed for the over-speed trip, in parts of the configured one."""

SUBSTEP_S = 0.01


@dataclass(frozen=True)
class Course:
    """A trace with its start; time 0 is its first row, negative before.

    at_s (n,), torque_Nm (n,), speed_Hz (n,): on a grid of STEP_S; brake (n,): set-point of the
    excitation from that time on.
    """

    trace: Trace
    at_s: np.ndarray
    torque_Nm: np.ndarray
    speed_Hz: np.ndarray
    brake: np.ndarray

    @classmethod
    def of(cls, trace: Trace, config: Config, inertia_kg_m2: float) -> "Course":
        """Return the course of a trace on a bench."""
        lead_s = LEAD_TIME_CONSTANTS * config.brake.excitation_time_constant_s
        ramp_s, settle_s = _way_s(trace, config.limits.torque_rate_Nm_per_s)
        first_s = -settle_s - ramp_s - lead_s
        first, last = math.floor(first_s / STEP_S), math.ceil(trace.duration_s / STEP_S)
        at_s = STEP_S * np.arange(first, last + 1)
        way_s = [first_s, -settle_s - ramp_s, -settle_s] if ramp_s else [first_s]
        time_s = np.concatenate([way_s, trace.time_s])
        torque_Nm, speed_Hz = (
            np.interp(
                at_s, time_s, np.concatenate([([0.0, 0.0, row[0]] if ramp_s else [0.0]), row])
            )
            for row in (trace.torque_Nm, trace.speed_Hz)
        )
        load_Nm = brake_load_Nm(torque_Nm, speed_Hz, np.gradient(speed_Hz, STEP_S), inertia_kg_m2)
        wanted = _excitation(config.brake, load_Nm, speed_Hz)
        setpoints = _setpoints(wanted, _decay(config.brake, STEP_S))
        return cls(trace, at_s, torque_Nm, speed_Hz, setpoints)

    @property
    def begins_s(self) -> float:
        """Time at which it begins."""
        return float(self.at_s[0])

    @property
    def seconds(self) -> float:
        """How long it is (s)."""
        return self.trace.duration_s - self.begins_s

    def wanted(self, at_s: float) -> tuple[float, float, float]:
        """Return torque (Nm), speed (turns/s) and excitation of the brake at a time."""
        step = min(max(int((at_s - self.begins_s) / STEP_S), 0), self.at_s.size - 1)
        if at_s < 0:
            torque_Nm, speed_Hz = (
                float(np.interp(at_s, self.at_s, row)) for row in (self.torque_Nm, self.speed_Hz)
            )
        else:
            torque_Nm, speed_Hz = (
                float(np.interp(at_s, self.trace.time_s, row))
                for row in (self.trace.torque_Nm, self.trace.speed_Hz)
            )
        return torque_Nm, speed_Hz, float(self.brake[step])

    @cached_property
    def angle_rad(self) -> np.ndarray:
        """Angle of a rotor that follows, on the grid (n,)."""
        steps = 0.5 * (self.speed_Hz[1:] + self.speed_Hz[:-1]) * STEP_S
        return 2 * np.pi * np.concatenate([[0.0], np.cumsum(steps)])


def brake_load_Nm(
    torque_Nm: np.ndarray, speed_Hz: np.ndarray, rate_Hz_per_s: np.ndarray, inertia_kg_m2: float
) -> np.ndarray:
    """Return what the brake has to hold (n,), positive against the speed."""
    along = np.sign(np.where(np.abs(speed_Hz) < STANDING_Hz, torque_Nm, speed_Hz))
    return np.asarray(along * (torque_Nm - 2 * np.pi * inertia_kg_m2 * rate_Hz_per_s))


def full_torque_Nm(brake: BrakeConfig, speed_Hz: np.ndarray) -> np.ndarray:
    """Return the brake's torque at full excitation (n,), as `brake_torque_Nm` does."""
    ratio = 2 * np.pi * np.abs(speed_Hz) / brake.critical_speed_rad_s
    return np.asarray(brake.torque_max_Nm * 2 * ratio / (1 + ratio * ratio))


def fastest_rad_s(course: Course, brake: BrakeConfig, inertia_kg_m2: float) -> np.ndarray:
    """Return the speed (n,) on the grid of a rotor without friction, with a brake that is WEAK.

    The speed settles exponentially within each substep, with the brake's slope at its beginning.
    """
    slope = WEAK * 2 * brake.torque_max_Nm / brake.critical_speed_rad_s
    critical_rad_s, count = brake.critical_speed_rad_s, round(STEP_S / SUBSTEP_S)
    decay = _decay(brake, SUBSTEP_S)
    found = np.zeros(course.at_s.size)
    excitation, speed = float(course.brake[0]), 0.0
    for step, (torque_Nm, wanted) in enumerate(
        zip(course.torque_Nm.tolist(), course.brake.tolist(), strict=True)
    ):
        found[step] = speed
        for _ in range(count):
            ratio = speed / critical_rad_s
            damping = slope * excitation * excitation / (1 + ratio * ratio)
            passed = damping * SUBSTEP_S / inertia_kg_m2
            if passed > 1e-9:
                settled = torque_Nm / damping
                speed = settled + (speed - settled) * math.exp(-passed)
            else:
                speed += torque_Nm * SUBSTEP_S / inertia_kg_m2
            speed = min(max(speed, -1e6), 1e6)
            excitation = wanted + (excitation - wanted) * decay
    return found


def _way_s(trace: Trace, rate_Nm_per_s: float) -> tuple[float, float]:
    """Return the times (s) of the ramp to the first row and of settling there."""
    torque_Nm, speed_Hz = abs(float(trace.torque_Nm[0])), abs(float(trace.speed_Hz[0]))
    if torque_Nm == 0.0 and speed_Hz == 0.0:
        return 0.0, 0.0
    ramp_s = max(torque_Nm / (RATE_SHARE * rate_Nm_per_s), speed_Hz / ACCELERATION_Hz_per_s)
    return ramp_s, SETTLE_S


def _excitation(brake: BrakeConfig, load_Nm: np.ndarray, speed_Hz: np.ndarray) -> np.ndarray:
    """Return the excitation (n,) that holds a load; at standstill the one needed next."""
    full_Nm = full_torque_Nm(brake, speed_Hz)
    turning = np.abs(speed_Hz) >= STANDING_Hz
    share = np.divide(np.maximum(load_Nm, 0.0), full_Nm, out=np.zeros(load_Nm.size), where=turning)
    excitation = np.sqrt(np.minimum(share, 1.0))
    if not turning.any():
        return np.ones(load_Nm.size)
    places = np.flatnonzero(turning)
    following = np.searchsorted(places, np.arange(load_Nm.size))
    return np.asarray(excitation[places[np.minimum(following, places.size - 1)]])


def _decay(brake: BrakeConfig, time_s: float) -> float:
    """Return the factor by which the excitation's deviation from its set-point decays in a time."""
    tau_s = brake.excitation_time_constant_s
    return math.exp(-time_s / tau_s) if tau_s > 0 else 0.0


def _setpoints(wanted: np.ndarray, decay: float) -> np.ndarray:
    """Return the set-points (n,), 0 to 1, that bring the excitation where it is `wanted` (n,).

    decay: of the excitation's departure from its set-point within a step.
    """
    reached = wanted.tolist()
    for step in range(len(reached) - 2, -1, -1) if decay else ():
        reached[step] = max(reached[step], (reached[step + 1] - (1 - decay)) / decay)
    setpoints, excitation = [], reached[0]
    for following in [*reached[1:], reached[-1]]:
        setpoint = min(max((following - decay * excitation) / (1 - decay), 0.0), 1.0)
        setpoints.append(setpoint)
        excitation = setpoint + (excitation - setpoint) * decay
    return np.array(setpoints)
