"""A result as it is stored: what it is of, and its figures; its name says the same."""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from motord.recording.plan_columns import PlanValue
from motord.results.figures import ResultFigure

NAME_MAX = 40
"""Characters of a serial number or motor that a file's name has of it."""

DIGEST_LENGTH = 12
"""Hexadecimal digits of the digests in a file's name."""


@dataclass(frozen=True)
class _Analysed:
    """What was analysed.

    experiment: as `motord analyse` names it; run: names of the recordings, with commas; time: UTC,
    when the first of them began; version: of motord, "" if it is not known.
    """

    experiment: str
    motor: str
    serial: str
    bench: str
    run: str
    time: datetime
    version: str


@dataclass(frozen=True)
class ResultRow(_Analysed):
    """A figure with what it is of; the names of the fields are those of the table's columns.

    settings: options of the analysis, JSON; low, high: of the 95 % interval.
    """

    settings: str
    field: str
    unit: str
    value: float
    stderr: float | None
    low: float | None
    high: float | None

    @property
    def figure(self) -> ResultFigure:
        """The figure alone."""
        return ResultFigure(self.field, self.unit, self.value, self.stderr, self.low, self.high)


COLUMNS = tuple(one.name for one in fields(ResultRow))
"""Columns of the table `results`."""


@dataclass(frozen=True)
class StoredResult(_Analysed):
    """One analysis: its figures, and what all of them have in common.

    settings: options of the analysis; recordings: name and digest of each; plan: their plan and its
    settings, as `recording.plan_columns` names them.
    """

    settings: Mapping[str, Any]
    recordings: Sequence[tuple[str, str]]
    figures: Sequence[ResultFigure]
    plan: Mapping[str, PlanValue] = field(default_factory=dict)

    def rows(self) -> list[ResultRow]:
        """Return the rows of the table, one a figure."""
        settings = _canonical(self.settings)
        common = {one.name: getattr(self, one.name) for one in fields(_Analysed)}
        return [ResultRow(**common, settings=settings, **vars(one)) for one in self.figures]

    @property
    def file_name(self) -> str:
        """Name of its file, the same for the same result."""
        parts = (
            _plain(self.experiment),
            _plain(self.serial or self.motor) or "unnamed",
            f"{self.time.astimezone(UTC):%Y%m%dT%H%M%SZ}",
            *(self.analysis_digest, self.content_digest),
        )
        return f"{'-'.join(parts)}.parquet"

    @cached_property
    def analysis_digest(self) -> str:
        """Digest of what was analysed and how; recordings by their content, in any order."""
        of = (self.experiment, self.motor, self.serial, self.bench, self.version)
        return text_digest(
            (*of, dict(self.settings), sorted(digest for _, digest in self.recordings))
        )

    @cached_property
    def content_digest(self) -> str:
        """Digest of what was found in which recordings."""
        found = [(one.field, one.unit, one.value, one.stderr) for one in self.figures]
        return text_digest((self.experiment, self.serial, self.run, found))


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def text_digest(value: Any) -> str:
    """Return a short digest of what JSON can say."""
    return hashlib.sha256(_canonical(value).encode()).hexdigest()[:DIGEST_LENGTH]


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def _plain(text: str) -> str:
    """Return a text with letters, digits, dots and underscores alone, as the part of a name."""
    return re.sub(r"[^A-Za-z0-9._]+", "_", text).strip("._")[:NAME_MAX]
