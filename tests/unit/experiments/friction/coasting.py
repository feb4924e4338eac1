"""Coast-downs of a rotor whose friction is known: integrated finely, read by an encoder."""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig, load
from motord.experiments.friction.coast_down import CoastDown
from motord.experiments.friction.estimate import measure
from motord.experiments.friction.result import Friction, Inertia

STEP_S = 1e-3
INERTIA = Inertia(0.0105, 0.0, "test")
MOTOR: MotorConfig = load().motor


@dataclass(frozen=True)
class Rotor:
    """Friction and cogging torque; cogging: (order, C, D) each, in Nm."""

    coulomb_Nm: float = 0.03
    viscous_Nm_s_per_rad: float = 0.002
    stribeck_Nm: float = 0.0
    stribeck_rad_s: float = 2.0
    cogging: tuple[tuple[int, float, float], ...] = ((16, 0.05, 0.02), (48, 0.1, -0.2))

    def acceleration(self, angle_rad: np.ndarray, speed_rad_s: np.ndarray) -> np.ndarray:
        size, sign = np.abs(speed_rad_s), np.sign(speed_rad_s)
        torque_Nm = -sign * (
            self.coulomb_Nm
            + self.viscous_Nm_s_per_rad * size
            + self.stribeck_Nm * np.exp(-((size / self.stribeck_rad_s) ** 2))
        )
        for order, c, d in self.cogging:
            torque_Nm = torque_Nm + c * np.cos(order * angle_rad) + d * np.sin(order * angle_rad)
        return torque_Nm / INERTIA.kg_m2


def paths(
    rotor: Rotor, angle_rad: np.ndarray, speed_rad_s: np.ndarray, stop_rad_s: float
) -> list[np.ndarray]:
    """Return the angle over time of rotors that begin so, until each is below a speed (RK4)."""
    x, v, f, h = angle_rad, speed_rad_s, rotor.acceleration, STEP_S
    xs, under = [x], np.zeros(x.size, int)
    while not under.all():
        k1v = f(x, v)
        k2x, k2v = v + h / 2 * k1v, f(x + h / 2 * v, v + h / 2 * k1v)
        k3x, k3v = v + h / 2 * k2v, f(x + h / 2 * k2x, v + h / 2 * k2v)
        k4x, k4v = v + h * k3v, f(x + h * k3x, v + h * k3v)
        x = x + h / 6 * (v + 2 * k2x + 2 * k3x + k4x)
        v = v + h / 6 * (k1v + 2 * k2v + 2 * k3v + k4v)
        xs.append(x)
        under[(under == 0) & (np.abs(v) < stop_rad_s)] = len(xs)
    every = np.array(xs)
    return [every[: under[n], n] for n in range(x.size)]


def coast_downs(
    rng: np.random.Generator,
    rotor: Rotor,
    number: int,
    *,
    direction: int = 1,
    start_rad_s: float = 12.0,
    stop_rad_s: float = 4.5,
    longest_step: int = 1,
    counts: int = 4096,
) -> list[CoastDown]:
    """Return coast-downs with rounded angles and, with longest_step, samples left out."""
    begin = rng.uniform(0, 2 * np.pi, number)
    speed = direction * start_rad_s * rng.uniform(0.95, 1.05, number)
    found = []
    for index, path in enumerate(paths(rotor, begin, speed, stop_rad_s)):
        kept = np.cumsum(rng.integers(1, longest_step + 1, path.size))
        kept = kept[kept < path.size]
        angle_rad = np.round(path[kept] * counts / (2 * np.pi)) * (2 * np.pi / counts)
        t_ns = np.round(kept * STEP_S * 1e9).astype(np.int64) + 10**18
        found.append(CoastDown.of("run", index, t_ns, angle_rad % (2 * np.pi), counts))
    return found


def friction(coasts: list[CoastDown], inertia: Inertia = INERTIA) -> Friction:
    return measure(coasts, MOTOR, inertia)
