"""Ticks of a recording as a table in a format of other tools, written block by block."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from motord.atomic_write import why_not_written
from motord.recording.errors import RecordError
from motord.recording.export.csv_text import write_csv
from motord.recording.export.matlab import write_matlab
from motord.recording.export.mdf import write_mdf
from motord.recording.export.parquet_file import write_parquet
from motord.recording.export.table import ExportedTable, tick_table
from motord.recording.file_names import part_of, require_free
from motord.recording.plan_columns import PREFIX, plan_columns
from motord.recording.reader import Run
from motord.schema import TRUTH

WRITERS: dict[str, Callable[[Path, ExportedTable], int]] = {
    ".csv": write_csv,
    ".parquet": write_parquet,
    ".mf4": write_mdf,
    ".mat": write_matlab,
}
"""What writes a table and returns its number of rows, by the end of the file's name."""


def export(
    run: Run, output: Path, columns: Iterable[str] | None = None, *, truth: bool = False
) -> int:
    """Write the ticks of `run` (or the truth of a simulated rig) and return how many.

    Slow channels are columns after those of the ticks, each row with the newest reading of its
    time. After them come name and settings of the recording's plan, the same in all rows.

    The end of the name of `output`, one of WRITERS, chooses the format. Raises RecordError if it
    exists or cannot be written, and for columns or truth that the recording does not have.
    """
    if output.suffix not in WRITERS:
        raise RecordError(f"{output}: its name must end with {endings()}")
    taken = (*run.truth_table.columns,) if truth else (*run.columns, *run.channels())
    plan = {name: one for name, one in plan_columns(run.metadata).items() if name not in taken}
    wanted = None if columns is None else tuple(dict.fromkeys(columns))
    if wanted is not None:
        plan = {name: plan[name] for name in wanted if name in plan}
        wanted = tuple(name for name in wanted if name not in plan)
        settings = [name for name in wanted if name.startswith(PREFIX) and name not in taken]
        if settings:
            known = ", ".join(plan_columns(run.metadata)) or "none"
            raise RecordError(
                f"{run.path}: no {', '.join(settings)}; settings of its plan: {known}"
            )
        if not wanted:
            raise RecordError(f"choose a column of each tick besides {', '.join(plan)}")
    record = TRUTH
    if truth:
        dtype, blocks = run.truth_table.dtype(wanted), run.truth_table.blocks(wanted)
    else:
        dtype, blocks, record = tick_table(run, wanted)
    with _complete_or_absent(output) as part:
        table = ExportedTable(dtype, blocks, record, run.metadata, plan)
        rows = WRITERS[output.suffix](part, table)
        if truth and not rows:
            source = "`motord simulate` and `motord emulate --truth` record it"
            raise RecordError(f"{run.path}: there is no truth in it; {source}")
        return rows


def endings() -> str:
    """Return the possible ends of names, as text."""
    *first, last = WRITERS
    return f"{', '.join(first)} or {last}"


@contextmanager
def _complete_or_absent(output: Path) -> Iterator[Path]:
    """Give another name to write to, which becomes `output` when the body has succeeded."""
    require_free(output)
    part = part_of(output)
    try:
        yield part
        part.rename(output)
    except OSError as error:
        raise RecordError(f"{output}: cannot write it: {why_not_written(output, error)}") from error
    finally:
        part.unlink(missing_ok=True)
