"""The daemon's log on stderr, written by a thread of its own: a stuck terminal stops nobody."""

import logging
import logging.handlers
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager

CAPACITY = 1000
FORMAT = "%(asctime)s %(levelname)s %(message)s"


class _DroppingHandler(logging.handlers.QueueHandler):
    """Puts records into a queue; drops those for which there is no room."""

    def enqueue(self, record: logging.LogRecord) -> None:
        """Put a record, or drop it."""
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            return


def log_error(where: str, error: Exception) -> str:
    """Log an error of the program itself with its traceback; return it in a line."""
    said = f"error in the program, {where}: {type(error).__name__}: {error}"
    logging.getLogger("motord").error("%s", said, exc_info=error)
    return said


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """Log what `motord` loggers say, from INFO on, to stderr."""
    logger = logging.getLogger("motord")
    stream = logging.StreamHandler(sys.stderr)
    stream.setFormatter(logging.Formatter(FORMAT))
    records: queue.Queue[logging.LogRecord] = queue.Queue(CAPACITY)
    handler = _DroppingHandler(records)
    listener = logging.handlers.QueueListener(records, stream)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    listener.start()
    try:
        yield
    finally:
        listener.stop()
        logger.removeHandler(handler)
        logger.setLevel(level)
