"""A rotor that a soft belt pulls through its cogging torque slowly: it sticks, and slips.

Written apart from motord's rig and estimators; semi-implicit Euler:

    J dw/dt = belt (phi - theta) + damping (dphi/dt - w) + cogging(theta) - friction

Friction holds the rotor up to `static_Nm`, then slides with `sliding_Nm`, which may ripple over the
turn. The sensor sees the cogging torque, and the friction if the bearing is on its side.
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from motord.schema import TICK_DTYPE

SUBSTEP_S = 1e-4


@dataclass(frozen=True)
class Jerky:
    """What is true. cogging, friction_ripple: waves a sin(order theta + phase), (order, a, phase).

    The ripple is in parts of the sliding friction, against the motion. sensed: whether the torque
    sensor sees the friction.
    """

    counts: int = 4096
    inertia_kg_m2: float = 0.0105
    belt_Nm_per_rad: float = 6.0
    damping_Nm_s_per_rad: float = 0.02
    static_Nm: float = 0.06
    sliding_Nm: float = 0.04
    cogging: tuple[tuple[int, float, float], ...] = (
        (16, 0.08, 0.6),
        (48, 0.33, 0.3),
        (96, 0.06, 1.4),
    )
    friction_ripple: tuple[tuple[int, float, float], ...] = ()
    sensed: bool = False
    noise_Nm: float = 0.02
    highpass_s: float = 0.0
    rate_Hz: int = 1000

    def ticks(self, speeds_Hz: list[tuple[float, float]], seed: int) -> np.ndarray:
        """Return the ticks of a drive that takes each (speed, seconds) in turn; speeds signed."""
        every = round(1 / self.rate_Hz / SUBSTEP_S)
        drive = np.concatenate(
            [np.full(round(s / SUBSTEP_S), 2 * np.pi * speed) for speed, s in speeds_Hz]
        )
        angle, torque = _run(
            drive, every, np.array(self.cogging), np.array([*self.friction_ripple, (0, 0.0, 0.0)]),
            self.inertia_kg_m2, self.belt_Nm_per_rad, self.damping_Nm_s_per_rad, self.static_Nm,
            self.sliding_Nm, float(self.sensed), self.highpass_s,
        )  # fmt: skip
        rng = np.random.default_rng(seed)
        ticks = np.zeros(angle.size, TICK_DTYPE)
        ticks["t_ns"] = 1_700_000_000_000_000_000 + np.arange(angle.size) * (10**9 // self.rate_Hz)
        ticks["tick"] = np.arange(angle.size)
        ticks["encoder_count"] = np.rint(angle * self.counts / (2 * np.pi)) % self.counts
        ticks["torque_Nm"] = torque + self.noise_Nm * rng.normal(size=angle.size)
        return ticks

    def turned(self, rad: float) -> "Jerky":
        """Return the same rotor with its zero elsewhere: another seed of the same physics."""
        return replace(self, cogging=tuple((h, a, p + h * rad) for h, a, p in self.cogging))


@numba.njit(cache=True)
def _waves(waves: np.ndarray, angle: float) -> float:
    total = 0.0
    for row in range(waves.shape[0]):
        total += waves[row, 1] * np.sin(waves[row, 0] * angle + waves[row, 2])
    return total


@numba.njit(cache=True)
def _run(
    drive: np.ndarray, every: int, cogging: np.ndarray, ripple: np.ndarray, inertia: float,
    belt: float, damping: float, static: float, sliding: float, sensed: float, highpass_s: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    h = 1e-4
    angles, torques = np.empty(drive.size // every), np.empty(drive.size // every)
    angle, speed, phi, low = 0.01, drive[0], 0.01, 0.0
    for n in range(drive.size):
        cog = _waves(cogging, angle)
        phi += h * drive[n]
        push = belt * (phi - angle) + damping * (drive[n] - speed) + cog
        if speed == 0.0 and abs(push) <= static:
            friction = push
        else:
            way = speed if speed != 0.0 else push
            friction = np.sign(way) * sliding * (1.0 + _waves(ripple, angle))
            after = speed + h / inertia * (push - friction)
            if speed != 0.0 and after * speed < 0.0:
                friction, after = push + speed * inertia / h, 0.0
            speed = after
            angle += h * speed
        torque = _waves(cogging, angle) - sensed * friction
        if highpass_s > 0.0:
            low += h / highpass_s * (torque - low)
            torque -= low
        if n % every == every - 1:
            angles[n // every], torques[n // every] = angle, torque
    return angles, torques
