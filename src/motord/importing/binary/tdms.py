"""LabVIEW's TDMS as a source of rows.

Channels are copied one after the other into a scratch file, which is then read row by row: in
memory is a piece of one channel at a time (all of it only where LabVIEW wrote it in one piece).
"""

import logging
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np

from motord.importing.mapping import TdmsMap
from motord.importing.source import ColumnSource, RowClock, WantedColumn, readable, readable_as
from motord.recording.errors import RecordError
from motord.recording.export.optional_packages import optional

MAGIC = b"TDSm"

PIECE = 1 << 20
"""Values of a channel that are read at once, unless there would be more than PIECES."""

PIECES = 64

WARNING_LENGTH = 120

INCREMENT, START = "wf_increment", "wf_start_time"


class TdmsSource(ColumnSource):
    """A TDMS file, open with its scratch files, in the folder `scratch`, as long as `opened`.

    Raises RecordError for a file that is not TDMS, and where npTDMS is not installed.
    """

    def __init__(self, path: Path, options: TdmsMap, scratch: Path, opened: ExitStack) -> None:
        self.path = path
        self._opened = opened
        self._group = options.group
        self._scratch = scratch
        self._spools: dict[int, FileIO] = {}
        self.notes: list[str] = []
        if not begins_as_tdms(path):
            raise RecordError(f"{path}: does not begin as a TDMS file does")
        needed = "TDMS", "npTDMS", "tdms", "save the file as CSV"
        nptdms, log = (optional(module, *needed) for module in ("nptdms", "nptdms.log"))
        warnings, console = _Warnings(self.notes), log.log_manager.console_handler
        console.addFilter(warnings)
        opened.callback(console.removeFilter, warnings)
        with readable_as(path, "a TDMS"):
            file = opened.enter_context(nptdms.TdmsFile.open(opened.enter_context(path.open("rb"))))
            self._channels = [c for group in file.groups() for c in group.channels()]
            self._lengths = [len(channel) for channel in self._channels]
        self._rows = min(self._lengths, default=0)
        self.names = tuple(f"{c.group_name}/{c.name}" for c in self._channels)

    def row_clock(self, columns: Sequence[int]) -> RowClock | None:
        """Return the clock of the waveforms among the channels. Raises RecordError if they differ.

        wf_increment is the time between values, wf_start_time that of the first.
        """
        found, first = None, 0
        for index in columns:
            properties = self._channels[index].properties
            period_s = properties.get(INCREMENT)
            if not isinstance(period_s, int | float) or not 0 < period_s < float("inf"):
                continue
            start_ns = _unix_ns(properties.get(START))
            if found is None:
                found, first = RowClock(start_ns, float(period_s)), index
            elif abs(period_s / found.period_s - 1) > 1e-6:
                raise RecordError(
                    f"{self.path}: {self.names[index]} has a value every {period_s:g} s, others "
                    f"every {found.period_s:g} s: they do not make rows; resample them first"
                )
            late_s = (start_ns - found.start_ns) * 1e-9 if start_ns and found.start_ns else 0.0
            if abs(late_s) > 0.5 * found.period_s:
                self.notes.append(
                    f"{self.names[index]} begins {abs(late_s):.6g} s "
                    f"{'later' if late_s > 0 else 'earlier'} than {self.names[first]} by {START}; "
                    "their first values make one row all the same"
                )
        return found

    def holds_dates(self, index: int) -> bool:
        """Return whether a channel holds timestamps."""
        return self._dtype(index).kind == "M"

    def fix_rows(self, columns: Sequence[int]) -> None:
        """Let rows end where the shortest of these channels ends."""
        lengths = [self._lengths[index] for index in columns]
        self._rows = min(lengths)
        if self._rows < max(lengths):
            self.notes.append(
                f"the channels have {self._rows} to {max(lengths)} values: {self._rows} rows"
            )

    def _dtype(self, index: int) -> "np.dtype[Any]":
        with readable_as(self.path, "a TDMS"):
            dtype: np.dtype[Any] = np.dtype(self._channels[index].dtype)
        if dtype.kind not in "fiubM":
            raise self._no_numbers(index)
        return dtype

    def _no_numbers(self, index: int) -> RecordError:
        return RecordError(f"{self.path}: channel {self.names[index]} does not hold numbers")

    def _spool(self, wanted: WantedColumn) -> FileIO:
        """Copy a channel into a scratch file and return it."""
        dtype, channel = self._dtype(wanted.index), self._channels[wanted.index]
        if dtype.kind == "M" and not wanted.as_time:
            raise self._no_numbers(wanted.index)
        with self._writing():
            spool = tempfile.TemporaryFile(buffering=0, dir=self._scratch)  # noqa: SIM115
        self._opened.enter_context(spool)
        length = self._lengths[wanted.index]
        piece = max(PIECE, -(-length // PIECES))
        for start in range(0, length, piece):
            with readable_as(self.path, "a TDMS"):
                values = channel.read_data(start, min(piece, length - start))
            if dtype.kind == "M":
                values = values.astype("M8[ns]")
            left = memoryview(values.astype("i8" if wanted.as_time else "f8").tobytes())
            with self._writing():
                while left:
                    left = left[spool.write(left) :]
        return spool

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Make a RecordError of an OSError of the body, which writes a scratch file."""
        try:
            yield
        except OSError as error:
            raise RecordError(
                f"{self._scratch}: cannot write a scratch file there: {error.strerror or error}"
            ) from error

    def _read(self, wanted: WantedColumn, start: int, count: int) -> np.ndarray:
        if (spool := self._spools.get(wanted.index)) is None:
            spool = self._spools[wanted.index] = self._spool(wanted)
        spool.seek(8 * start)
        return np.fromfile(spool, "i8" if wanted.as_time else "f8", count)


def begins_as_tdms(path: Path) -> bool:
    """Return whether a file begins as TDMS does. Raises RecordError if it cannot be read."""
    with readable(path), path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


class _Warnings(logging.Filter):
    """Turns what npTDMS warns of, which it would print, into notes: each kind once, in short."""

    def __init__(self, notes: list[str]) -> None:
        super().__init__()
        self._notes = notes
        self._noted: set[object] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        if record.msg not in self._noted:
            self._noted.add(record.msg)
            self._notes.append(f"npTDMS: {record.getMessage()[:WARNING_LENGTH]}")
        return False


def _unix_ns(start: object) -> int | None:
    """Return the Unix ns of a waveform's start, None if there is none."""
    if not isinstance(start, np.datetime64) or np.isnat(start):
        return None
    ns = int(start.astype("M8[ns]").astype(np.int64))
    return ns if ns > 0 else None
