"""Lines of text through pipes, without waiting and within bounds."""

import os
from collections import deque

LINE_MAX_BYTES = 1 << 20
READ_AT_ONCE_BYTES = 1 << 16
LINES_AT_ONCE = 64
"""A pipe full of short lines takes more than one look; none takes more than a few milliseconds."""


class LineReader:
    """Reads lines from a descriptor that does not block, a bounded amount at each call.

    `ended`: the writer has closed it, or it cannot be read. `received`: bytes so far. `overlong`:
    lines of more than `line_max_bytes`, which are left out.
    """

    def __init__(self, descriptor: int, line_max_bytes: int = LINE_MAX_BYTES) -> None:
        self._descriptor = descriptor
        self._line_max_bytes = line_max_bytes
        self._rest = b""
        self._skipping = False
        self.ended = False
        self.received = 0
        self.overlong = 0

    @property
    def pending(self) -> bool:
        """True if whole lines have been received and not been returned."""
        return b"\n" in self._rest

    def read(self) -> list[bytes]:
        """Return the next whole lines, at most `LINES_AT_ONCE`, without their ends."""
        if not self.pending:
            self._receive()
        if not self._rest:  # as at most looks
            return []
        *lines, self._rest = self._rest.split(b"\n", LINES_AT_ONCE)
        if self._skipping and lines:
            self._skipping = False
            del lines[0]  # the end of an overlong line
        if len(self._rest) > self._line_max_bytes and not self.pending:
            self.overlong += not self._skipping
            self._rest, self._skipping = b"", True
        elif self._skipping:
            self._rest = b""
        return lines

    def _receive(self) -> None:
        if self.ended:
            return
        try:
            piece = os.read(self._descriptor, READ_AT_ONCE_BYTES)
        except BlockingIOError:
            return
        except OSError:  # no more can come of it
            piece = b""
        self.ended = not piece
        self.received += len(piece)
        self._rest += piece


class LineWriter:
    """Writes lines to a descriptor that does not block, each whole or not at all.

    What is not taken at once is kept and written by later calls. Beyond `backlog_max_bytes` the
    oldest lines of which nothing has been written are dropped and counted in `dropped`. When the
    reader has gone, calls do nothing.
    """

    def __init__(self, descriptor: int, backlog_max_bytes: int) -> None:
        self._descriptor = descriptor
        self._backlog_max_bytes = backlog_max_bytes
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._begun = False  # part of the first one has been written
        self._gone = False
        self.dropped = 0

    @property
    def waiting(self) -> bool:
        """True if something has not been written yet."""
        return bool(self._waiting)

    def write(self, line: bytes) -> None:
        """Write a line, given without its end."""
        if self._gone:
            return
        self._waiting.append(line + b"\n")
        self._waiting_bytes += len(line) + 1
        while self._waiting_bytes > self._backlog_max_bytes and len(self._waiting) > self._begun:
            self._drop()
        self.flush()

    def flush(self) -> None:
        """Write what waits, as far as it is taken."""
        while self._waiting:
            try:
                written = os.write(self._descriptor, self._waiting[0])
            except BlockingIOError:
                return
            except OSError:
                self._give_up()
                return
            left = self._waiting[0][written:]
            self._waiting_bytes -= written
            self._begun = bool(left)
            if left:
                self._waiting[0] = left
            else:
                self._waiting.popleft()

    def _drop(self) -> None:
        begun = self._waiting.popleft() if self._begun else None
        self._waiting_bytes -= len(self._waiting.popleft())
        self.dropped += 1
        if begun is not None:
            self._waiting.appendleft(begun)

    def _give_up(self) -> None:
        self._gone, self._begun = True, False
        self._waiting.clear()
        self._waiting_bytes = 0
