"""The queue of plans of the stand-in: the daemon's own list, run by hand."""

from collections.abc import Callable, Sequence
from typing import Any

from motord.api.errors import RpcError
from motord.api.queue_messages import QueuedPlan, QueueRun, QueueView
from motord.client import ClientError
from motord.service.queue.plan_queue import PlanQueue

ESTIMATE_s = 96.0
END_NS = 1_767_258_000_000_000_000


class StandInQueue:
    """Answers `queue/...`; `emit` publishes an event of the queue."""

    def __init__(self, emit: Callable[[str], None]) -> None:
        self.queue = PlanQueue()
        self.view = QueueView()
        self._emit = emit
        self.requests: dict[str, Callable[..., dict[str, Any]]] = {
            "list": self.content, "add": self.add, "move": self.move, "remove": self.remove,
            "start": self.start, "pause": self.pause,
        }  # fmt: skip

    def content(self, token: str = "") -> dict[str, Any]:
        """Return all of it; of plans what was given, as the daemon does."""
        items = [item.model_dump(mode="json", exclude_unset=True) for item in self.queue.items]
        history = [run.model_dump(mode="json") for run in self.queue.history]
        return {"queue": self.view.model_dump(), "items": items, "history": history, "added": []}

    def add(
        self, plans: Sequence[dict[str, Any]], by: str = "anna", token: str = ""
    ) -> dict[str, Any]:
        """Add plans."""
        new = [(QueuedPlan.model_validate(plan), ESTIMATE_s) for plan in plans]
        self._change(self.queue.added(new, by), "added")
        return {**self.content(), "added": [item.id for item in self.queue.items[-len(new) :]]}

    def move(self, id: int, position: int, token: str) -> dict[str, Any]:
        """Give an item another place."""
        return self._edit(lambda: self.queue.moved(id, position), "moved")

    def remove(self, ids: list[int], token: str) -> dict[str, Any]:
        """Take items out."""
        return self._edit(lambda: self.queue.without(ids), "removed")

    def start(self, token: str, detach: bool = False) -> dict[str, Any]:
        """Begin with the first item."""
        self.show(state="running", running=self.queue.items[0].id, detached=detach, message="")
        self._change(self.queue.with_first(state="running"), "started")
        return self.content()

    def pause(self, token: str, now: bool = False) -> dict[str, Any]:
        """Begin no further plan."""
        self.show(state="pausing" if self.queue.running else "paused", message="by anna")
        self._emit("paused")
        return self.content()

    def end(self, state: str, message: str = "", recording: str = "") -> None:
        """Let the plan under way end, which pauses the queue."""
        item = self.queue.items[0]
        run = {"id": item.id, "plan": item.plan.name, "state": state, "message": message}
        ended = QueueRun.model_validate({**run, "ended_ns": END_NS, "recording": recording})
        self.show(state="paused", running=None, done=self.view.done + (state == "done"))
        self._change(self.queue.ended(ended), f"{item.id} {state}")

    def show(self, **changes: Any) -> None:
        """Change what the state says of it."""
        self.view = self.view.model_copy(update=changes)

    def _edit(self, made: Callable[[], PlanQueue], what: str) -> dict[str, Any]:
        try:
            self._change(made(), what)
        except RpcError as error:
            raise ClientError(error.code, error.message) from None
        return self.content()

    def _change(self, queue: PlanQueue, what: str) -> None:
        self.queue = queue
        eta_s = sum(item.estimate_s for item in queue.items)
        self.show(length=len(queue.items), eta_s=eta_s)
        self._emit(what)
