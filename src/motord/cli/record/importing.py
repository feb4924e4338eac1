"""`motord record import`: a run out of a CSV, TDMS or MDF file that was recorded elsewhere."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.common_options import AsJson
from motord.cli.console import fail, print_result, progress_bar
from motord.cli.output_files import check_output_files

if TYPE_CHECKING:
    from motord.importing.convert import Imported
    from motord.importing.survey import Progress

QUIET_S = 2.0
"""Time after which progress is shown."""


def import_recording(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording: CSV, TDMS or MDF.")],
    map_file: Annotated[
        Path, typer.Option("--map", metavar="MAP.toml", help="Which column is what.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="RUN.mcap", help="The recording to write.")
    ],
    strict: Annotated[
        bool, typer.Option("--strict", help="Fail if a row lacks something or its time is wrong.")
    ] = False,
    few_rows: Annotated[
        bool,
        typer.Option("--few-rows", help="Import even if more than half of the rows are left out."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make a run of a recording from elsewhere; most of `analyse` works on it."""
    from motord.importing.convert import import_run

    check_output_files({"--output": output}, [file, map_file])
    try:
        with _progress(silent=as_json) as progress:
            done = import_run(
                file, map_file, output, strict=strict, few_rows=few_rows, progress=progress
            )
    except OSError as error:
        fail(f"{error.filename or output}: {error.strerror}")
    print_result(done.to_json(), "\n".join(_lines(done)), as_json)


@contextmanager
def _progress(silent: bool) -> "Iterator[Progress]":
    """Give a function that shows the share of the work done, and when it will be, after a while."""
    bar = progress_bar("importing", "bar", "left", silent=silent, stderr=True, transient=True)
    task = bar.add_task("import", total=1.0)
    began_s = time.monotonic()

    def show(done: float) -> None:
        if not bar.live.is_started and time.monotonic() - began_s > QUIET_S:
            bar.start()
        bar.update(task, completed=done)

    try:
        yield show
    finally:
        if bar.live.is_started:
            bar.stop()


def _lines(done: "Imported") -> Iterator[str]:
    yield (
        f"{done.path}: {done.ticks} ticks in {done.duration_s:.3f} s ({done.rate_Hz:.1f} Hz), "
        f"{done.missed} missing"
    )
    for point in done.points:
        yield (
            f"  {point['index']:>3}  {point['torque_Nm']:6.2f} Nm {point['speed_Hz']:6.3f} Hz  "
            f"{point['turns']:6.1f} turns  {point['quality']}"
        )
    yield from (f"- {text}" for text in done.notes)
    yield from (f"! {text}" for text in done.problems)
