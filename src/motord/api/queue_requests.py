"""The RPCs of the queue of plans."""

from typing import Annotated

from pydantic import Field

from motord.api.queue_messages import PLANS_MAX, QueuedPlan, QueueItem, QueueRun, QueueView
from motord.api.replies import RpcReply
from motord.api.request_base import NoArguments, Rpc, WithToken

ItemIds = Annotated[list[int], Field(min_length=1, max_length=1024)]


class QueueAdd(WithToken):
    """`queue/add`: plans, each checked as for `plan/start`; all of them are added, or none."""

    plans: Annotated[list[QueuedPlan], Field(min_length=1, max_length=PLANS_MAX)]
    """In order."""


class QueueMove(WithToken):
    """`queue/move`."""

    id: int
    """Number of the item."""
    position: Annotated[int, Field(ge=1)]
    """Its new place among those that are not under way: 1 is the next one."""


class QueueRemove(WithToken):
    """`queue/remove`."""

    ids: ItemIds
    """Numbers of the items."""


class QueueStart(WithToken):
    """`queue/start`."""

    detach: bool = False
    """The queue goes on when the lease ends."""


class QueuePause(WithToken):
    """`queue/pause`."""

    now: bool = False
    """Pause the plan under way, too; else it runs to its end."""


class QueueContent(RpcReply):
    """`queue/list` and all that changes the queue: all of it, once the disk has it."""

    queue: QueueView
    """In short, as in the state."""
    items: list[QueueItem]
    """In order, the one under way first."""
    history: list[QueueRun]
    """Runs that have ended, the newest last."""
    added: list[int] = Field(default_factory=list)
    """Numbers of the new items, of `queue/add`."""


QUEUE_ADD = Rpc("queue/add", QueueAdd, QueueContent, "Put plans at the end of the queue.")
QUEUE_MOVE = Rpc("queue/move", QueueMove, QueueContent, "Give an item another place.")
QUEUE_REMOVE = Rpc(
    "queue/remove", QueueRemove, QueueContent, "Take items out; not the one under way."
)
QUEUE_START = Rpc(
    "queue/start", QueueStart, QueueContent,
    "Run the plans one after the other, or go on after a pause.",
)  # fmt: skip
QUEUE_PAUSE = Rpc("queue/pause", QueuePause, QueueContent, "Begin no further plan.")
QUEUE_LIST = Rpc("queue/list", NoArguments, QueueContent, "The queue, its items and its history.")
