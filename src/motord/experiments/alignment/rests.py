"""Where the rotor came to rest under a current vector that went from stop to stop."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from motord.identification.operating_points import COMMANDS, CURRENTS
from motord.identification.turning import unwrap_counts

REQUIRED = ("t_ns", "encoder_count", *COMMANDS, *CURRENTS, "torque_Nm")
"""Columns of the ticks of a sweep."""

STOP_S = 0.15
"""Time for which the command is the same at a stop, at least."""

STILL_COUNTS = 2.5
STILL_ELECTRICAL_RAD = 0.05
"""How far a rotor that rests may move: so many counts, or this electrical angle if that is more."""

PHASE_LAGS_RAD = 2 * np.pi / 3 * np.arange(3)


@dataclass(frozen=True)
class Rests:
    """Stops of one or several sweeps, n of them, in the order in which they were made.

    command_A, sensed_A (n, 3): means; vector_A (n,): the command as a complex number, of the
    amplitude and at the electrical angle of the vector; electrical_rad (n,): that angle, not
    wrapped within a sweep; encoder_rad (n,): mean angle of the encoder, nor that; way (n,): 1 or
    -1; sweep (n,): its number; still (n,): whether the rotor rested.
    """

    command_A: np.ndarray
    sensed_A: np.ndarray
    vector_A: np.ndarray
    electrical_rad: np.ndarray
    encoder_rad: np.ndarray
    way: np.ndarray
    sweep: np.ndarray
    still: np.ndarray

    def chosen(self, which: np.ndarray) -> "Rests":
        """Return some of them; `which` (n,) says which."""
        return Rests(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def rests_of(sweeps: Sequence[np.ndarray], counts: int, pole_pairs: int) -> Rests:
    """Return the stops in the ticks of `sweeps`, each with the columns REQUIRED."""
    parts = [
        _rests(ticks, number, counts, pole_pairs)
        for number, ticks in enumerate(sweeps)
        if ticks.size
    ]
    names = Rests.__dataclass_fields__
    return Rests(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def unwrapped_rad(encoder_count: np.ndarray, counts: int) -> np.ndarray:
    """Return counts (n,) as an angle that goes on beyond a turn."""
    return 2 * np.pi / counts * unwrap_counts(encoder_count, counts)


def vectors(currents_A: np.ndarray) -> np.ndarray:
    """Return currents (n, 3) of three phases as complex numbers (n,): amplitude and angle."""
    vector: np.ndarray = currents_A @ np.exp(1j * PHASE_LAGS_RAD) * (2 / 3)
    return vector


def _rests(ticks: np.ndarray, number: int, counts: int, pole_pairs: int) -> Rests:
    command_A = _columns(ticks, COMMANDS)
    sensed_A = _columns(ticks, CURRENTS)
    encoder_rad = unwrapped_rad(ticks["encoder_count"], counts)
    halves = [_later_half(ticks["t_ns"], part) for part in _stops(ticks["t_ns"], command_A)]
    n = len(halves)
    commands_A = _means(command_A, halves)
    vector_A = vectors(commands_A)
    electrical_rad = np.unwrap(np.angle(vector_A)) if n else np.zeros(0)
    limit_rad = max(STILL_COUNTS * 2 * np.pi / counts, STILL_ELECTRICAL_RAD / pole_pairs)
    still = np.array([bool(np.ptp(encoder_rad[half]) < limit_rad) for half in halves], bool)
    way = 1 if n and electrical_rad[-1] >= electrical_rad[0] else -1
    return Rests(
        command_A=commands_A,
        sensed_A=_means(sensed_A, halves),
        vector_A=vector_A,
        electrical_rad=electrical_rad,
        encoder_rad=_means(encoder_rad[:, np.newaxis], halves)[:, 0],
        way=np.full(n, way),
        sweep=np.full(n, number),
        still=still,
    )


def _columns(ticks: np.ndarray, names: Sequence[str]) -> np.ndarray:
    return np.stack([ticks[name].astype(float) for name in names], axis=1)


def _means(values: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Return the mean of each part of `values` (n, k), shape (parts, k)."""
    means = [values[part].mean(axis=0) for part in parts]
    return np.array(means).reshape(len(parts), values.shape[1])


def _stops(t_ns: np.ndarray, command_A: np.ndarray) -> list[slice]:
    """Return the stretches of at least STOP_S over which the command is the same, and not zero."""
    changes = 1 + np.flatnonzero((np.diff(command_A, axis=0) != 0).any(axis=1))
    edges = [0, *changes.tolist(), t_ns.size]
    return [
        slice(first, end)
        for first, end in pairwise(edges)
        if (t_ns[end - 1] - t_ns[first]) * 1e-9 >= STOP_S and command_A[first].any()
    ]


def _later_half(t_ns: np.ndarray, part: slice) -> slice:
    middle_ns = (t_ns[part.start] + t_ns[part.stop - 1]) // 2
    return slice(part.start + int(np.searchsorted(t_ns[part], middle_ns)), part.stop)
