"""A plan on a daemon, as an iterable of its progress."""

from collections import deque
from collections.abc import Generator
from typing import Protocol

from motord.api.plan_messages import PlanView
from motord.client.error import ClientError, PlanEndedError
from motord.client.subscription import DocumentSubscription

SILENT_S = 1.0
"""A plan under way publishes ten times a second: after so long without progress it is asked for."""


class PlanPublisher(Protocol):
    """What of a client a plan is followed by."""

    def plan(self) -> PlanView | None:
        """Return the progress of the plan under way or of the last one."""

    def subscribe_plan(self) -> DocumentSubscription[PlanView]:
        """Receive the progress of plans, the present one first."""


class PlanRun:
    """One run of a plan. Iterating yields its progress until it is over, then ends.

    If it was not done but aborted, failed or interrupted, iterating ends with PlanEndedError; with
    ClientError if the daemon cannot be reached. It may be iterated again, and begins with the
    progress of that moment; to stop iterating does not stop the plan.

    >>> with client.lease("anna") as lease:
    ...     run = lease.run_plan("cogging")
    ...     for progress in run:
    ...         if progress.state == "running":
    ...             break
    ...     lease.abort_plan().state
    ...     try:
    ...         run.wait()
    ...     except PlanEndedError as ended:
    ...         print(ended)
    'ending'
    cogging aborted: aborted by anna
    """

    def __init__(self, source: PlanPublisher, run_id: str) -> None:
        self.run_id = run_id
        self._source = source

    def __iter__(self) -> Generator[PlanView, None, None]:
        """Yield progress ten times a second, and at last that of the end."""
        with self._source.subscribe_plan() as coming:
            while True:
                progress = coming.get(SILENT_S) or self._source.plan()
                if progress is None or progress.run_id != self.run_id:
                    raise ClientError(
                        "unknown", "this plan is over, and how it ended is not known here any more"
                    )
                yield progress
                if progress.over:
                    break
        if progress.state != "done":
            raise PlanEndedError(progress)

    def wait(self) -> PlanView:
        """Wait until the plan is done; return its last progress. Raises as iterating does."""
        return deque(self, maxlen=1)[0]  # the rest is let go: hours of progress are much
