"""A table that is being exported: its columns, their units, and its rows block by block."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from motord.recording.plan_columns import PlanValue
from motord.schema import Field, Record, joined
from motord.wire.ticks.blocks import Block


@dataclass(frozen=True)
class ExportedTable:
    """Rows of a recording; record: what its columns are; metadata: of the recording.

    plan: further columns, the same in all rows.
    """

    dtype: np.dtype[np.void]
    blocks: Iterator[Block]
    record: Record
    metadata: dict[str, Any]
    plan: dict[str, PlanValue]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.dtype.names or ()

    @property
    def fields(self) -> dict[str, Field]:
        """What is known of each column that the schema has."""
        known = {field.name: field for field in self.record.fields}
        return {name: known[name] for name in self.names if name in known}

    def gathered(self, rows: int) -> Iterator[Block]:
        """Yield blocks of at least `rows` rows, but for the last."""
        waiting: list[Block] = []
        for block in self.blocks:
            waiting.append(block)
            if sum(map(len, waiting)) >= rows:
                yield joined(waiting)
                waiting = []
        if waiting:
            yield joined(waiting)
