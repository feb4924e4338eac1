"""`motord results`: questions to a results store, control charts, comparisons, results added."""

from pathlib import Path
from typing import Annotated

import typer

from motord.cli.common_options import AsJson
from motord.cli.console import fail_with, group, print_json, print_line, remark
from motord.cli.results.printing import aligned, as_csv, as_objects
from motord.cli.results.store_options import StoreReading, StoreToRead, named
from motord.cli.results.trends import compare, trend

app = group("Query results of analyses, follow them over time, compare them.")


@app.command()
def query(
    sql: Annotated[
        str,
        typer.Argument(metavar="SQL", help="One SELECT; the table is `results`, times are UTC."),
    ],
    store: StoreToRead = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
    as_json: AsJson = False,
) -> None:
    """Ask the store a question in SQL (DuckDB); it is not changed, and no other file is read.

    Columns of `results`, a row for each figure: experiment, motor, serial, bench, run, time,
    version, settings, field, unit, value, stderr, low, high (95 % interval).
    """
    from motord.results.query import query as ask

    if csv and as_json:
        raise typer.BadParameter("--csv or --json")
    reading = StoreReading(store)
    answer = ask(reading.table, sql)
    if as_json:
        print_json(as_objects(answer.columns, answer.rows))
    elif csv:
        print_line(as_csv(answer.columns, answer.rows))
    else:
        for line in aligned(answer.columns, answer.rows):
            print_line(line)
    if not reading.table.num_rows:
        remark(f"{reading.folder}: the store is empty")
    reading.finish()


app.command()(trend)
app.command()(compare)


@app.command()
def add(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Results as `motord analyse -o` writes them, JSON."),
    ],
    store: StoreToRead = None,
    as_json: AsJson = False,
) -> None:
    """Add results that were written before: calibration files, and others of `motord analyse`.

    Which version and which settings they were made with is not known of them. Their time is when a
    calibration was made, else that of the file.
    """
    from motord.config.experiments import analysis_kinds
    from motord.results.error import ResultsError
    from motord.results.result_json import read_result
    from motord.results.store import ResultsStore

    results = ResultsStore(named(store))
    results.make()
    kinds = {kind.schema: kind for kind in analysis_kinds().values() if kind.schema}
    done, failed = [], []
    for file in files:
        try:
            done.append(results.add(read_result(file, kinds)))
        except ResultsError as error:
            failed.append(str(error))
            continue
        if not as_json:
            print_line(f"{file}: {done[-1].to_text()}")
    if as_json:
        print_json(
            [{"file": str(one.path), "figures": one.figures, "new": one.new} for one in done]
        )
    fail_with(failed)
