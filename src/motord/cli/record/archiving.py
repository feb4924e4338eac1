"""`motord archive`: verified copies of recordings, made while the bench is idle."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson, BenchFile
from motord.cli.connection_options import DEFAULT, Connection
from motord.cli.console import fail, print_line, print_result, remark

if TYPE_CHECKING:
    from motord.archive.archive import ArchiveReport, RecordingArchive
    from motord.archive.manifest import ArchiveManifest
    from motord.client.benches import Benches

ROUND_S = 5.0
"""How often `--watch` looks for further recordings."""
TROUBLE_S = 60.0
"""How long it waits after the archive could not be written."""
SETTLE_S = 1.0
"""How long the state of a bench may take to come, before the first copy."""

Destination = Annotated[
    Path, typer.Argument(metavar="DEST", help="The archive: a folder that exists, mounted say.")
]
Source = Annotated[
    Path | None,
    typer.Option(
        "--from", metavar="DIR",
        help="Folder of recordings; default: [recording] directory of the bench file.",
    ),
]  # fmt: skip
Watch = Annotated[
    bool,
    typer.Option("--watch/--once", help="Go on with new recordings whenever the bench is idle."),
]
Limit = Annotated[
    float | None,
    typer.Option(
        "--limit-MB-per-s", metavar="R", min=0.01,
        help="Bandwidth of reading and writing together; default: no limit.",
    ),
]  # fmt: skip
DeleteAfter = Annotated[
    float | None,
    typer.Option(
        "--delete-after-days", metavar="DAYS", min=0,
        help="Delete a recording so long after its copy was verified, once both were read again "
        "and are the same. Without it nothing is ever deleted.",
    ),
]  # fmt: skip
Verify = Annotated[
    bool,
    typer.Option("--verify", help="Re-read the archive and name what differs; copies nothing."),
]


def archive(
    context: typer.Context,
    destination: Destination,
    source: Source = None,
    config: BenchFile = None,
    watch: Watch = False,
    limit_MB_per_s: Limit = None,
    delete_after_days: DeleteAfter = None,
    verify: Verify = False,
    connection: Connection = DEFAULT,
    as_json: AsJson = False,
) -> None:
    """Copy whole recordings to an archive while the bench is idle, and verify each copy.

    Copying stops as soon as the bench records, is enabled or runs a plan, and goes on from there
    with the next run; without a daemon the bench counts as idle. With -c it asks the daemon of that
    bench file. Exit code 1 if something could not be archived, or differs.
    """
    if ":/" in str(destination) and not destination.exists():
        raise typer.BadParameter(f"{destination} is a URL: mount it, and name the folder")
    bytes_per_s = None if limit_MB_per_s is None else limit_MB_per_s * 1e6
    if verify:
        if watch or delete_after_days is not None:
            raise typer.BadParameter(
                "--verify only reads: leave --watch and --delete-after-days out"
            )
        _verify(destination, bytes_per_s, as_json=as_json)
        return
    folder = _folder(source, config)
    if config is not None and not _names_a_daemon(context):
        connection = _daemon_of(config)
    with _idleness(connection) as why_busy:
        from motord.archive.archive import RecordingArchive
        from motord.archive.pace import Pace

        pace = Pace(bytes_per_s, why_busy, on_busy=_say_waiting if watch else None)
        kept = RecordingArchive(folder, destination, pace)
        if watch:
            _watch(kept, delete_after_days, as_json=as_json)
            return
        report = _round(kept, delete_after_days, as_json=as_json)
    print_result(asdict(report), _summary(report), as_json)
    _remark(report)
    if report.stopped or report.conflicts:
        raise typer.Exit(1)


def _folder(source: Path | None, config: Path | None) -> Path:
    from motord import config as config_file

    folder = source if source is not None else config_file.load(config).recording.directory
    if not folder.is_dir():
        fail(
            f"{folder.absolute()}: no folder of recordings; name it with --from (that of a bench "
            "file is relative to where the daemon was started)"
        )
    return folder


def _names_a_daemon(context: typer.Context) -> bool:
    """Return whether the command line does, whatever the environment names."""
    sources = map(context.get_parameter_source, ("bench", "connect", "identity"))
    return any(source is not None and source.name == "COMMANDLINE" for source in sources)


def _daemon_of(config: Path) -> Connection:
    from motord import config as config_file

    bench = config_file.load(config)
    return Connection(bench.bench.name, bench.zenoh.local[0])


class _Idleness:
    """Says why the bench is needed; no daemon, or none that can be reached, is an idle bench."""

    def __init__(self, benches: "Benches", bench: str | None) -> None:
        self._benches, self._bench = benches, bench

    def __call__(self) -> str:
        for error in tuple(self._benches.unreachable.values()):
            if error.code == "forbidden":
                return str(error)
        for entry in self._benches.entries():
            if self._bench in (None, entry.bench) and (why := entry.needed_for):
                return why
        return ""

    def settle(self) -> None:
        """Wait until the state of each bench that is there has come, if it comes."""
        end_s = time.monotonic() + SETTLE_S
        while time.monotonic() < end_s and not self._benches.unreachable:
            entries = self._benches.entries()
            if entries and not any(entry.silent for entry in entries):
                return
            self._benches.wait(0.1)


@contextmanager
def _idleness(connection: Connection) -> "Iterator[_Idleness]":
    from motord.client.benches import Benches

    with Benches(connection.endpoints, connection.identity) as benches:
        idleness = _Idleness(benches, connection.bench)
        idleness.settle()
        for error in (e for e in benches.unreachable.values() if e.code == "unreachable"):
            remark(f"{error} Without a daemon there the bench counts as idle")
        yield idleness


def _round(
    kept: "RecordingArchive", delete_after_days: float | None, *, as_json: bool
) -> "ArchiveReport":
    from motord.archive.selection import select

    def copied(name: str, manifest: "ArchiveManifest") -> None:
        if not as_json:
            print_line(f"archived {name}, {manifest.bytes / 1e6:.1f} MB, {manifest.sha256[:12]}")

    return kept.update(select(kept.source), delete_after_days, copied)


def _watch(kept: "RecordingArchive", delete_after_days: float | None, *, as_json: bool) -> None:
    """Archive again and again; say what is new, and each trouble once."""
    from motord.recording.json_encoding import to_line

    before: tuple[object, ...] = ()
    while True:
        report = _round(kept, delete_after_days, as_json=as_json)
        trouble = (report.stopped, report.conflicts, report.unfinished)
        if as_json and (report.copied or report.deleted or trouble != before):
            print_line(to_line(asdict(report)).decode())
        elif trouble != before:
            _remark(report)
        before = trouble
        time.sleep(TROUBLE_S if report.stopped and not report.paused else ROUND_S)


def _say_waiting(why: str) -> None:
    remark(f"waiting: {why}" if why else "goes on")


def _summary(report: "ArchiveReport") -> str:
    parts = [f"{len(report.copied)} copied", f"{report.there} archived before"]
    for count, what in (
        (len(report.deleted), "deleted here"),
        (len(report.being_written), "being written"),
        (len(report.unfinished), "unfinished"),
        (len(report.conflicts), "not archived"),
    ):
        parts += [f"{count} {what}"] if count else []
    return ", ".join(parts)


def _remark(report: "ArchiveReport") -> None:
    """Say on stderr what could not be archived, and why."""
    for name in report.unfinished:
        remark(f"{name}: unfinished; the next daemon closes it, or `motord record recover` does")
    for problem in report.conflicts.values():
        remark(problem)
    if report.paused:
        remark(f"motord: stopped, as {report.stopped}; the next run goes on")
    elif report.stopped:
        remark(f"motord: {report.stopped}; nothing is lost, the next run goes on from there")


def _verify(destination: Path, bytes_per_s: float | None, *, as_json: bool) -> None:
    from motord.archive.archive import verify as reread
    from motord.archive.pace import Pace

    same, differing = 0, {}
    for name, problem in reread(destination, Pace(bytes_per_s)):
        if problem:
            differing[name] = problem
            remark(f"{name}: {problem}")
        else:
            same += 1
    result: dict[str, Any] = {"same": same, "differing": differing}
    print_result(result, f"{same} as archived, {len(differing)} not", as_json)
    if differing:
        raise typer.Exit(1)
