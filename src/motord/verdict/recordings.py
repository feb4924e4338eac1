"""The recordings that a verdict rests on: what they are of, their digests, their analyses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from motord.experiments.recording_checks import check_given_once, naming_causes
from motord.experiments.subject import (
    AnalysisError,
    PhaseProgress,
    Recordings,
    motor_serial,
    plan_name,
)
from motord.recording.damage import utc
from motord.recording.reader import Run, open_run
from motord.results.stored_result import file_digest
from motord.verdict.motor_type import MotorType, analysis_of
from motord.verdict.serial import note_of

if TYPE_CHECKING:
    from motord.experiments.analysis import Analysis


@dataclass(frozen=True)
class UsedRecording:
    """A recording; start: UTC, "" if it does not say; damage: text of what is missing of it.

    calibration: id of the one that was applied, "" if none was.
    """

    path: str
    sha256: str
    plan: str
    start: str
    damage: str
    calibration: str = ""


def analyse(
    paths: Sequence[Path],
    motor_type: MotorType,
    serial: str,
    progress: PhaseProgress = lambda phase, fraction: None,
    analysed: Callable[[str, Mapping[str, Any], Recordings], None] = lambda *_: None,
) -> tuple[dict[str, Mapping[str, Any]], tuple[UsedRecording, ...]]:
    """Return the JSON results by analysis, of those that have limits, and the recordings.

    Recordings of one analysis are analysed together. analysed: called with each analysis' name,
    result and recordings. Raises AnalysisError for one that is of another motor or given twice, and
    what analyses raise.
    """
    runs = [open_run(path) for path in paths]
    for run in runs:
        _check_motor(run, motor_type, serial)
    check_given_once(runs)
    digests = [file_digest(path) for path in paths]
    limited = {limit.analysis for limit in motor_type.limit}
    groups: dict[str, list[Run]] = {}
    for run in runs:
        kind = analysis_of(plan_name(run))
        if kind is not None and kind.name in limited:
            groups.setdefault(kind.name, []).append(run)
    results = {}
    for name, group in groups.items():
        recordings = Recordings(tuple(group), None, progress)
        results[name] = _result(name, recordings)
        analysed(name, results[name], recordings)
    used = tuple(_used(run, digest) for run, digest in zip(runs, digests, strict=True))
    return results, used


def _result(name: str, recordings: Recordings) -> Mapping[str, Any]:
    kind = analysis_of(name)
    assert kind is not None
    analysis: Analysis[Any] = resolve_name(kind.command)
    with naming_causes(recordings.runs):
        return analysis.to_json(analysis.estimate(recordings), recordings)


def _check_motor(run: Run, motor_type: MotorType, serial: str) -> None:
    name = run.motor_metadata.get("name", "")
    if name != motor_type.motor:
        raise AnalysisError(
            f"{run.path}: is of the motor {name!r}; the motor type is for {motor_type.motor!r}"
        )
    for known in recorded_serials(run):
        check_same_serial(str(run.path), known, serial)


def recorded_serials(run: Run) -> set[str]:
    """Return the serial numbers that a recording has: of its motor, of the notes of a test."""
    noted = note_of(str(run.motor_metadata.get("name", "")))
    lines = str(run.metadata.get("notes", "")).splitlines()
    serials = {line.removeprefix(noted) for line in lines if line.startswith(noted)}
    return {*serials, motor_serial(run)} - {""}


def check_same_serial(where: str, known: str, serial: str) -> None:
    """Raise AnalysisError if a bench or a recording names the serial number of another motor."""
    if known not in ("", serial):
        raise AnalysisError(f"{where}: is of serial number {known!r}, not {serial!r}")


def _used(run: Run, digest: str) -> UsedRecording:
    start_ns, damage = run.end.get("t_start_ns"), run.damage
    compensates = run.plan_metadata.get("settings", {}).get("compensate", "off") != "off"
    return UsedRecording(
        path=str(run.path),
        sha256=digest,
        plan=plan_name(run),
        start=utc(start_ns) if isinstance(start_ns, int) else "",
        damage=str(damage) if damage else "",
        calibration=str(run.metadata.get("calibration", "")) if compensates else "",
    )
