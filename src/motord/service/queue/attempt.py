"""A run of an item of the queue: what it waits for one after the other, and its start.

The waits are pure: times and values come from the caller, with every step of the supervisor.
"""

import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Protocol

from motord.api.errors import RpcError
from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueuedPlan, QueueItem, QueueWait
from motord.service.host.log import log_error

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


REFUSED_NS = 30_000_000_000
"""A plan whose start is refused is tried again for so long: a recorder may be starting."""
AGAIN_NS = 1_000_000_000

BeginPlan = Callable[[str, bool], None]
"""Begins a plan for a holder, detached or not. Raises RpcError."""


class QueuedPlanStarter(Protocol):
    """What of the plans the queue needs."""

    def prepare_queued(self, plan: QueuedPlan, run_id: str, *, resume: bool) -> BeginPlan:
        """Return what begins a plan, or the rest of an earlier run; for any thread."""

    def run_of(self, run_id: str) -> PlanView | None:
        """Return the run if it is the one in the journal."""


class NotStartedError(Exception):
    """A plan that cannot begin; the message says why."""


@dataclass
class Attempt:
    """A run of `item`, which is as it was before. `began_ns`: Unix, 0 until the plan has begun."""

    item: QueueItem
    run_id: str
    prepared: "Future[BeginPlan]"
    saved: bool = False
    began_ns: int = 0
    again_ns: int = 0
    refused_ns: int | None = None

    def begin(self, holder: str, now_ns: int, *, detached: bool) -> str:
        """Begin the prepared plan; return "", or why it has to be tried again later.

        now_ns: monotonic. Raises NotStartedError if it cannot be prepared, or is refused for long.
        """
        try:
            begin = self.prepared.result()
        except RpcError as refusal:
            raise NotStartedError(_why(refusal)) from None
        except BaseException as error:  # of a plan's own program
            raise NotStartedError(log_error(f"in preparing {self.item.plan.name}", error)) from None
        try:
            begin(holder, detached)
        except RpcError as refusal:
            self.refused_ns = now_ns if self.refused_ns is None else self.refused_ns
            if now_ns - self.refused_ns >= REFUSED_NS:
                raise NotStartedError(_why(refusal)) from None
            self.again_ns = now_ns + AGAIN_NS
            return _why(refusal)
        return ""


def _why(refusal: RpcError) -> str:
    """Return why a plan is not started, without saying again that it is not."""
    return refusal.message.removeprefix("not started: ")
