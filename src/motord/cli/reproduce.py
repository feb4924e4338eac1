"""`motord reproduce`: the report's experiments on the simulated rig, on one page."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.common_options import ResultAsJson
from motord.cli.console import explain_first_run, fail, print_json, print_table, progress_bar

if TYPE_CHECKING:
    from motord.reproduce.bench import StageProgress
    from motord.reproduce.run import Results


def reproduce(
    out: Annotated[Path, typer.Option(help="New or empty folder for page and results.")] = Path(
        "reproduce-out"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rigs' noise and drift.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Small meshes, to see the page.")] = False,
    keep_recordings: Annotated[
        bool, typer.Option("--keep-recordings", help="Leave the runs, 1 GB, next to the page.")
    ] = False,
    as_json: ResultAsJson = False,
) -> None:
    """Run every experiment of Poels 2008 in virtual time; write one page next to its numbers."""
    from motord.reproduce.page import write_page
    from motord.reproduce.poels2008 import as_json as rows
    from motord.reproduce.run import STAGES
    from motord.reproduce.run import reproduce as run

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        fail(f"{out}: is not empty; name another folder with --out, nothing is overwritten")
    with stage_progress(STAGES, out, silent=as_json) as progress:
        found = run(out, seed, quick, keep_recordings, progress)
        page = write_page(out, found, keep_recordings)
    if as_json:
        print_json({"page": str(page), "wall_s": round(found.wall_s, 2), **rows(found)})
    else:
        _print(found, page)


@contextmanager
def stage_progress(stages: Sequence[str], out: Path, silent: bool) -> "Iterator[StageProgress]":
    """Show a bar for each stage; what is yielded moves it. A file of `out` that fails ends it."""
    explain_first_run(silent=silent)
    width = max(map(len, stages)) + 1
    columns = f"{{task.description:<{width}}}", "bar", "elapsed"
    try:
        with progress_bar(*columns, silent=silent) as bars:
            tasks = {stage: bars.add_task(stage, total=1.0, start=False) for stage in stages}

            def progress(stage: str, fraction: float) -> None:
                bars.start_task(tasks[stage])
                bars.update(tasks[stage], completed=fraction)

            yield progress
    except OSError as error:
        fail(f"{error.filename or out}: {error.strerror}; choose another folder with --out")


def _print(found: "Results", page: Path) -> None:
    from rich.table import Table

    from motord.reproduce.poels2008 import chapters

    for name, rows in chapters(found).items():
        table = Table(title=name, title_justify="left", show_lines=True)
        for heading in ("section", "quantity", "report", "here"):
            table.add_column(heading)
        for row in rows:
            table.add_row(row.where, row.what, row.report, row.here)
        print_table(table)
    typer.echo(f"{found.bench_s:.0f} s on the bench took {found.wall_s:.0f} s; page: {page}")
