"""A run of an item of the queue, from the preparation of its plan until that has begun."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from motord.api.errors import RpcError
from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueuedPlan, QueueItem
from motord.service.host.log import log_error

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
            raise NotStartedError(refusal.message) from None
        except BaseException as error:  # of a plan's own program
            raise NotStartedError(log_error(f"in preparing {self.item.plan.name}", error)) from None
        try:
            begin(holder, detached)
        except RpcError as refusal:
            self.refused_ns = now_ns if self.refused_ns is None else self.refused_ns
            if now_ns - self.refused_ns >= REFUSED_NS:
                raise NotStartedError(refusal.message) from None
            self.again_ns = now_ns + AGAIN_NS
            return refusal.message
        return ""
