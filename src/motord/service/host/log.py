"""The daemon's log on stderr, written by a thread of its own: a stuck terminal blocks no other."""

import logging
import logging.handlers
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial

from motord.process.ending_threads import start_thread

CAPACITY = 1000
STOP_S = 2.0
"""How long the end waits for what is still to be written: a stuck terminal takes for ever."""
FORMAT = "%(asctime)s %(levelname)s %(message)s"


class _DroppingHandler(logging.handlers.QueueHandler):
    """Puts records into a queue; drops those for which there is no room."""

    def enqueue(self, record: logging.LogRecord) -> None:
        """Put a record, or drop it."""
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            return


def log_error(where: str, error: BaseException) -> str:
    """Log an error of the program itself with its traceback; return it in a line.

    A panic of a library in Rust (Zenoh, pydantic) is a BaseException but no Exception, and so is
    what `sys.exit()` raises in a plan or a driver: threads that have to go on catch those, too.
    """
    line = f"error in the program, {where}: {type(error).__name__}: {error}"
    logging.getLogger("motord").error("%s", line, exc_info=error)
    return line


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """Log what `motord` loggers say, from INFO on, to stderr."""
    logger = logging.getLogger("motord")
    stream = logging.StreamHandler(sys.stderr)
    stream.setFormatter(logging.Formatter(FORMAT))
    records: queue.Queue[logging.LogRecord | None] = queue.Queue(CAPACITY)
    handler = _DroppingHandler(records)
    writer = start_thread(partial(_write, records, stream), "log")
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        with suppress(queue.Full):
            records.put(None, timeout=STOP_S)
        writer.join(STOP_S)


def _write(records: "queue.Queue[logging.LogRecord | None]", stream: logging.Handler) -> None:
    """Write records until there is None."""
    while (record := records.get()) is not None:
        stream.handle(record)
