"""`motord analyse KIND` of many recordings, each by itself: options, progress, output."""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.console import print_line, progress_bar, remark

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from motord.batch.dask_pool import DaskPool
    from motord.batch.run import BatchLine, BatchProgress
    from motord.batch.task import BatchTask
    from motord.experiments.analysis import Analysis

Workers = Annotated[
    int | None,
    typer.Option(
        "--workers", min=1, metavar="N",
        help="Analyse each recording by itself, in N processes on this computer; with a folder or "
        "a quoted pattern such as 'runs/**/*.mcap' by default as many as it has processors.",
    ),
]  # fmt: skip
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="URL",
        help="Analyse each recording by itself, on the workers of this Dask scheduler: "
        "tcp://HOST:PORT or tls://HOST:PORT.",
    ),
]  # fmt: skip
Rehash = Annotated[
    bool,
    typer.Option(
        "--rehash",
        help="Of many recordings: read also files whose size, time and inode are as they were.",
    ),
]
Retry = Annotated[
    bool,
    typer.Option("--retry", help="Of many recordings: try again what failed in an earlier run."),
]


def of_each(given: Mapping[str, Any]) -> bool:
    """Return whether each recording is to be analysed by itself."""
    from motord.batch.expansion import names_many

    if given["workers"] is not None and given["scheduler"] is not None:
        raise typer.BadParameter("--workers or --scheduler")
    if given["scheduler"] is not None and not re.fullmatch(r"\w+://.+:\d+", given["scheduler"]):
        raise typer.BadParameter(f"{given['scheduler']}: needed is tcp://HOST:PORT")
    if given["workers"] is not None or given["scheduler"] is not None:
        return True
    if any(names_many(path) for path in given["runs"] or []):
        return True
    for name in ("rehash", "retry"):
        if given[name]:
            raise typer.BadParameter(f"--{name}: for many recordings, with --workers")
    return False


def analyse_batch(
    analysis: "Analysis[Any]", kind: str, options: Mapping[str, Any], given: Mapping[str, Any]
) -> None:
    """Analyse each recording, show how far it is, count; fail if any failed."""
    from motord.batch.dask_pool import DaskPool
    from motord.batch.expansion import expand

    paths = expand(given["runs"] or [])
    _check_usage(analysis, options, given)
    task = _task(analysis, kind, options, given)
    workers = min(given["workers"] or len(os.sched_getaffinity(0)), len(paths))
    modules = [task.command.partition(":")[0]]
    columns = "{task.description}", "bar", "count", "left"
    with TemporaryFile() as file, progress_bar(*columns, stderr=True, transient=True) as bars:
        report = _Report(paths, bars, _OrderedLines(file) if given["as_json"] else None)
        try:
            with DaskPool(workers, given["scheduler"], remark, modules) as pool:
                for line in _lines(paths, task, pool, given, report.progress):
                    report.add(line)
        finally:
            bars.stop()
            report.finish()
    if report.failures:
        raise typer.Exit(1)


def _lines(
    paths: Sequence[Path],
    task: "BatchTask",
    pool: "DaskPool",
    given: Mapping[str, Any],
    progress: "BatchProgress",
) -> "Iterator[BatchLine]":
    from motord.batch.ledger import Ledger
    from motord.batch.run import analyse_each, analyse_into_store
    from motord.results.store import ResultsStore

    if given["store"] is None:
        return analyse_each(paths, task, pool, progress)
    ledger = Ledger(ResultsStore(given["store"]))
    ledger.make()
    again = {"rehash": given["rehash"], "retry": given["retry"]}
    return analyse_into_store(paths, task, pool, ledger, progress, **again)


def _check_usage(
    analysis: "Analysis[Any]", options: Mapping[str, Any], given: Mapping[str, Any]
) -> None:
    if given["store"] is None and not given["as_json"]:
        raise typer.BadParameter(
            "where to put the results of many recordings? --store DIR, or --json"
        )
    named = {"output": given["output"], "report": given["report"]}
    named |= {name: options[name] for name in analysis.outputs}
    for name, value in named.items():
        if value:
            raise typer.BadParameter(
                f"--{name} is of one result; results of many recordings go into --store DIR"
            )


def _task(
    analysis: "Analysis[Any]", kind: str, options: Mapping[str, Any], given: Mapping[str, Any]
) -> "BatchTask":
    from motord.batch.task import BatchTask

    options = {name: _absolute(value) for name, value in options.items()}
    config = _absolute(given["config"])
    settings = {name: value for name, value in options.items() if name not in analysis.outputs}
    return BatchTask(
        kind, options, {**settings, "config": config}, config,
        to_store=given["store"] is not None, to_print=given["as_json"],
    )  # fmt: skip


def _absolute(value: Any) -> Any:
    return value.absolute() if isinstance(value, Path) else value


class _OrderedLines:
    """Prints lines in the order of their numbers; those that come early wait in a file."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._early: dict[int, tuple[int, int]] = {}
        self._next = 0

    def add(self, number: int, line: str) -> None:
        """Print a line, and those that waited for it; or keep it until it is its turn."""
        data = line.encode()
        self._early[number] = self._file.seek(0, os.SEEK_END), self._file.write(data)
        while self._next in self._early:
            self._print(self._next)
            self._next += 1
        if not self._early:
            self._file.truncate(0)

    def finish(self) -> None:
        """Print what waits for lines that will not come."""
        for number in sorted(self._early):
            self._print(number)

    def _print(self, number: int) -> None:
        place, length = self._early.pop(number)
        self._file.seek(place)
        print_line(self._file.read(length).decode())


class _Report:
    """How far it is, on stderr; what became of each, as JSON in their order; counts in the end."""

    def __init__(
        self, paths: Sequence[Path], bars: "Progress", lines: _OrderedLines | None
    ) -> None:
        self._numbers = {path: number for number, path in enumerate(paths)}
        self._bars, self._lines = bars, lines
        self._tasks: dict[str, TaskID] = {}
        self._counts = {"done": 0, "skipped": 0, "failed": 0}
        self.failures: dict[int, str] = {}
        self._missing: dict[int, str] = {}

    def progress(self, what: str, done: int, total: int) -> None:
        """Move the bar of what is done; begin one if there is none."""
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(what, total=total)
        self._bars.update(self._tasks[what], completed=done)

    def add(self, line: "BatchLine") -> None:
        """Count and show what became of a recording."""
        number = self._numbers[line.recording]
        self._counts[line.state] += 1
        if line.state == "failed":
            self.failures[number] = f"motord: {line.recording}: {line.note}"
        elif line.state == "done" and line.note:
            self._missing[number] = f"{line.recording}: {line.note}"
        if self._lines is not None:
            shown = {"recording": str(line.recording), "state": line.state, "note": line.note}
            shown |= {"stored": line.stored, "result": line.content}
            self._lines.add(number, json.dumps(shown))

    def finish(self) -> None:
        """Print counts, what is missing, failures."""
        counts = {"recordings": len(self._numbers), **self._counts}
        if self._lines is not None:
            self._lines.finish()
            print_line(json.dumps({"summary": counts}))
        else:
            left = len(self._numbers) - sum(self._counts.values())
            named = self._counts if not left else {**self._counts, "not analysed": left}
            line = ", ".join(f"{count} {name}" for name, count in named.items())
            print_line(f"{len(self._numbers)} recordings: {line}")
        texts = self._missing | self.failures
        for number in sorted(texts):
            remark(texts[number])
