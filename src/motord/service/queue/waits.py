"""What an item of the queue waits for: channels and times of day, one after the other.

Pure: times and values come from the caller, with every step of the supervisor.
"""

import math
from collections.abc import Callable
from datetime import datetime, timedelta

from motord.api.queue_messages import QueueWait

ChannelValue = Callable[[str], float | None]
"""Value of a channel by its name, None if there is no such channel, or it is broken or frozen."""
VALUELESS_S = 10.0
"""How long a channel may be without a value before the wait for it fails."""


class WaitFailedError(Exception):
    """A wait that cannot, or did not, come to its end; the message says why."""


class Waits:
    """Progress through the waits of an item whose turn came at `turn_ns` (Unix)."""

    def __init__(self, waits: tuple[QueueWait, ...], turn_ns: int) -> None:
        self._left = list(waits)
        self._turn_ns = turn_ns
        self._since_ns: int | None = None  # monotonic, of the present one
        self._valued_ns = 0  # monotonic, when the channel last had a value
        self.message = ""
        """What is waited for now."""

    def over(self, now_ns: int, unix_ns: int, value_of: ChannelValue) -> bool:
        """Return whether there is nothing left to wait for. Raises WaitFailedError.

        now_ns: monotonic.
        """
        while self._left:
            wait = self._left[0]
            if self._since_ns is None:
                self._since_ns = self._valued_ns = now_ns
            if not self._met(wait, now_ns, unix_ns, value_of):
                waited_s = (now_ns - self._since_ns) * 1e-9
                if wait.limit_s is not None and waited_s >= wait.limit_s:
                    raise WaitFailedError(f"waited {waited_s:.0f} s in vain: {self.message}")
                return False
            self._left.pop(0)
            self._since_ns = None
        self.message = ""
        return True

    def left_s(self, unix_ns: int) -> float:
        """Return how long the times of day have still to be waited for."""
        due_ns = [due(wait.until, self._turn_ns) for wait in self._left if wait.until is not None]
        return max([0.0, *((one - unix_ns) * 1e-9 for one in due_ns)])

    def _met(self, wait: QueueWait, now_ns: int, unix_ns: int, value_of: ChannelValue) -> bool:
        if wait.until is not None:
            due_ns = due(wait.until, self._turn_ns)
            self.message = f"waits until {datetime.fromtimestamp(due_ns / 1e9):%a %d %b %H:%M}"
            return unix_ns >= due_ns
        assert wait.channel is not None
        value = value_of(wait.channel)
        if value is None or not math.isfinite(value):
            self.message = f"waits for {wait.to_text()}; {valueless(wait.channel)}"
            if now_ns - self._valued_ns >= VALUELESS_S * 1e9:
                raise WaitFailedError(f"{valueless(wait.channel)} for {VALUELESS_S:g} s")
            return False
        self._valued_ns = now_ns
        self.message = f"waits for {wait.to_text()}; it is {value:.4g}"
        if wait.below is not None:
            return value < wait.below
        return wait.above is not None and value > wait.above


def valueless(channel: str) -> str:
    """Return the message about a channel without a value."""
    why = "there is none of that name, or it is broken or frozen"
    return f"channel {channel!r} has no valid value: {why}"


def due(until: str, turn_ns: int) -> int:
    """Return when a time of day, `HH:MM` local, next comes after `turn_ns`; both Unix ns."""
    turn = datetime.fromtimestamp(turn_ns / 1e9)
    hour, minute = map(int, until.split(":"))
    moment = turn.replace(hour=hour, minute=minute, second=0, microsecond=0)
    if moment <= turn:
        moment += timedelta(days=1)
    return round(moment.timestamp() * 1e9)
