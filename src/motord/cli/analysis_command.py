"""`motord analyse KIND`: one skeleton for the analyses of all registered experiments."""

import inspect
import json
import resource
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from inspect import Parameter, Signature
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.atomic_write import write_whole
from motord.cli.batch_analysis import Rehash, Retry, Scheduler, Workers, analyse_batch, of_each
from motord.cli.common_options import (
    ResultAsJson,
    bench_file,
    bench_files,
    check_output_files,
    output_file,
)
from motord.cli.console import (
    CommandGroup,
    group,
    phase_bars,
    print_json,
    print_line,
    print_table,
    remark,
    single,
)
from motord.cli.results.store_options import AnalysisStorage, Store

if TYPE_CHECKING:
    from motord.config.experiments import AnalysisKind
    from motord.experiments.analysis import Analysis
    from motord.report.text import TextTable

Output = Annotated[Path | None, output_file("Write the result, JSON.")]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write a page with pictures, HTML.")
]
BenchFile = Annotated[
    Path | None,
    bench_file("Bench file or motor file; without it, what the recordings say of themselves."),
]

RUNS = "Recordings, .mcap, analysed together; each by itself with --workers, a folder or a pattern."


def _kinds() -> "dict[str, AnalysisKind]":
    from motord.config.experiments import analysis_kinds

    return analysis_kinds()


class _Analyses(CommandGroup):
    """Imports an analysis only when it is asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of the registry."""
        return list(_kinds())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command, or None if there is none of that name."""
        for kind in _kinds().values():
            if cmd_name in (kind.name, *kind.aliases):
                return single(cmd_name, _command(kind))
        return None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the names with their summaries, which import nothing."""
        with formatter.section("Commands"):
            formatter.write_dl([(kind.name, kind.summary) for kind in _kinds().values()])
        from motord.config.experiments import broken_experiments

        for why in broken_experiments():
            formatter.write_text(why)


app = group("Identify, verify, report.", _Analyses)


@app.callback()
def _root() -> None: ...


def _command(kind: "AnalysisKind") -> Callable[..., None]:
    """Return the command's function, with the options that all share and the estimate's own."""
    analysis: Analysis[Any] = resolve_name(kind.command)
    own = list(inspect.signature(analysis.estimate).parameters.values())[1:]
    named = any(one.name == "command" for one in own)
    own = [one.replace(kind=Parameter.KEYWORD_ONLY) for one in own if one.name != "command"]
    needed = analysis.needs_recordings

    def run(context: typer.Context, **given: Any) -> None:
        options = {one.name: given[one.name] for one in own}
        if named:
            options["command"] = context.info_name
        _check_output_files(analysis, context.command.params, given)
        (analyse_batch if of_each(given) else _run)(analysis, kind.name, options, given)

    keyword = Parameter.KEYWORD_ONLY
    runs = typer.Argument(metavar="RUN..." if needed else "[RUN...]", help=RUNS)
    kind_of_runs = list[Path] if needed else list[Path] | None
    parameters = [
        Parameter("context", keyword, annotation=typer.Context),
        Parameter(
            "runs", keyword, annotation=Annotated[kind_of_runs, runs],
            default=Parameter.empty if needed else None,
        ),
        Parameter("output", keyword, default=None, annotation=Output),
        Parameter("report", keyword, default=None, annotation=Report),
        Parameter("store", keyword, default=None, annotation=Store),
        *own,
        Parameter("config", keyword, default=None, annotation=BenchFile),
        Parameter("as_json", keyword, default=False, annotation=ResultAsJson),
        Parameter("workers", keyword, default=None, annotation=Workers),
        Parameter("scheduler", keyword, default=None, annotation=Scheduler),
        Parameter("rehash", keyword, default=False, annotation=Rehash),
        Parameter("retry", keyword, default=False, annotation=Retry),
    ]  # fmt: skip
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    run.__doc__ = "\n\n".join(part for part in (kind.summary, analysis.details) if part)
    return run


def _run(
    analysis: "Analysis[Any]", kind: str, options: dict[str, Any], given: dict[str, Any]
) -> None:
    """Estimate, write what is asked for, print, store."""
    from motord.experiments.recording_checks import check_given_once, naming_causes
    from motord.experiments.subject import Recordings

    paths, config = given["runs"] or [], given["config"]
    output, report = given["output"], given["report"]
    storage = _storage(analysis, kind, options, given)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)  # each recording stays open
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with phase_bars(silent=given["as_json"]) as progress:
        recordings = Recordings.open(paths, config, progress)
        check_given_once(recordings.runs)
        others = [config, *options.values()]
        with _naming_recordings(paths, others), naming_causes(recordings.runs):
            result = analysis.estimate(recordings, **options)
    for missing in filter(None, (run.missing for run in recordings.runs)):
        remark(missing)
    content = analysis.to_json(result, recordings)
    if output and analysis.save:
        analysis.save(result, output)
    elif output:
        write_whole(output, json.dumps(content, indent=analysis.indent) + "\n")
    if report:
        from motord.experiments.operator_notes import add_operator_notes

        page = analysis.page(result, recordings)
        add_operator_notes(page, recordings)
        page.write(report)
    if given["as_json"]:
        print_json(content)
    else:
        print_text(analysis.lines(result, recordings))
        print_files(output, report)
    if storage is not None:
        storage.add(content, recordings)


@contextmanager
def _naming_recordings(paths: Sequence[Path], others: Iterable[object]) -> Iterator[None]:
    """Have an error of the analysis that names neither recordings nor another file name them."""
    from motord.experiments.subject import AnalysisError
    from motord.findings import listed
    from motord.identification import IdentifyError

    try:
        yield
    except (AnalysisError, IdentifyError) as error:
        text = str(error)
        if any(isinstance(one, Path) and one.name in text for one in others):
            raise
        if len(paths) == 1 and str(paths[0]) not in text:
            error.args = (f"{paths[0]}: {text.removeprefix(f'{paths[0].name}: ')}",)
        elif paths and not any(path.name in text for path in paths):
            error.args = (f"{listed([str(path) for path in paths], 3)}: {text}",)
        raise


def _check_output_files(
    analysis: "Analysis[Any]", parameters: Sequence[Any], given: Mapping[str, Any]
) -> None:
    """Refuse to write over what is read; only the bench file may be one that is edited."""
    outputs = ("output", "report", *analysis.outputs)
    options = {one.name: one.opts[0] for one in parameters}
    written = {options[name]: given[name] for name in outputs}
    others = [name for name in given if name not in (*outputs, "runs", "config", "store")]
    read = [*(given["runs"] or ()), *(given[name] for name in others)]
    read = [one for one in read if isinstance(one, Path)]
    check_output_files(written, read, [options[name] for name in analysis.edited])
    unedited = {options[name]: given[name] for name in outputs if name not in analysis.edited}
    check_output_files(unedited, bench_files(given["config"]))


def _storage(
    analysis: "Analysis[Any]", kind: str, options: dict[str, Any], given: dict[str, Any]
) -> AnalysisStorage | None:
    """Return where the result is to be stored, if it is."""
    if given["store"] is None:
        return None
    if not given["runs"]:
        remark("not stored: a store keeps results of recordings")
        return None
    settings = {name: value for name, value in options.items() if name not in analysis.outputs}
    if given["config"] is not None:
        settings["config"] = given["config"]
    return AnalysisStorage(given["store"], kind, settings)


def print_files(*files: Path | None) -> None:
    """Print which files were written."""
    for file in files:
        if file is not None:
            print_line(f"wrote {file}")


def print_text(parts: "Iterable[str | TextTable]") -> None:
    """Print lines and tables."""
    from rich.table import Table

    for part in parts:
        if isinstance(part, str):
            print_line(part)
            continue
        table = Table(title=part.title)
        for column, heading in enumerate(part.header):
            table.add_column(heading, justify="left" if column in part.left else "right")
        for row in part.rows:
            table.add_row(*row)
        print_table(table)
