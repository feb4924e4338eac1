"""The supervisor's end of the gateway process: its reports as events."""

from typing import Annotated

from pydantic import Field

from motord.process.allowance import Allowance
from motord.recorder.protocol import Message
from motord.service.host.child_pipes import ChildPipes
from motord.service.host.children import Children
from motord.service.host.events import EventLog

GATEWAY = "gate"
"""Its name in the state of the bench."""
EVENTS_PER_S, EVENTS_BURST = 5.0, 100.0
"""The gateway itself passes on 50 different messages in 10 s."""
MESSAGE_MAX, DATA_MAX = 2000, 1000
"""Characters of a message, and of each value of its data."""

Datum = Annotated[str, Field(max_length=DATA_MAX)]


class AccessData(Message):
    """Who connected, disconnected or was refused, as far as it is known."""

    who: Datum = ""
    where: Datum = ""
    role: Datum = ""
    action: Datum = ""
    key: Datum = ""
    reason: Datum = ""


class AccessMessage(Message):
    """A report of the gateway: message and data of the event; without a message it is none."""

    message: Annotated[str, Field(max_length=MESSAGE_MAX)]
    data: AccessData = AccessData()


class GatewayLink:
    """Emits the reports of the gateway as events. No call blocks."""

    def __init__(self, children: Children, events: EventLog) -> None:
        self._children = children
        self._events = events
        self._pipes = ChildPipes(GATEWAY, AccessMessage, children, events)
        self._allowance = Allowance(EVENTS_PER_S, EVENTS_BURST)
        self._left_out = 0

    def step(self, now_ns: int) -> None:
        """Emit the reports that came since the last call. `now_ns` is monotonic."""
        self._pipes.opened()
        for message in self._pipes.messages(now_ns):
            if message.message:
                self._emit(message, now_ns)
        if not self._pipes.closed():
            self._pipes.end_if_silent(now_ns)

    def _emit(self, message: AccessMessage, now_ns: int) -> None:
        """Emit a message as an event, or count it if more come than EVENTS_PER_S."""
        if not self._allowance.spend(1.0, now_ns):
            self._left_out += 1
            return
        more = f" ({self._left_out} left out before)" if self._left_out else ""
        self._left_out = 0
        data = message.data.model_dump(exclude_unset=True)
        self._events.emit("access", message.message + more, **data)

    def stop(self, now_ns: int) -> None:
        """End the gateway process: no further client gets in."""
        self._children.stop(GATEWAY)
        self.step(now_ns)
