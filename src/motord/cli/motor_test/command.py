"""`motord test`: a motor against the limits of its type, with a certificate."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.common_options import ResultAsJson, check_output_files
from motord.cli.connection_options import DEFAULT, Connection, Force
from motord.cli.console import fail, print_json
from motord.cli.motor_test.station import run_station
from motord.cli.motor_test.testing import MotorTests
from motord.cli.results.store_options import Store

if TYPE_CHECKING:
    from motord.report.text import TextTable
    from motord.verdict.certificate import Certificate

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
    station: Annotated[
        bool,
        typer.Option(
            "--station",
            help="Test one motor after the other: each line of standard input, as a bar-code "
            "reader types it, is a serial number.",
        ),
    ] = False,
    certificate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The certificate, HTML; default: TYPE-SERIAL-TIME.html here. With --station the "
            "folder of the certificates.",
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
    of the measurement, 1 for errors. Ctrl-C aborts the plan under way, ramping down; it ends
    --station, as the end of its input does, then with 0 if each test came to a verdict, else 1.
    """
    from motord.cli.analysis_command import print_files, print_text
    from motord.verdict.serial import check_serial

    tests = MotorTests(motor_type, operator, store, connection, force, silent=as_json)
    paths = [*(recordings or []), *(more or [])]
    if station:
        if paths or serial is not None:
            raise typer.BadParameter("--station reads serial numbers: leave out --serial and RUN")
        _require_folder(certificate or Path())
        raise typer.Exit(run_station(tests, certificate or Path(), as_json=as_json))
    if more and not recordings:
        raise typer.BadParameter(f"{more[0]}: recordings come after --recordings")
    serial = check_serial(_recorded_serial(paths) if serial is None else serial)
    check_output_files({"--certificate": certificate}, [motor_type, *paths])
    if certificate is None:
        _require_folder(Path())
    tested = tests.run(serial, paths, certificate)
    if as_json:
        print_json({**tested.certificate.to_json(), "certificate": str(tested.path)})
    else:
        print_text(_text(tested.certificate))
        print_files(tested.path)
    if tested.not_stored:
        fail(tested.not_stored)
    raise typer.Exit(EXIT_CODES[tested.certificate.verdict.decision])


def _recorded_serial(paths: Sequence[Path]) -> str:
    """Return the serial number of recordings; the usage is wrong if they do not name one."""
    from motord.recording.reader import open_run
    from motord.verdict.recordings import recorded_serials

    serials = {serial for path in paths for serial in recorded_serials(open_run(path))}
    if len(serials) != 1:
        named = f"the recordings name {', '.join(sorted(serials)) or 'none'}: " if paths else ""
        raise typer.BadParameter(f"{named}which serial number? --serial S")
    return serials.pop()


def _require_folder(folder: Path) -> None:
    """Fail before anything moves if no certificate could be written to a folder."""
    if not folder.is_dir():
        fail(f"{folder}: no such folder for the certificate")
    if not os.access(folder, os.W_OK):
        fail(f"{folder}: no permission to write the certificate there")


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
                measured(one),
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
