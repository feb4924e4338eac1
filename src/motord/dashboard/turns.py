"""Torque over the angle of the last turns, and its spectrum over the orders of the turn."""

from collections import deque
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motord.identification.harmonics import lines_at
from motord.schema import rows_of
from motord.wire.ticks.blocks import Block

POINTS = 2048
"""Places of a turn at which torque is summed: at each order the error of the place is small."""
BINS = 512
"""Of a turn as it is drawn."""
TURNS = 8
"""So many are kept; the spectrum is over all of them."""
ORDERS = 160
"""The spectrum has orders 0 to this one, and no higher one than the ticks of a turn allow."""
FILLED_MIN = 32
"""A turn with torque at fewer places says nothing: the rotor turns too fast, or stands."""
SIGNALS = ("torque_Nm", "cogging_comp_Nm", "torque_set_Nm")

Floats = NDArray[np.float64]


class BinnedTurn(NamedTuple):
    """A turn: how often each of POINTS places was visited, and the sums of SIGNALS there.

    set_Nm: the smallest and the largest torque set-point on the way.
    """

    visits: Floats
    sums: Floats
    set_Nm: tuple[float, float]


class TurnAverager:
    """Gathers ticks by angle, one turn after the other; a turn counts when all of it was passed.

    A gap, another direction or a restart begins a turn anew.
    """

    def __init__(self) -> None:
        self.completed = 0
        """How many turns there have been; another number is news."""
        self._turns: deque[BinnedTurn] = deque(maxlen=TURNS)
        self._angle_rad: float | None = None  # of the newest tick, not wrapped
        self._turn = 0
        self._whole = False  # the present turn was entered at one end
        self._begin()

    def add(self, block: Block) -> None:
        """Take in consecutive ticks (n,)."""
        angle_rad = block["angle_rad"].astype(float)
        good = np.isfinite(angle_rad) & np.isfinite(block["torque_Nm"])
        if not good.any():
            return
        block, angle_rad = rows_of(block, good), angle_rad[good]
        before = self._angle_rad
        if before is None:  # somewhere in a turn
            before = float(angle_rad[0])
            self._turn = int(before // (2 * np.pi))
        unwrapped = np.unwrap(np.concatenate(([before], angle_rad)))[1:]
        self._angle_rad = float(unwrapped[-1])
        turn = np.floor(unwrapped / (2 * np.pi)).astype(int)
        edges = [0, *(np.flatnonzero(np.diff(turn)) + 1).tolist(), len(turn)]
        for begin, end in pairwise(edges):
            self._enter(int(turn[begin]))
            self._gather(block[begin:end], unwrapped[begin:end])

    def interrupt(self) -> None:
        """Ticks are missing: the present turn does not count."""
        self._angle_rad, self._whole = None, False
        self._begin()

    def by_bin(self) -> NDArray[np.float32]:
        """Return the measured torque of the last turns (turns, BINS), the newest last, Nm."""
        return np.array(
            [_binned(one.visits, one.sums[0]) for one in self._turns], np.float32
        ).reshape(-1, BINS)

    def compensation(self) -> NDArray[np.float32]:
        """Return the cogging torque made up for in the newest turn (BINS,), Nm."""
        newest = self._turns[-1]
        return _binned(newest.visits, newest.sums[1]).astype(np.float32)

    def set_Nm(self) -> float:
        """Return the mean torque set-point of the newest turn."""
        newest = self._turns[-1]
        return float(newest.sums[2].sum() / newest.visits.sum())

    def steady(self) -> bool:
        """Return whether the torque set-point was one and the same all over the newest turn."""
        low_Nm, high_Nm = self._turns[-1].set_Nm
        return low_Nm == high_Nm

    def amplitudes_Nm(self) -> NDArray[np.float32]:
        """Return the amplitude at each order (ORDERS + 1,) over the last turns; order 0: the mean.

        Of turns at the newest set-point that did not change meanwhile: a ramp or a trip has every
        order. NaN without any, and for orders that so few ticks a turn do not resolve. Least
        squares: places that were visited more often do not count for more.
        """
        out = np.full(ORDERS + 1, np.nan, np.float32)
        newest_Nm = self._turns[-1].set_Nm[1]
        steady = [one for one in self._turns if one.set_Nm == (newest_Nm, newest_Nm)]
        if not steady:
            return out
        visits = np.sum([one.visits for one in steady], axis=0)
        sums = np.sum([one.sums[0] for one in steady], axis=0)
        at = np.flatnonzero(visits)
        fewest = min(int(np.count_nonzero(one.visits)) for one in steady)
        highest = min(ORDERS, fewest // 2 - 1)
        lines = lines_at(at, sums[at] / visits[at], POINTS, highest)
        half_place = np.exp(-1j * np.arange(highest + 1) * np.pi / POINTS)  # sums are at its middle
        out[: highest + 1] = np.abs(lines * half_place)
        out[0] = lines[0].real
        return out

    def _begin(self) -> None:
        self._visits, self._sums = np.zeros(POINTS), np.zeros((len(SIGNALS), POINTS))
        self._set_Nm = (np.inf, -np.inf)
        self._entered_from = 0

    def _enter(self, turn: int) -> None:
        step, self._turn = turn - self._turn, turn
        if step == 0:
            return
        passed = self._whole and abs(step) == 1 and step == self._entered_from
        if passed and np.count_nonzero(self._visits) >= FILLED_MIN:
            self._turns.append(BinnedTurn(self._visits, self._sums, self._set_Nm))
            self.completed += 1
        self._begin()
        self._whole, self._entered_from = abs(step) == 1, step

    def _gather(self, block: Block, unwrapped_rad: Floats) -> None:
        place = (unwrapped_rad / (2 * np.pi) % 1 * POINTS).astype(int) % POINTS
        self._visits += np.bincount(place, minlength=POINTS)
        set_Nm, (low_Nm, high_Nm) = block["torque_set_Nm"], self._set_Nm
        self._set_Nm = min(low_Nm, float(set_Nm.min())), max(high_Nm, float(set_Nm.max()))
        for sums, name in zip(self._sums, SIGNALS, strict=True):
            sums += np.bincount(place, block[name], minlength=POINTS)


def _binned(visits: Floats, sums: Floats) -> Floats:
    """Return the mean in each of BINS bins, between those without ticks by straight lines."""
    count = visits.reshape(BINS, -1).sum(axis=1)
    filled = np.flatnonzero(count)
    mean = sums.reshape(BINS, -1).sum(axis=1)[filled] / count[filled]
    return np.asarray(np.interp(np.arange(BINS), filled, mean, period=BINS))
