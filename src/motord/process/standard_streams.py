"""Standard output and error of a command whose reader, terminal or disk may go away."""

import errno
import io
import os
import select
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

_GONE = (errno.EPIPE, errno.EIO, errno.ENXIO)
"""Errors of a write without a reader any more: a closed pipe, a closed terminal."""


class _Descriptor(io.FileIO):
    """A standard stream whose writes never fail; `lost` says why some did not get through.

    That there is no reader any more is no loss.
    """

    lost = ""

    def write(self, data: Any) -> int:
        try:
            return os.write(self.fileno(), data)
        except OSError as error:
            if error.errno not in _GONE:
                self.lost = error.strerror or str(error)
            return len(data)


def outlive_readers() -> None:
    """Let no closed pipe or terminal break a command off, least of all one that ramps down.

    Nor a locale that lacks a character, such as of a motor's name: it is written as an escape.
    """
    open_closed_descriptors()
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    sys.stdout = _lasting(sys.stdout)
    sys.stderr = _lasting(sys.stderr)


def open_closed_descriptors() -> None:
    """Let standard streams that were closed before the start lead to /dev/null, for children, too.

    Else the next file that is opened gets the number of one: what a library writes on standard
    error would stand in a recording, and a child could not say why it ends.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def lost_output() -> str:
    """Return why part of the result could not be written, "" if it was or has no reader."""
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.lost if isinstance(raw, _Descriptor) else ""


def _lasting(stream: TextIO | None) -> TextIO:
    if stream is None:  # closed before the start
        return Path(os.devnull).open("w")
    raw = _Descriptor(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=raw.isatty() or stream is sys.stderr,
    )


def nobody_reads() -> bool:
    """Return whether the other end of stdout is closed: what streams may end then."""
    with suppress(OSError, ValueError):
        poll = select.poll()
        poll.register(sys.stdout.fileno(), 0)
        return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))
    return False
