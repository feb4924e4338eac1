"""Which operating points tell most about a calibration in each second of bench time.

Optimal design of experiments (Fedorov 1972; Atkinson and Donev 1992), one point after the other:
each adds its information to what is known, N = prior + sum X'X / sigma^2, and the one is taken that
lowers tr(M N^-1) most per second, its transition from the point before counted. M weighs what the
plan is to reach: for the ripple that is left it is the ripple's quadratic form (I-optimality).

Points differ in torque, direction, and a phase whose current is halved: then gains, offsets and
cogging torque show at one torque already, and nothing has to be waited for. What the data sheets
leave open, such as friction that ripples, is estimated along with its limit as prior; so both
directions and other torques are taken where they separate it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.config import Config
from motord.identification.least_loss import currents_per_Nm
from motord.identification.orders import allowed_orders
from motord.sequencing.demand import NOTHING_INDUCED, Induced

TICKS_PER_CYCLE = (125, 80)
"""Ticks in an electrical turn: wanted, and the fewest where the time is short. Currents are held
from tick to tick, which counts as an age only while they change little meanwhile."""

HALVED = 0.5
"""Factor of a phase's current that tells its gain from the others'."""

LOWER_TORQUE = 0.6
"""The second torque, in parts of the first: for what grows with the current."""

NOISE = 0.004
"""Standard deviation of a torque sample, in parts of the rated torque, taken for granted."""

COGGING = 0.05
"""Cogging torque, in parts of the rated torque, that one reckons with before any is known."""

OFFSET_SEEN = 1e-3
"""Sum of the back-EMFs, in parts of the largest, from which a common offset counts as seen."""

TABLE = 1024
"""Angles of a turn at which the design looks."""

PRIOR = {"alpha": 0.2, "beta_A": 2.0, "cogging": 0.1}
"""Standard deviations before any data; cogging: of each line, in parts of the rated torque."""


@dataclass(frozen=True)
class Candidate:
    """A torque (Nm, its sign the direction's) with the factors of the phases' currents."""

    torque_Nm: float
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def mean_torque_Nm(self) -> float:
        """Mean torque, about, of balanced phases with these factors."""
        return self.torque_Nm * sum(self.gain) / 3

    @property
    def induced(self) -> Induced:
        """What the loop induces for it."""
        return Induced(self.gain) if min(self.gain) < 1.0 else NOTHING_INDUCED


@dataclass(frozen=True)
class Parameters:
    """Places of the parameters in the design's vector: alpha (3), beta (3), age, cogging, others.

    The others are departures that data sheets limit: friction ripple at each order, cross-talk of
    the torque sensor at twice the pole pairs, a back-EMF that falls with the current.
    """

    orders: tuple[int, ...]

    @property
    def cogging(self) -> slice:
        """cos and sin of each order."""
        return slice(7, 7 + 2 * len(self.orders))

    @property
    def calibrated(self) -> int:
        """Number of those that a calibration holds, which come first, the age among them."""
        return 7 + 2 * len(self.orders)

    @property
    def all(self) -> int:
        """Number of all."""
        return self.calibrated + 2 * len(self.orders) + 3


class Design:
    """Information of candidates of one motor on one bench, by its description alone."""

    def __init__(self, config: Config, torque_Nm: float, directions: Sequence[int]) -> None:
        """torque_Nm: the largest; directions: 1, -1 or both."""
        motor = config.motor
        self._config, self.rated_Nm = config, motor.rated_torque_Nm
        self.brake = config.brake
        step = max(motor.counts // TABLE, 1)
        self._angle_rad = 2 * np.pi * np.arange(0, motor.counts, step) / motor.counts
        self._k = motor.back_emf_table()[::step]
        self._per_Nm = currents_per_Nm(motor)[::step]
        highest = min(4 * max(motor.slots, 2 * motor.pole_pairs), self._angle_rad.size // 4)
        orders = allowed_orders(motor.slots, 2 * motor.pole_pairs, highest)
        self.parameters = Parameters(orders)
        angles = np.outer(self._angle_rad, orders)
        self._waves = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(angles), -1)
        halved = [tuple(HALVED if p == q else 1.0 for q in range(3)) for p in range(3)]
        patterns = [(1.0, 1.0, 1.0), *halved]
        self.candidates = tuple(
            Candidate(sign * torque_Nm * part, (a, b, c))
            for sign in directions
            for part in (1.0, LOWER_TORQUE)
            for a, b, c in patterns
        )

    @property
    def offset_seen(self) -> bool:
        """Whether an offset that all phases have makes torque: by triplen harmonics."""
        common = np.abs(self._k.sum(axis=1)).max()
        return bool(common > OFFSET_SEEN * np.abs(self._k).max())

    def columns(self, candidate: Candidate, speed_Hz: float) -> np.ndarray:
        """Return the torque by each parameter over a turn (angles, parameters), without means."""
        i_A = candidate.torque_Nm * self._per_Nm * candidate.gain
        by_gain = i_A * self._k
        torque_Nm = by_gain.sum(axis=1)
        rate = np.gradient(i_A, self._angle_rad, axis=0) * 2 * np.pi * speed_Hz
        age_Nm = (rate * self._k).sum(axis=1) * 0.25 / self._config.loop.rate_Hz
        level = abs(candidate.torque_Nm) * float(np.linalg.norm(candidate.gain)) / math.sqrt(3)
        twice = 2 * self._config.motor.pole_pairs * self._angle_rad
        accuracy = self._config.accuracy
        crosstalk = accuracy.torque_crosstalk_percent / 100 / math.sqrt(3)
        friction_Nm = accuracy.friction_ripple_percent / 100 / math.sqrt(3) * self.rated_Nm
        falls = accuracy.saturation_percent / 100 / math.sqrt(3) * level / self.rated_Nm
        columns = np.column_stack(
            [
                by_gain,
                self._k,
                age_Nm,
                self._waves,
                math.copysign(friction_Nm, candidate.torque_Nm) * self._waves,
                crosstalk * torque_Nm * np.cos(twice),
                crosstalk * torque_Nm * np.sin(twice),
                falls * torque_Nm,
            ]
        )
        return np.asarray(columns - columns.mean(axis=0))

    def information(self, candidate: Candidate, speed_Hz: float) -> np.ndarray:
        """Return the information (parameters, parameters) of a turn."""
        columns = self.columns(candidate, speed_Hz)
        ticks = self._config.loop.rate_Hz / abs(speed_Hz)
        noise_Nm = NOISE * self.rated_Nm
        return np.asarray(columns.T @ columns * (ticks / len(columns) / noise_Nm**2))

    @cached_property
    def prior(self) -> np.ndarray:
        """Information before any turn; the age and the others have 1 as their unit."""
        size = self.parameters
        deviation = np.ones(size.all)
        deviation[:3], deviation[3:6] = PRIOR["alpha"], PRIOR["beta_A"]
        deviation[size.cogging] = PRIOR["cogging"] * self.rated_Nm
        return np.diag(deviation**-2.0)

    def ripple(self, torques_Nm: Sequence[float]) -> np.ndarray:
        """Return the form Q of the ripple that errors leave, rated torque 1: ripple^2 = t' Q t."""
        size, form = self.parameters, np.zeros((self.parameters.all, self.parameters.all))
        for torque_Nm in torques_Nm:
            columns = self.columns(Candidate(torque_Nm), 1.0)[:, : size.calibrated]
            columns[:, 6] = 0.0  # the age is no part of a calibration
            part = columns.T @ columns / len(columns) / self.rated_Nm**2
            form[: size.calibrated, : size.calibrated] += part / len(torques_Nm)
        return form
