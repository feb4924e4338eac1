"""Where the rotor came to rest under a current vector that went from stop to stop."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from motord.identification import IdentifyError
from motord.identification.operating_points import COMMANDS, CURRENTS, stacked
from motord.identification.turning import unwrap_counts
from motord.schema import joined

REQUIRED = ("t_ns", "encoder_count", *COMMANDS, *CURRENTS, "torque_Nm")
"""Columns of the ticks of a sweep."""

STOP_S = 0.15
"""Time for which the command is the same at a stop, at least."""

STILL_COUNTS = 2.5
STILL_ELECTRICAL_RAD = 0.05
"""How far a rotor that rests may move: so many counts, or this electrical angle if that is more."""

PHASE_LAGS_RAD = 2 * np.pi / 3 * np.arange(3)


REST = np.dtype(
    [
        ("command_A", float, 3),
        ("sensed_A", float, 3),
        ("vector_A", complex),
        ("electrical_rad", float),
        ("encoder_rad", float),
        ("direction", int),
        ("sweep", int),
        ("still", bool),
    ]
)
"""A stop of a sweep. command_A, sensed_A: means; vector_A: the command as a complex number, of the
amplitude and at the electrical angle of the vector; electrical_rad: that angle, not wrapped within
a sweep; encoder_rad: mean angle of the encoder, nor that; direction: 1 or -1, of the vector; sweep:
its number; still: whether the rotor rested.
"""

Rests: TypeAlias = np.recarray[Any, Any]
"""Stops of one or several sweeps, n of them, in the order in which they were made: REST."""


def rests_of(sweeps: Sequence[np.ndarray], counts: int, pole_pairs: int) -> Rests:
    """Return the stops in the ticks of `sweeps`, each with the columns REQUIRED.

    Raises IdentifyError if there are no ticks.
    """
    parts = [
        _rests(ticks, number, counts, pole_pairs)
        for number, ticks in enumerate(sweeps)
        if ticks.size
    ]
    if not parts:
        raise IdentifyError("no ticks were recorded while the current vector turned")
    return joined(parts).view(np.recarray)


def unwrapped_rad(encoder_count: np.ndarray, counts: int) -> np.ndarray:
    """Return counts (n,) as an angle that goes on beyond a turn."""
    return 2 * np.pi / counts * unwrap_counts(encoder_count, counts)


def vectors(currents_A: np.ndarray) -> np.ndarray:
    """Return currents (n, 3) of three phases as complex numbers (n,): amplitude and angle."""
    return np.asarray(currents_A @ np.exp(1j * PHASE_LAGS_RAD) * (2 / 3))


def _rests(ticks: np.ndarray, number: int, counts: int, pole_pairs: int) -> Rests:
    command_A = stacked(ticks, COMMANDS)
    sensed_A = stacked(ticks, CURRENTS)
    encoder_rad = unwrapped_rad(ticks["encoder_count"], counts)
    halves = [_later_half(ticks["t_ns"], part) for part in _stops(ticks["t_ns"], command_A)]
    commands_A = _means(command_A, halves)
    vector_A = vectors(commands_A)
    electrical_rad = np.unwrap(np.angle(vector_A))
    backwards = electrical_rad.size and electrical_rad[-1] < electrical_rad[0]
    limit_rad = max(STILL_COUNTS * 2 * np.pi / counts, STILL_ELECTRICAL_RAD / pole_pairs)
    columns = (
        commands_A,
        _means(sensed_A, halves),
        vector_A,
        electrical_rad,
        _means(encoder_rad, halves),
        np.full(len(halves), -1 if backwards else 1),
        np.full(len(halves), number),
        np.array([np.ptp(encoder_rad[half]) < limit_rad for half in halves], bool),
    )
    return np.rec.fromarrays(columns, dtype=REST)


def _means(values: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Return the mean of each part of `values` (n, ...), shape (parts, ...)."""
    return np.reshape([values[part].mean(axis=0) for part in parts], (-1, *values.shape[1:]))


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
