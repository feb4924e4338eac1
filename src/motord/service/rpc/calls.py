"""A request on its way to the supervisor, and its answer on the way back."""

import queue
import threading
from collections.abc import Callable, Mapping
from typing import Any

from motord.api.errors import RpcError
from motord.api.requests import RpcRequest

Answer = Mapping[str, Any]
Outcome = Answer | RpcError


def _nobody(outcome: Outcome) -> None:
    """Tell nobody: whoever brought the call waits for it."""


class Call:
    """One request. The supervisor answers it once.

    `prepared` is what was made of the request beforehand, because it takes long. `on_answer` is
    called with the answer in the supervisor's thread and must not wait.
    """

    def __init__(
        self,
        name: str,
        request: RpcRequest,
        prepared: Any = None,
        on_answer: Callable[[Outcome], None] = _nobody,
    ) -> None:
        self.name = name
        self.request = request
        self.prepared = prepared
        self._on_answer = on_answer
        self._answered = threading.Event()
        self._answer: Outcome | None = None

    def answer(self, answer: Outcome) -> None:
        """Answer the call, or refuse it; only the first answer counts."""
        if not self._answered.is_set():
            self._answer = answer
            self._answered.set()
            self._on_answer(answer)

    def wait(self, timeout_s: float) -> Answer:
        """Return the answer. Raises RpcError, also if none comes within `timeout_s`."""
        if not self._answered.wait(timeout_s):
            raise RpcError("busy", f"{self.name}: no answer from the supervisor in {timeout_s:g} s")
        if isinstance(self._answer, RpcError):
            raise self._answer
        return self._answer or {}


class CallQueue:
    """Bounded queue of calls, filled by any thread, emptied by the supervisor."""

    CAPACITY = 128

    def __init__(self) -> None:
        self._queue: queue.Queue[Call] = queue.Queue(self.CAPACITY)
        self._closed = ""

    def put(self, call: Call) -> None:
        """Hand over a call without waiting. Raises RpcError if there are too many, or no more."""
        if self._closed:
            raise RpcError("refused", self._closed)
        try:
            self._queue.put_nowait(call)
        except queue.Full:
            raise RpcError("busy", f"{self.CAPACITY} requests are waiting; try again") from None

    def take(self) -> list[Call]:
        """Return the calls that are waiting."""
        calls = []
        while True:
            try:
                calls.append(self._queue.get_nowait())
            except queue.Empty:
                return calls

    def close(self, why: str) -> None:
        """Refuse those that wait, and all that come later."""
        self._closed = why
        for call in self.take():
            call.answer(RpcError("refused", why))
