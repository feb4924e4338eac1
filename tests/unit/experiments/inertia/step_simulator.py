"""Steps of torque of a rotor that is known, many at once, apart from motord's own rig.

J dw/dt = torque + cogging - Coulomb - viscous w, by semi-implicit Euler. Torque changes in steps
between the samples and lags, the sensor has a high-pass and white noise, the encoder rounds.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.inertia.torque_step import REQUIRED

SUBSTEP_S = 1e-4


@dataclass(frozen=True)
class Rotor:
    """What is true; a sample is so many substeps, the torque changes `delay` after it, and lags.

    sticking_Nm: of a brake, fading with 0.2 s from the beginning of the step on.
    """

    inertia_kg_m2: float = 0.0105
    viscous_Nm_s_per_rad: float = 0.003
    coulomb_Nm: float = 0.03
    sticking_Nm: float = 0.0
    cogging: tuple[tuple[int, float, float], ...] = ((16, 0.012, 0.4), (48, 0.012, 1.1))
    substeps: int = 10
    delay: int = 3
    lag_s: float = 3e-4
    noise_Nm: float = 0.02
    highpass_s: float = 2.0
    counts: int = 4096


def steps(rotor: Rotor, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Return `count` steps, forwards and back in turn: 1 s at rest, 1 Nm for a while, coasting."""
    t_s = np.arange(0, 1.65, SUBSTEP_S)
    sign = np.where(np.arange(count) % 2, -1.0, 1.0)
    profile_Nm = np.interp(t_s, [1.0, 1.06, 1.11, 1.17], [0, 1, 1, 0], 0, 0)
    angle = rng.uniform(0, 2 * np.pi, count)
    speed, torque, sensed = np.zeros(count), np.zeros(count), np.zeros(count)
    cogging = _cogging(rotor, angle)
    before = cogging
    tick, rows = rotor.substeps, []
    for n in range(t_s.size):
        if n % tick == 0:
            rows.append((angle.copy(), sensed.copy(), profile_Nm[n] * sign))
        wanted = profile_Nm[max(n - n % tick - (0 if n % tick >= rotor.delay else tick), 0)] * sign
        torque += (wanted - torque) * SUBSTEP_S / rotor.lag_s
        drive = torque + cogging - rotor.viscous_Nm_s_per_rad * speed
        free = speed + SUBSTEP_S / rotor.inertia_kg_m2 * drive
        sticking_Nm = rotor.sticking_Nm * np.exp(-max(t_s[n] - 1.0, 0.0) / 0.2)
        most = SUBSTEP_S / rotor.inertia_kg_m2 * (rotor.coulomb_Nm + sticking_Nm)
        speed = np.sign(free) * np.maximum(np.abs(free) - most, 0)
        angle = angle + SUBSTEP_S * speed
        cogging = _cogging(rotor, angle)
        now = torque + cogging
        sensed = sensed * (1 - SUBSTEP_S / rotor.highpass_s) + now - before
        before = now
    angles, torques, commands = (np.array(column) for column in zip(*rows, strict=True))
    torques = torques + rotor.noise_Nm * rng.normal(size=torques.shape)
    points = np.rint(angles * rotor.counts / (2 * np.pi)).astype(int) % rotor.counts
    t_ns = np.rint(t_s[::tick] * 1e9).astype(np.int64)
    return [
        np.rec.fromarrays((t_ns, points[:, k], torques[:, k], commands[:, k]), names=REQUIRED)
        for k in range(count)
    ]


def misaligned(ticks: np.ndarray, order: int, amplitude_Nm: float, phase_rad: float) -> np.ndarray:
    """Return a step whose sensor sees a torque of a coupling that the rotor does not."""
    changed, turned = ticks.copy(), order * np.unwrap(ticks["encoder_count"] * 2 * np.pi / 4096)
    wave = np.sin(turned + phase_rad)
    changed["torque_Nm"] += amplitude_Nm * (wave - wave[0])
    return changed


def _cogging(rotor: Rotor, angle_rad: np.ndarray) -> np.ndarray:
    waves = (a * np.sin(order * angle_rad + phase) for order, a, phase in rotor.cogging)
    return np.asarray(sum(waves))
