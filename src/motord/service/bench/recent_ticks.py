"""The ticks of the last moments, as far as the account of a trip looks back on them."""

import math
from collections import deque

import numpy as np

from motord.config import Config

LEAST_S = 1.0


class RecentTicks:
    """Blocks of ticks of the last second, or of the longest time that an interlock waits.

    It also follows what the torque sensor should say: the set-point through its high-pass.
    """

    def __init__(self, config: Config) -> None:
        loop, tau_s = config.loop, config.torque_sensor.highpass_time_constant_s
        self._kept = round(
            loop.rate_Hz * max(LEAST_S, loop.enable_timeout_s, loop.supervisor_timeout_s)
        )
        self._decay_per_tick = math.exp(-1.0 / (loop.rate_Hz * tau_s)) if tau_s else 1.0
        self._blocks: deque[np.ndarray] = deque()
        self._expected_Nm = self._set_Nm = 0.0  # at the end of the block before the newest

    def add(self, block: np.ndarray) -> None:
        """Take in the next block of ticks, shape (n,), n > 0."""
        if self._blocks:
            newest = self._blocks[-1]
            self._expected_Nm = self._expect_Nm(newest)
            self._set_Nm = float(newest["torque_set_Nm"][-1])
        self._blocks.append(block)
        kept = sum(map(len, self._blocks))
        while len(self._blocks) > 1 and kept - len(self._blocks[0]) > self._kept:
            kept -= len(self._blocks.popleft())

    def forget(self) -> None:
        """Start anew."""
        self._blocks.clear()
        self._expected_Nm = self._set_Nm = 0.0

    def until(self, row: int) -> tuple[np.ndarray, float]:
        """Return the ticks up to `row` of the newest block, and the torque (Nm) expected before."""
        *earlier, newest = self._blocks
        return np.concatenate([*earlier, newest[: row + 1]]), self._expect_Nm(newest[:row])

    def _expect_Nm(self, ticks: np.ndarray) -> float:
        """Return what the sensor should say at the end of `ticks`, the first of the newest block.

        Their set-point counts as if it had changed at their end: a block is short.
        """
        if not len(ticks):
            return self._expected_Nm
        change_Nm = float(ticks["torque_set_Nm"][-1]) - self._set_Nm
        return float(self._decay_per_tick ** len(ticks)) * self._expected_Nm + change_Nm
