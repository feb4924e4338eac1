"""ASAM MDF 4 as a source of rows, read block by block.

Rows are the records of a channel group, or of groups that were sampled at the same times. The times
of a group's master channel count from the start that the file states.
"""

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from motord.importing.mapping import MdfMap
from motord.importing.source import (
    BLOCK_ROWS,
    MISSING_NS,
    ColumnSource,
    WantedColumn,
    readable,
    readable_as,
)
from motord.recording.errors import RecordError
from motord.recording.export.optional_packages import optional

MAGICS = (b"MDF     ", b"UnFinMF ")

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class _Channel:
    """A channel by its place in the file; group_name: of its acquisition, else its number."""

    group: int
    index: int
    name: str
    group_name: str
    is_master: bool


class MdfSource(ColumnSource):
    """An MDF file, open as long as `opened`.

    Raises RecordError for a file that is not MDF, and where asammdf is not installed.
    """

    def __init__(self, path: Path, options: MdfMap, opened: ExitStack) -> None:
        self.path = path
        self.notes: list[str] = []
        self._group = options.group
        if not begins_as_mdf(path):
            raise RecordError(f"{path}: does not begin as a file of MDF 4 does")
        with readable_as(path, "an MDF"):
            file = opened.enter_context(path.open("rb"))
            asammdf = optional("asammdf", "MDF", "asammdf", "mdf", "save the file as CSV")
            self._mdf = opened.enter_context(_opened(asammdf.MDF, file))
            self._start_ns = _unix_ns(self._mdf.start_time)
            self._channels: list[_Channel] = list(_channels(self._mdf))
            self._records = [int(group.channel_group.cycles_nr) for group in self._mdf.groups]
        self._rows = 0
        self._dtypes: dict[int, np.dtype[Any]] = {}
        self._raw: set[int] = set()  # whose values have texts, by a table in the file
        self.names = tuple(f"{c.group_name}/{c.name}" for c in self._channels)

    def holds_dates(self, index: int) -> bool:
        """Return whether a channel is the time of its group, whose start the file states."""
        return self._channels[index].is_master

    def fix_rows(self, columns: Sequence[int]) -> None:
        """Let rows be the records of the channels' group. Raises RecordError if they differ."""
        first = self._channels[columns[0]]
        self._rows = self._records[first.group]
        for index in columns[1:]:
            other = self._channels[index]
            if other.group != first.group and not self._same_times(first.group, other.group):
                raise RecordError(
                    f"{self.path}: {self.names[columns[0]]} and {self.names[index]} were sampled "
                    "at different times: they do not make rows; resample them first"
                )

    def _same_times(self, group: int, other: int) -> bool:
        if self._records[group] != self._records[other]:
            return False
        with readable_as(self.path, "an MDF"):
            return all(
                np.array_equal(
                    *(
                        self._mdf.get_master(one, record_offset=at, record_count=BLOCK_ROWS)
                        for one in (group, other)
                    )
                )
                for at in range(0, self._records[group], BLOCK_ROWS)
            )

    def _dtype(self, index: int) -> "np.dtype[Any]":
        if index not in self._dtypes:
            values, _ = self._values(index, 0, 1)
            if values.dtype.kind not in "fiub":
                self._raw.add(index)
                values, _ = self._values(index, 0, 1)
            if values.dtype.kind not in "fiub" or values.ndim != 1:
                raise RecordError(f"{self.path}: channel {self.names[index]} does not hold numbers")
            self._dtypes[index] = values.dtype
        return self._dtypes[index]

    def _values(self, index: int, start: int, count: int) -> tuple[np.ndarray, Any]:
        """Return values of a channel, and where they are invalid, None if none is."""
        channel = self._channels[index]
        with readable_as(self.path, "an MDF"):
            values, invalid = self._mdf.get(
                group=channel.group,
                index=channel.index,
                samples_only=True,
                raw=index in self._raw,
                ignore_invalidation_bits=True,  # else the rows that have none are left out
                record_offset=start,
                record_count=count,
            )
            return np.asarray(values), invalid

    def _read(self, wanted: WantedColumn, start: int, count: int) -> np.ndarray:
        self._dtype(wanted.index)
        values, invalid = self._values(wanted.index, start, count)
        if values.shape != (count,):
            raise RecordError(
                f"{self.path}: {self.names[wanted.index]} ends after {start + len(values)} of "
                f"{self._rows} records; asammdf may repair the file"
            )
        if wanted.as_time and self._channels[wanted.index].is_master:
            since_s = values.astype(float)
            known = np.abs(since_s) < 1e9
            since_ns = np.round(np.where(known, since_s, 0.0) * 1e9).astype(np.int64)
            read = np.where(known, since_ns + self._start_ns, MISSING_NS)
        else:
            read = values.astype("i8" if wanted.as_time else "f8")
        if invalid is not None:
            read[np.asarray(invalid, bool)] = MISSING_NS if wanted.as_time else np.nan
        return read


def _channels(mdf: Any) -> Iterator[_Channel]:
    for number, group in enumerate(mdf.groups):
        group_name = str(getattr(group.channel_group, "acq_name", "") or number)
        master = mdf.masters_db.get(number)
        for index, channel in enumerate(group.channels):
            yield _Channel(number, index, str(channel.name), group_name, index == master)


def _opened(opener: Any, file: BinaryIO) -> Any:
    """Return the open file; of one that is damaged asammdf's destructor stays silent."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda lost: None if isinstance(lost.exc_value, Exception) else hook(lost)
    try:
        try:
            return opener(file)
        except Exception as error:
            error.__traceback__ = None  # which holds what asammdf has begun
            gc.collect()
            raise
    finally:
        sys.unraisablehook = hook


def begins_as_mdf(path: Path) -> bool:
    """Return whether a file begins as MDF 4 does. Raises RecordError if it cannot be read."""
    with readable(path), path.open("rb") as file:
        return file.read(8) in MAGICS and file.read(1) == b"4"


def _unix_ns(start: datetime) -> int:
    """Return the Unix ns of a file's start; one without a zone is local time."""
    since = start.astimezone(UTC) - EPOCH
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000
