"""A row of the table `results`: a figure, and which result it is of."""

from dataclasses import dataclass, fields
from datetime import datetime

from motord.results.figures import ResultFigure


@dataclass(frozen=True)
class ResultRow:
    """A figure with what it is of; the names of the fields are those of the table's columns.

    run: names of the recordings, with commas; time: UTC, when the first of them began; version: of
    motord, "" if it is not known; settings: options of the analysis, JSON; low, high: of the 95 %
    interval.
    """

    experiment: str
    motor: str
    serial: str
    bench: str
    run: str
    time: datetime
    version: str
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
