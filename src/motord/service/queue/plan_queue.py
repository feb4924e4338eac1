"""The items of the queue and the history of their runs: every change gives a new queue.

An item leaves the queue when its plan is done, when it has failed and is to be skipped, or when
somebody removes it; until then it is in it once. Only the first item runs.
"""

from collections.abc import Collection, Sequence
from typing import Any, Self

from pydantic import BaseModel, Field, model_validator

from motord.api.errors import RpcError
from motord.api.queue_messages import QueuedPlan, QueueItem, QueueRun

FORMAT = 1
ITEMS_MAX = 256
HISTORY_MAX = 200


class PlanQueue(BaseModel, extra="ignore", frozen=True):
    """The queue as it is on the disk."""

    format: int = Field(default=FORMAT, ge=FORMAT, le=FORMAT)
    next_id: int = 1
    items: tuple[QueueItem, ...] = ()
    history: tuple[QueueRun, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        ids = [item.id for item in self.items]
        if len(set(ids)) < len(ids) or max(ids, default=0) >= self.next_id:
            raise ValueError("numbers of items are not unique")
        if any(item.state == "running" for item in self.items[1:]):
            raise ValueError("an item is under way that is not the first")
        return self

    @property
    def first(self) -> QueueItem | None:
        """The item that runs, or is the next to run."""
        return self.items[0] if self.items else None

    @property
    def running(self) -> QueueItem | None:
        """The item under way."""
        first = self.first
        return first if first is not None and first.state == "running" else None

    def added(self, plans: Sequence[tuple[QueuedPlan, float]], by: str) -> Self:
        """Return the queue with plans, each with its estimate (s), at its end. Raises RpcError."""
        if len(self.items) + len(plans) > ITEMS_MAX:
            raise RpcError("refused", f"the queue has no room for more than {ITEMS_MAX} plans")
        new = tuple(
            QueueItem(
                id=self.next_id + n, plan=plan, estimate_s=estimate_s, added_by=by,
                state="queued", failures=0, run_id="", turn_ns=0,
            )
            for n, (plan, estimate_s) in enumerate(plans)
        )  # fmt: skip
        return self._with(items=self.items + new, next_id=self.next_id + len(new))

    def moved(self, id: int, position: int) -> Self:
        """Return the queue with an item at `position`, 1 being the next to run. Raises RpcError.

        One that is moved begins to wait anew.
        """
        [item] = self._editable([id])
        fixed = (self.running,) if self.running else ()
        others = [one for one in self.items[len(fixed) :] if one.id != id]
        others.insert(position - 1, item.model_copy(update={"turn_ns": 0}))
        return self._with(items=(*fixed, *others))

    def without(self, ids: Collection[int]) -> Self:
        """Return the queue without some items. Raises RpcError."""
        self._editable(ids)
        return self._with(items=tuple(item for item in self.items if item.id not in ids))

    def with_first(self, **changes: Any) -> Self:
        """Return the queue with its first item changed."""
        first, *others = self.items
        return self._with(items=(first.model_copy(update=changes), *others))

    def ended(self, run: QueueRun, *, retry: bool = True) -> Self:
        """Return the queue after a run of its first item.

        It leaves the queue, or goes on being the first. retry: False if its policy for failures
        does not count, as the bench itself is in the way.
        """
        item = self.items[0]
        failed = run.state == "failed" and retry
        leaves = run.state == "done" or (failed and item.plan.on_failure == "skip")
        history = (*self.history, run.model_copy(update={"kept": not leaves}))[-HISTORY_MAX:]
        if leaves:
            return self._with(items=self.items[1:], history=history)
        again = failed and item.plan.on_failure == "retry" and item.failures < item.plan.retries
        changes: dict[str, Any] = {"state": "queued" if again else run.state}
        if run.state == "failed":
            changes["failures"] = item.failures + 1
        return self._with(history=history).with_first(**changes)

    def _editable(self, ids: Collection[int]) -> list[QueueItem]:
        """Return the items of these numbers. Raises RpcError if one is not there or under way."""
        running = self.running
        if running is not None and running.id in ids:
            why = f"{running.id}: {running.plan.name} is under way; abort it, or wait for its end"
            raise RpcError("refused", why)
        known = {item.id: item for item in self.items}
        missing = [str(id) for id in ids if id not in known]
        if missing:
            raise RpcError("refused", f"not in the queue: {', '.join(missing)}")
        return [known[id] for id in ids]

    def _with(self, **changes: Any) -> Self:
        return self.model_copy(update=changes)
