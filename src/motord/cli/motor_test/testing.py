"""One test of a motor: its plans on the bench, their analyses, the verdict, the certificate."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from motord.cli.connection_options import Connection
from motord.cli.console import explanation, phase_bars, remark
from motord.cli.results.store_options import AnalysisStorage

if TYPE_CHECKING:
    from motord.client import Client, Commander
    from motord.experiments.subject import Recordings
    from motord.verdict.certificate import Certificate
    from motord.verdict.motor_type import MotorType

    AnalysedRecordings = tuple[str, Mapping[str, Any], Recordings]


class MotorTestError(Exception):
    """A test that came to no verdict; the message says why. interrupted: by the operator."""

    def __init__(self, why: str, *, interrupted: bool = False) -> None:
        super().__init__(why)
        self.interrupted = interrupted


@dataclass(frozen=True)
class TestedMotor:
    """A certificate, its file, and why results are not in the store, "" if they are."""

    certificate: "Certificate"
    path: Path
    not_stored: str = ""


@dataclass(frozen=True)
class MotorTests:
    """What tests of motors have in common: file of their type, who tests, store and bench."""

    motor_type: Path
    operator: str | None
    store: str | None
    connection: Connection
    force: bool
    silent: bool

    def run(
        self, serial: str, recordings: Sequence[Path] = (), certificate: Path | None = None
    ) -> TestedMotor:
        """Test a motor, or decide from recordings; write the certificate, then store the results.

        certificate: its file, or the folder for a name of its own. Raises MotorTestError and what
        clients, analyses and files raise; once there is a certificate no more.
        """
        from motord.recording.file_names import stamp
        from motord.results.stored_result import file_digest
        from motord.verdict.motor_type import load_motor_type
        from motord.verdict.serial import certificate_name

        kind, digest = load_motor_type(self.motor_type), file_digest(self.motor_type)
        storages = self._storages(kind, serial)
        paths = recordings or self._run_plans(kind, serial)
        results: list[AnalysedRecordings] = []
        made = self._certificate(kind, digest, serial, paths, results)
        path = certificate or Path()
        if path.is_dir():
            path /= certificate_name(self.motor_type, serial, stamp(time.time_ns()))
        for used in (one for one in made.recordings if one.damage):
            remark(f"missing in {used.path}: {used.damage}")
        made.page().write(path)
        return TestedMotor(made, path, _store(storages, results))

    def _storages(self, kind: "MotorType", serial: str) -> dict[str, AnalysisStorage]:
        """Return where the results are to be stored, by analysis."""
        if self.store is None:
            return {}
        names = dict.fromkeys(limit.analysis for limit in kind.limit)
        return {name: AnalysisStorage(self.store, name, {}, serial) for name in names}

    def _certificate(
        self,
        kind: "MotorType",
        digest: str,
        serial: str,
        paths: Sequence[Path],
        results: "list[AnalysedRecordings]",
    ) -> "Certificate":
        """Analyse the recordings and decide; `results` gets what is to be stored."""
        from datetime import UTC, datetime
        from importlib.metadata import version

        from motord.client.holder import user_and_host
        from motord.verdict.certificate import Certificate
        from motord.verdict.figures import judge
        from motord.verdict.recordings import analyse

        def keep(*found: Any) -> None:
            results.append(found)

        with phase_bars(silent=self.silent) as progress:
            found, used = analyse(paths, kind, serial, progress, keep)
        return Certificate(
            motor_type=kind,
            type_file=str(self.motor_type),
            type_sha256=digest,
            serial=serial,
            operator=self.operator or user_and_host(),
            time=datetime.now(UTC),
            version=version("motord"),
            verdict=judge(kind, found),
            recordings=used,
            findings=tuple(_findings(found)),
        )

    def _run_plans(self, kind: "MotorType", serial: str) -> list[Path]:
        """Run the plans one after the other; return their recordings."""
        from motord.cli.bench.lease_session import in_command
        from motord.cli.plan.commands import closed_recording, follow
        from motord.verdict.serial import note_of

        if not kind.plan:
            raise MotorTestError(
                "the motor type has no [[plan]] to run; name recordings with --recordings"
            )
        found: list[Path] = []
        with self.connection.connect() as client:
            _check_bench(client, kind, serial)
            for plan in kind.plan:
                client.dry_run(plan.name, plan.settings)
            with in_command(client, force=self.force) as session:
                abort = _Abort(session.commander)
                for plan in kind.plan:
                    if not self.silent:
                        remark(f"{plan.name}, {len(found) + 1} of {len(kind.plan)}")
                    run = session.commander.run_plan(
                        plan.name, plan.settings, notes=note_of(kind.motor, serial), serial=serial
                    )
                    view = follow(run, abort, quiet=self.silent)
                    if view.state != "done":
                        why = f"{plan.name} {view.state}: {view.message}; nothing was decided"
                        raise MotorTestError(why, interrupted=abort.asked)
                    found.append(closed_recording(view))
        return found


@dataclass
class _Abort:
    """Aborts a plan when the operator interrupts its command, and knows that it came to that."""

    commander: "Commander"
    asked: bool = False

    def __call__(self) -> None:
        """Ramp down, disable, end the plan. Raises MotorTestError."""
        from motord.client import ClientError

        self.asked = True
        try:
            self.commander.abort_plan()
        except ClientError as error:
            raise MotorTestError(f"interrupted; {error}", interrupted=True) from error


def _store(storages: Mapping[str, AnalysisStorage], results: "Sequence[AnalysedRecordings]") -> str:
    """Store results where that is wanted; return why some are not stored, "" if all are."""
    from motord.results.error import ResultsError

    try:
        for name, result, recordings in results:
            if name in storages:
                storages[name].add(result, recordings)
    except (ResultsError, OSError) as error:
        return f"{explanation(error)}; the certificate is written"
    return ""


def _findings(results: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    for analysis, result in results.items():
        for one in result["findings"] or ():
            if one["severity"] != "note":
                yield analysis, one["severity"], one["name"]


def _check_bench(client: "Client", kind: "MotorType", serial: str) -> None:
    """Fail before anything moves if the bench file names another motor."""
    from motord.verdict.recordings import check_same_serial

    motor = client.config().config["motor"]
    if motor["name"] != kind.motor:
        raise MotorTestError(
            f"bench {client.bench} has the motor {motor['name']!r}, not {kind.motor!r}"
        )
    check_same_serial(f"bench {client.bench}", str(motor.get("serial", "")), serial)
