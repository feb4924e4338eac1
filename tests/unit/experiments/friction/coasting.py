"""Coast-downs of a rotor whose friction is known: integrated finely, read by an encoder."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from motord.config import MotorConfig, load
from motord.experiments.friction.coast_down_rows import CoastDown
from motord.experiments.friction.estimate import measure
from motord.experiments.friction.result import Friction, Inertia

STEP_S = 1e-3
START_RAD_S, STOP_RAD_S = 12.0, 4.5
COUNTS = 4096
INERTIA = Inertia(0.0105, 0.0, "test")
MOTOR: MotorConfig = load().motor
NO_ERROR: Mapping[int, float] = {}


@dataclass(frozen=True)
class Rotor:
    """Friction and cogging torque; cogging: (order, C, D) each, in Nm."""

    coulomb_Nm: float = 0.03
    viscous_Nm_s_per_rad: float = 0.002
    stribeck_Nm: float = 0.0
    stribeck_rad_s: float = 2.0
    windage_Nm_s2_per_rad2: float = 0.0
    cogging: tuple[tuple[int, float, float], ...] = ((16, 0.05, 0.02), (48, 0.1, -0.2))

    def acceleration(self, angle_rad: np.ndarray, speed_rad_s: np.ndarray) -> np.ndarray:
        size = np.abs(speed_rad_s)
        torque_Nm = self.coulomb_Nm + self.viscous_Nm_s_per_rad * size
        if self.windage_Nm_s2_per_rad2:
            torque_Nm = torque_Nm + self.windage_Nm_s2_per_rad2 * size**2
        if self.stribeck_Nm:
            stribeck = np.exp(-((size / self.stribeck_rad_s) ** 2))
            torque_Nm = torque_Nm + self.stribeck_Nm * stribeck
        torque_Nm = -np.sign(speed_rad_s) * torque_Nm
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
    start_rad_s: float = START_RAD_S,
    stop_rad_s: float = STOP_RAD_S,
    longest_step: int = 5,
) -> list[CoastDown]:
    """Return coast-downs with rounded angles and, with longest_step, samples left out."""
    begun = _begun(rng, number, direction * start_rad_s)
    return [
        _read(rng, index, path, longest_step)
        for index, path in enumerate(paths(rotor, *begun, stop_rad_s))
    ]


def of_seeds(
    seeds: Iterable[int],
    rotor: Rotor,
    number: int,
    longest_step: int,
    encoder_rad: Mapping[int, float] = NO_ERROR,
) -> Iterator[list[CoastDown]]:
    """Yield the `coast_downs` of each seed; those of all are integrated at the same time."""
    draws = [np.random.default_rng(seed) for seed in seeds]
    return of_draws(draws, rotor, number, longest_step, encoder_rad)


def of_draws(
    draws: Sequence[np.random.Generator],
    rotor: Rotor,
    number: int,
    longest_step: int = 5,
    encoder_rad: Mapping[int, float] = NO_ERROR,
) -> Iterator[list[CoastDown]]:
    """Yield the `coast_downs` of each generator, which may be the same one again.

    encoder_rad: the encoder's errors by order per turn.
    """
    begun = np.hstack([_begun(rng, number, START_RAD_S) for rng in draws])
    every = (
        path + sum(error * np.sin(order * path) for order, error in encoder_rad.items())
        for path in paths(rotor, *begun, STOP_RAD_S)
    )
    for rng in draws:
        some = enumerate(islice(every, number))
        yield [_read(rng, index, path, longest_step) for index, path in some]


def _begun(rng: np.random.Generator, number: int, speed_rad_s: float) -> np.ndarray:
    """Return angles and speeds (2, number) that coast-downs begin with."""
    angle_rad = rng.uniform(0, 2 * np.pi, number)
    return np.array([angle_rad, speed_rad_s * rng.uniform(0.95, 1.05, number)])


def _read(rng: np.random.Generator, index: int, path: np.ndarray, longest_step: int) -> CoastDown:
    """Return a path as an encoder of `COUNTS` reads it."""
    kept = np.cumsum(rng.integers(1, longest_step + 1, path.size))
    kept = kept[kept < path.size]
    angle_rad = np.round(path[kept] * COUNTS / (2 * np.pi)) * (2 * np.pi / COUNTS)
    t_ns = np.round(kept * STEP_S * 1e9).astype(np.int64) + 10**18
    return CoastDown.of("run", index, t_ns, angle_rad % (2 * np.pi), COUNTS)


def friction(coasts: list[CoastDown], inertia: Inertia = INERTIA) -> Friction:
    return measure(coasts, MOTOR, inertia)
