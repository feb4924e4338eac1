"""`motord reproduce`: the report's experiments on the simulated rig, on one page."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.common_options import ResultAsJson
from motord.cli.console import fail, plain_console, print_json, progress_bar, text_column

if TYPE_CHECKING:
    from motord.reproduce import Found


def reproduce(
    out: Annotated[Path, typer.Option(help="New or empty folder for runs and page.")] = Path(
        "reproduce-out"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rigs' noise and drift.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Small meshes, to see the page.")] = False,
    as_json: ResultAsJson = False,
) -> None:
    """Run every experiment of Poels 2008 in virtual time; write one page beside its numbers."""
    from motord.reproduce import write_page

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        fail(f"{out}: is not empty; name another folder with --out, nothing is overwritten")
    try:
        found = _run(out, seed, quick, silent=as_json)
        page = write_page(out, found)
    except OSError as error:
        fail(f"{error.filename or out}: {error.strerror}; choose another folder with --out")
    if as_json:
        from motord.reproduce.beside import as_json as rows

        print_json({"page": str(page), "wall_s": round(found.wall_s, 2), **rows(found)})
    else:
        _print(found, page)


def _run(out: Path, seed: int, quick: bool, silent: bool) -> "Found":
    from rich.progress import BarColumn, TimeElapsedColumn

    from motord.reproduce import STAGES, reproduce

    columns = text_column("{task.description:<18}"), BarColumn(), TimeElapsedColumn()
    with progress_bar(*columns, silent=silent) as bars:
        tasks = {stage: bars.add_task(stage, total=1.0, start=False) for stage in STAGES}

        def progress(stage: str, fraction: float) -> None:
            bars.start_task(tasks[stage])
            bars.update(tasks[stage], completed=fraction)

        return reproduce(out, seed, quick, progress)


def _print(found: "Found", page: Path) -> None:
    from rich.table import Table

    from motord.reproduce.beside import chapters

    console = plain_console()
    for name, rows in chapters(found).items():
        table = Table(title=name, title_justify="left", show_lines=True)
        for heading in ("", "", "report", "here"):
            table.add_column(heading)
        for row in rows:
            table.add_row(row.where, row.what, row.report, row.here)
        console.print(table)
    console.print(
        f"{found.bench_s:.0f} s on the bench took {found.wall_s:.0f} s; page: {page}",
        highlight=False,
    )
