"""`motord test`: a motor against the limits of its type, with a certificate."""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import ResultAsJson
from motord.cli.connection_options import DEFAULT, Connection, Force
from motord.cli.console import fail, phase_bars, print_json, remark
from motord.cli.results.store_options import AnalysisStorage, Store

if TYPE_CHECKING:
    from motord.client import Client
    from motord.experiments.subject import Recordings
    from motord.report.text import TextTable
    from motord.verdict.certificate import Certificate
    from motord.verdict.motor_type import MotorType

EXIT_CODES = {"pass": 0, "fail": 3, "undecidable": 4}

RunFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--recordings", metavar="RUN.mcap ...",
        help="Decide from recordings that exist, and run nothing.",
    ),
]  # fmt: skip


def run_test(
    motor_type: Annotated[
        Path, typer.Argument(metavar="MOTOR-TYPE", help="Plans and limits, a TOML file.")
    ],
    more: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUN...]", help="More recordings after --recordings."),
    ] = None,
    serial: Annotated[
        str | None,
        typer.Option(
            metavar="S", help="The motor's serial number; of recordings, by default as recorded."
        ),
    ] = None,
    recordings: RunFiles = None,
    certificate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The certificate, HTML; default: TYPE-SERIAL-TIME.html here."
        ),
    ] = None,
    operator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Who tests; default: user and host.")
    ] = None,
    store: Store = None,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: ResultAsJson = False,
) -> None:
    """Run the plans of a motor type on the bench, compare with its limits, write a certificate.

    Ends with 0 if the motor passes, 3 if it fails, 4 if that cannot be decided by the uncertainty
    of the measurement, 1 for errors. Ctrl-C aborts the plan under way, ramping down.
    """
    from motord.recording.file_names import stamp
    from motord.verdict.motor_type import load_motor_type
    from motord.verdict.serial import certificate_name, check_serial

    if more and not recordings:
        raise typer.BadParameter(f"{more[0]}: recordings come after --recordings")
    paths = [*(recordings or []), *(more or [])]
    serial = check_serial(_recorded_serial(paths) if serial is None else serial)
    kind = load_motor_type(motor_type)
    _require_folder(certificate)
    storages = {} if store is None else _storages(store, kind, serial)
    paths = paths or _run(connection, kind, serial, force=force, quiet=as_json)
    made = _certificate(kind, motor_type, serial, operator, paths, storages, silent=as_json)
    path = certificate or Path(certificate_name(motor_type, serial, stamp(time.time_ns())))
    made.page().write(path)
    if as_json:
        print_json({**made.to_json(), "certificate": str(path)})
    else:
        _print(made, path)
    raise typer.Exit(EXIT_CODES[made.verdict.decision])


def _recorded_serial(paths: Sequence[Path]) -> str:
    """Return the serial number of recordings; the usage is wrong if they do not name one."""
    from motord.recording.reader import open_run
    from motord.verdict.recordings import recorded_serials

    serials = {serial for path in paths for serial in recorded_serials(open_run(path))}
    if len(serials) != 1:
        named = f"the recordings name {', '.join(sorted(serials)) or 'none'}: " if paths else ""
        raise typer.BadParameter(f"{named}which serial number? --serial S")
    return serials.pop()


def _require_folder(certificate: Path | None) -> None:
    """Fail before anything moves if the certificate could not be written."""
    folder = certificate.parent if certificate else Path()
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        fail(f"{folder}: the certificate could not be written there")
    if certificate is not None and certificate.is_dir():
        fail(f"{certificate}: is a folder; name a file for the certificate")


def _storages(store: Path, kind: "MotorType", serial: str) -> dict[str, AnalysisStorage]:
    """Return where the results are to be stored, by analysis."""
    names = dict.fromkeys(limit.analysis for limit in kind.limit)
    return {name: AnalysisStorage(store, name, {}, serial) for name in names}


def _certificate(
    kind: "MotorType",
    file: Path,
    serial: str,
    operator: str | None,
    paths: Sequence[Path],
    storages: Mapping[str, AnalysisStorage],
    *,
    silent: bool,
) -> "Certificate":
    """Analyse the recordings, store the results where that is wanted, and decide."""
    from datetime import UTC, datetime
    from importlib.metadata import version

    from motord.client.holder import user_and_host
    from motord.verdict.certificate import Certificate
    from motord.verdict.judgement import judge
    from motord.verdict.recordings import analyse, sha256_of

    def stored(name: str, result: Mapping[str, Any], recordings: "Recordings") -> None:
        if name in storages:
            storages[name].add(result, recordings)

    with phase_bars(silent=silent) as progress:
        results, used = analyse(paths, kind, serial, progress, stored)
    return Certificate(
        motor_type=kind,
        type_file=str(file),
        type_sha256=sha256_of(file),
        serial=serial,
        operator=operator or user_and_host(),
        time=datetime.now(UTC),
        version=version("motord"),
        verdict=judge(kind, results),
        recordings=used,
        findings=tuple(_findings(results)),
    )


def _findings(results: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    for analysis, result in results.items():
        for one in result["findings"] or ():
            if one["severity"] != "note":
                yield analysis, one["severity"], one["name"]


def _run(
    connection: Connection, kind: "MotorType", serial: str, *, force: bool, quiet: bool
) -> list[Path]:
    """Run the plans one after the other; return their recordings."""
    from motord.cli.bench.lease_session import in_command
    from motord.cli.plan.commands import closed_recording, follow
    from motord.verdict.serial import note_of

    if not kind.plan:
        fail("the motor type has no [[plan]] to run; name recordings with --recordings")
    found: list[Path] = []
    with connection.open() as client:
        _check_bench(client, kind, serial)
        for plan in kind.plan:
            client.dry_run(plan.name, plan.settings)
        with in_command(client, force=force) as session:
            for plan in kind.plan:
                if not quiet:
                    remark(f"{plan.name}, {len(found) + 1} of {len(kind.plan)}")
                notes = note_of(kind.motor, serial)
                run = session.commander.run_plan(
                    plan.name, plan.settings, notes=notes, serial=serial
                )
                view = follow(run, session.commander, quiet=quiet)
                if view.state != "done":
                    fail(f"{plan.name} {view.state}: {view.message}; nothing was decided")
                found.append(closed_recording(view))
    return found


def _check_bench(client: "Client", kind: "MotorType", serial: str) -> None:
    """Fail before anything moves if the bench file names another motor."""
    from motord.verdict.recordings import check_same_serial

    motor = client.config().config["motor"]
    if motor["name"] != kind.motor:
        fail(f"bench {client.bench} has the motor {motor['name']!r}, not {kind.motor!r}")
    check_same_serial(f"bench {client.bench}", str(motor.get("serial", "")), serial)


def _print(made: "Certificate", path: Path) -> None:
    from motord.cli.analysis_command import print_files, print_text

    print_text(_text(made))
    print_files(path)


def _text(made: "Certificate") -> "Iterator[str | TextTable]":
    from motord.report.text import TextTable
    from motord.verdict.certificate import label, measured, percent

    yield TextTable(
        f"{made.motor_type.motor}, serial {made.serial}",
        ("figure", "low", "high", "value", "conforms", "decision"),
        [
            (
                label(one.figure),
                "" if one.tolerance.low is None else f"{one.tolerance.low:g}",
                "" if one.tolerance.high is None else f"{one.tolerance.high:g}",
                measured(one, "+-"),
                "" if one.probability is None else percent(one.probability),
                one.decision,
            )
            for one in made.verdict.figures
        ],
        left=(0,),
    )
    for reason in made.verdict.reasons():
        yield f"- {reason}"
    yield f"verdict: {made.verdict.decision}"
