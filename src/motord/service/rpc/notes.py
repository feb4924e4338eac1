"""The RPC `note`: a remark with its time, among the events and in the recording."""

from collections.abc import Callable

from motord.api import requests as rpc
from motord.api.replies import NoteReply
from motord.service.host.events import EventLog
from motord.service.rpc.dispatcher import RpcContext, handles

KIND = "note"


class Notes:
    """Takes notes; `recording` returns the file that is being recorded, "" for none."""

    def __init__(self, events: EventLog, recording: Callable[[], str]) -> None:
        self._events = events
        self._recording = recording

    @handles(rpc.NOTE)
    def note(self, request: rpc.Note, context: RpcContext) -> NoteReply:
        """Emit the note as an event, which is published, kept and recorded."""
        event = self._events.emit(KIND, request.text, by=request.by)
        return NoteReply(t_ns=event.t_ns, recording=self._recording())
