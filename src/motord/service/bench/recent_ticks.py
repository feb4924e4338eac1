"""The newest ticks, as far back as the report of a trip needs them."""

from collections import deque

import numpy as np

from motord.config import Config
from motord.control import parameters
from motord.schema import as_bytes, joined
from motord.service.bench.trip_report import TripWindow

LEAST_S = 1.0


class RecentTicks:
    """Blocks of ticks of the last second, or of the longest time that an interlock waits.

    It also follows what the torque sensor should show: the set-point through its high-pass.
    """

    def __init__(self, config: Config) -> None:
        loop = config.loop
        self._rate_Hz = loop.rate_Hz
        self._kept = round(
            loop.rate_Hz * max(LEAST_S, loop.enable_timeout_s, loop.supervisor_timeout_s)
        )
        self._parameters: np.record = parameters.build(config)[0][0]
        self._decay = float(self._parameters.torque_decay)  # in one tick
        self._blocks: deque[np.ndarray] = deque()
        self._bytes: deque[np.ndarray] = deque()  # the same, as they are joined
        self._count = 0  # of the ticks in the blocks
        self._second: np.ndarray | None = None  # ticks of the last second, once asked for
        self._expected_Nm = self._set_Nm = 0.0  # at the end of the block before the newest
        self._tick: int | None = None  # the last of that block

    def add(self, block: np.ndarray) -> None:
        """Take in the next block of ticks, shape (n,), n > 0."""
        if self._blocks:
            newest = self._blocks[-1]
            self._expected_Nm = self._expect_Nm(newest)
            self._set_Nm = float(newest["torque_set_Nm"][-1])
            self._tick = int(newest["tick"][-1])
        self._blocks.append(block)
        self._bytes.append(as_bytes(block))
        self._second = None
        self._count += len(block)
        while self._count - len(self._blocks[0]) > self._kept:
            self._count -= len(self._blocks.popleft())
            self._bytes.popleft()

    def last_second(self, name: str) -> np.ndarray:
        """Return a field of the ticks of the last second, shape (n,)."""
        if self._second is None:  # joined once: a state needs ten fields of a hundred blocks
            parts, count = [], 0
            for block in reversed(self._bytes):
                parts.append(block)
                count += len(block)
                if count >= self._rate_Hz:
                    break
            self._second = np.concatenate(parts[::-1]).view(self._blocks[-1].dtype)
        second: np.ndarray = self._second[name]
        return second

    def forget(self) -> None:
        """Start anew."""
        self._blocks.clear()
        self._bytes.clear()
        self._count, self._second = 0, None
        self._expected_Nm, self._set_Nm, self._tick = 0.0, 0.0, None

    def until(self, row: int) -> TripWindow:
        """Return the ticks up to `row` of the newest block."""
        *earlier, newest = self._blocks
        ticks = joined([*earlier, newest[: row + 1]])
        return TripWindow(ticks, self._expect_Nm(newest[:row]), self._parameters)

    def _expect_Nm(self, ticks: np.ndarray) -> float:
        """Return what the sensor should show at the end of `ticks`, the first of the newest block.

        Their set-point counts as if it had changed at their end: a block is short.
        """
        if not len(ticks):
            return self._expected_Nm
        change_Nm = float(ticks["torque_set_Nm"][-1]) - self._set_Nm
        before = int(ticks["tick"][0]) - 1 if self._tick is None else self._tick
        passed = int(ticks["tick"][-1]) - before  # the loop may have missed some
        return self._decay ** max(passed, 0) * self._expected_Nm + change_Nm
