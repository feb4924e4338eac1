"""What the daemon publishes, put by a thread of its own.

The supervisor puts it into a bounded queue and goes on; a full one loses its oldest entry, counted.
So neither a slow network nor a stopped subscriber reaches the supervisor.
"""

import threading
from collections import deque
from collections.abc import Callable

import numpy as np

from motord.process.ending_threads import start_thread
from motord.schema import TICK
from motord.service.host.log import log_error
from motord.wire.ticks.blocks import BlockCodec

CAPACITY = 512
STOP_S = 2.0

Put = Callable[[str, bytes], None]
"""Publishes a payload under the name of a key; may block for a while."""


class Telemetry:
    """Blocks of ticks and JSON documents on their way out.

    Each tick goes out once under `ticks`, in blocks of `block_s`, and every so many-th one under
    `tick`, so that `tick_rate_Hz` come out of `rate_Hz`.
    """

    def __init__(self, put: Put, rate_Hz: float, tick_rate_Hz: float, block_s: float) -> None:
        self._put = put
        self._codec = BlockCodec(TICK)
        self._every = max(1, round(rate_Hz / tick_rate_Hz))
        self._block_ticks = max(1, round(rate_Hz * block_s))
        self._queue: deque[np.ndarray | tuple[str, bytes]] = deque()
        self._changed = threading.Condition()
        self._stopping = False
        self._failing = False
        self._pending: list[bytes] = []  # messages of `ticks`, which are one if they are joined
        self._pending_ticks = 0
        self.dropped = 0
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread. Raises NoThreadError."""
        self._thread = start_thread(self._run, "motord-telemetry")

    def stop(self) -> None:
        """Publish what is waiting, as far as a moment suffices, and end the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(STOP_S)

    def ticks(self, block: np.ndarray) -> None:
        """Queue a block of ticks (shape (n,)), which must not be changed any more."""
        if len(block):
            self._enqueue(block)

    def json(self, name: str, document: bytes) -> None:
        """Queue a JSON document for key `name`."""
        self._enqueue((name, document))

    def _enqueue(self, item: np.ndarray | tuple[str, bytes]) -> None:
        with self._changed:
            if len(self._queue) >= CAPACITY:
                self._queue.popleft()
                self.dropped += 1
            self._queue.append(item)
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._queue and not self._stopping:
                    self._changed.wait()
                if not self._queue:
                    break
                item = self._queue.popleft()
            self._publish(item)
        self._flush()

    def _publish(self, item: np.ndarray | tuple[str, bytes]) -> None:
        try:
            if isinstance(item, tuple):
                self._put(*item)
            else:
                self._take_ticks(item)
        except BaseException as error:  # what cannot be published must not end all telemetry
            if not self._failing:
                log_error("in the telemetry", error)
            self._failing = True
            self._pending, self._pending_ticks = [], 0
            self.dropped += 1
        else:
            self._failing = False

    def _take_ticks(self, block: np.ndarray) -> None:
        listed, size = self._codec.encode_list(block), self._codec.size
        numbers = block["tick"].tolist()  # so few: as an array they take ten times as long
        for row, tick in enumerate(numbers):
            if tick % self._every == 0:
                end = (row + 1) * len(listed) // len(block)
                self._put("tick", listed[end - size : end])  # as it is in the list
        self._pending.append(listed)
        self._pending_ticks += len(block)
        if self._pending_ticks >= self._block_ticks:
            self._flush()

    def _flush(self) -> None:
        if self._pending:
            self._put("ticks", b"".join(self._pending))
            self._pending, self._pending_ticks = [], 0
