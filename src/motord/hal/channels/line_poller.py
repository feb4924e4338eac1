"""Reading slow channels, each as often as it says: those of one line one after the other."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from motord.config import ChannelConfig
from motord.hal.base import DeviceError
from motord.hal.channel_source import ChannelReading, ChannelSource

OPEN_AGAIN_S = 1.0
"""Least time between two attempts to open a source."""
ERROR_MAX = 400
"""Characters of an error that are passed on."""


@dataclass
class _Turn:
    channel: ChannelConfig
    source: ChannelSource
    due_ns: int
    open: bool = False
    begun_ns: int | None = None

    @property
    def period_ns(self) -> int:
        return round(self.channel.period_s * 1e9)


class LinePoller:
    """The channels of one line; `put` takes what they say. One thread calls `step`."""

    def __init__(
        self,
        sources: list[tuple[ChannelConfig, ChannelSource]],
        put: Callable[[ChannelReading], None],
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._put = put
        self._clock_ns = clock_ns
        now_ns = clock_ns()
        self._turns = [_Turn(channel, source, now_ns) for channel, source in sources]

    def step(self) -> float:
        """Read what is due, the longest overdue first; return the time (s) until the next."""
        while (turn := min(self._turns, key=lambda one: one.due_ns)).due_ns <= self._clock_ns():
            self._read(turn)
        return max(turn.due_ns - self._clock_ns(), 0) * 1e-9

    def close(self) -> None:
        """Close the sources."""
        for turn in self._turns:
            turn.source.close()

    def _read(self, turn: _Turn) -> None:
        begun_ns = self._clock_ns()
        turn.due_ns = max(turn.due_ns + turn.period_ns, begun_ns)
        timeout_ns = round(turn.channel.timeout_s * 1e9)
        paused = turn.begun_ns is not None and begun_ns - turn.begun_ns > timeout_ns
        turn.begun_ns = begun_ns
        try:
            if not turn.open:
                turn.source.open()
                turn.open = True
            sample = turn.source.read()
            if sample is not None and not paused:  # what waited during a pause is old
                t_ns = begun_ns - round(max(sample.age_s, 0.0) * 1e9)
                self._put(ChannelReading(turn.channel.name, t_ns, float(sample.value)))
        except DeviceError as error:
            self._failed(turn, begun_ns, str(error))
        except BaseException as error:  # of a driver: the other channels must still be read
            self._failed(turn, begun_ns, f"error in its driver: {type(error).__name__}: {error}")

    def _failed(self, turn: _Turn, begun_ns: int, why: str) -> None:
        if not turn.open:
            turn.due_ns = max(turn.due_ns, begun_ns + round(OPEN_AGAIN_S * 1e9))
        turn.open = False
        self._put(ChannelReading(turn.channel.name, begun_ns, error=why[:ERROR_MAX]))
        with suppress(BaseException):  # of a driver that has failed anyway
            turn.source.close()
