"""The first pass: the period of the rows, the mean speed, where operating points are."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.mapping import ImportMap
from motord.importing.problems import Problems
from motord.importing.rows import usable_rows
from motord.importing.segments import GAP_ROWS, GAP_S, ConstantSegment, SegmentFinder
from motord.importing.times import hints
from motord.recording.errors import RecordError

REGULAR_SHARE = 0.9
"""Share of spacings within half a period of the usual one, from which rows count as regular."""

LEFT_OUT_MAX = 0.5
"""Share of rows that may be left out: with more, the rest is hardly what was recorded."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Survey:
    """rows: that can be used; first_ns, last_ns: their times; period_s: the usual time between two;
    regular: whether it is always about that; counts_per_s: mean speed; segments, in order."""

    rows: int
    first_ns: int
    last_ns: int
    period_s: float
    regular: bool
    counts_per_s: float
    segments: tuple[ConstantSegment, ...]


def survey(column_map: ColumnMap, mapping: ImportMap, few_rows: bool, progress: Progress) -> Survey:
    """Read what must be known before the first row is written. Raises RecordError.

    few_rows: most rows may be left out.
    """
    source, problems = column_map.source, Problems(column_map.source.unit)
    segments = SegmentFinder(mapping.split, column_map.counts)
    medians_ns: list[float] = []
    spacings = usual = rows = travelled = 0
    first_ns = last_ns = last_position = None
    for block in usable_rows(column_map, column_map.by, column_map.by, problems):
        t_ns, position = block.t_ns, block.position
        spacing_ns = np.diff(t_ns, prepend=t_ns[:1] if last_ns is None else [last_ns])
        spacing_ns = spacing_ns[spacing_ns > 0]
        if spacing_ns.size:
            medians_ns.append(float(np.median(spacing_ns)))
            usual += int((np.abs(spacing_ns / medians_ns[-1] - 1) < 0.5).sum())
            spacings += spacing_ns.size
        start = position[:1] if last_position is None else [last_position]
        travelled += int(np.abs(np.diff(position, prepend=start)).sum())
        keys = [_key(name, block.values[name]) for name in column_map.by]
        gap_ns = max(GAP_S * 1e9, GAP_ROWS * float(np.median(medians_ns or [0.0])))
        segments.take(t_ns, position, np.array(keys).T.reshape(t_ns.size, -1), gap_ns)
        first_ns = int(t_ns[0]) if first_ns is None else first_ns
        last_ns, last_position = int(t_ns[-1]), int(position[-1])
        rows += t_ns.size
        progress(block.done)
    if first_ns is None or last_ns is None or not medians_ns:
        raise RecordError(
            f"{source.path}: fewer than two rows in it have {column_map.position_field} and a time "
            "(a number, or a date in ISO form or in that of [csv] date_format) later than the row "
            "before; see that the map names the right columns"
            + "".join(f"; {message}" for message in problems.messages())
        )
    if not few_rows:
        _require_most(column_map, rows, problems)
    return Survey(
        rows=rows,
        first_ns=first_ns,
        last_ns=last_ns,
        period_s=float(np.median(medians_ns)) * 1e-9,
        regular=usual >= REGULAR_SHARE * spacings,
        counts_per_s=travelled / (last_ns - first_ns) * 1e9,
        segments=tuple(segments.finish()),
    )


def _require_most(column_map: ColumnMap, rows: int, problems: Problems) -> None:
    """Raise RecordError if more than `LEFT_OUT_MAX` of all rows are left out; `rows` are used."""
    everything = rows + problems.left_out
    if problems.left_out > LEFT_OUT_MAX * everything:
        why = "; ".join([*problems.messages(), *hints(problems, rows, column_map.position_field)])
        raise RecordError(
            f"{column_map.source.path}: {problems.left_out} of {everything} rows would be left "
            f"out: {why}; see that the rows are in the order of time and the map names the right "
            "columns, or take what is left with --few-rows"
        )


def _key(name: str, values: np.ndarray) -> np.ndarray:
    """Return values that are equal within an operating point; nan outside of any."""
    return np.where(values < 0, np.nan, values) if name == "plan_point" else values
