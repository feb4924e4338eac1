"""The newest ticks, as far back as the report of a trip needs them, and what the links are by them.

The ticks count the errors of both links together; which link lacks frames shows in the ticks
without a new sample of it.
"""

from collections import deque
from collections.abc import Callable

import numpy as np

from motord.api.descriptions import bridge_action
from motord.api.messages import LinksView
from motord.config import Config
from motord.control import parameters
from motord.schema import BridgeStatus, Flag, InverterStatus, as_bytes, joined
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


LastSecond = Callable[[str], np.ndarray]
"""Returns a field of the ticks of the last second, shape (n,), n > 0."""


def ages_s(last_second: LastSecond, rate_Hz: float, tick_age_s: float) -> dict[str, float]:
    """Return the age (s) of each signal now, `tick_age_s` after the newest tick was read.

    What was not good in any tick of the last second is at least so old.
    """
    bridge, seq = last_second("bridge_status"), last_second("setpoint_seq")
    sample_age_ns = last_second("sample_age_ns")

    def sampled_s(good: np.ndarray) -> float:
        """Return the age of the newest good sample, of the oldest if there is none."""
        back = _newest(good)
        return tick_age_s + back / rate_Hz + 1e-9 * int(sample_age_ns[-1 - back])

    current_age_ns = int(sample_age_ns[-1]) + int(last_second("i_age_ns")[-1])
    found = {
        "tick": tick_age_s,
        "encoder": sampled_s(bridge & int(BridgeStatus.ENCODER_INVALID) == 0),
        "torque": sampled_s(bridge & int(BridgeStatus.TORQUE_INVALID) == 0),
        "inverter": tick_age_s + 1e-9 * current_age_ns,
        "heartbeat": tick_age_s + _newest(seq[1:] != seq[:-1]) / rate_Hz,
    }
    return {name: round(age_s, 6) for name, age_s in found.items()}


def _newest(good: np.ndarray) -> int:
    """Return how many ticks ago the newest good one is; the oldest of all if there is none."""
    if not good.any():
        return max(len(good) - 1, 0)
    return int(np.argmax(good[::-1]))


def links(last_second: LastSecond) -> LinksView:
    """Return the errors of both links, and ticks without a new sample or feedback."""
    errors, flags = last_second("link_errors"), last_second("flags")
    status = int(last_second("inverter_status")[-1])
    return LinksView(
        errors=int(errors[-1]),
        errors_last_s=int(errors[-1]) - int(errors[0]),
        ticks_last_s=len(flags),
        without_encoder_last_s=int(np.count_nonzero(flags & int(Flag.NEW_ENCODER) == 0)),
        without_inverter_last_s=int(np.count_nonzero(flags & int(Flag.NEW_INVERTER) == 0)),
        bus_off=bool(status & InverterStatus.BUS_OFF),
        bridge=bridge_action(int(np.bitwise_or.reduce(last_second("bridge_status")))),
    )
