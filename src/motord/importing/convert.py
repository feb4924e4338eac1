"""`import_run`: a file that was recorded elsewhere becomes a run."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from motord.config import MotorFile
from motord.importing.column_map import Wiring
from motord.importing.csv.source import CsvSource
from motord.importing.mapping import ImportMap, load_map, load_mapped_motor
from motord.importing.point_builder import PointTeller
from motord.importing.problems import Problems
from motord.importing.remarks import on_rows, on_speed_and_points, on_torque
from motord.importing.rows import usable_rows
from motord.importing.source import RowSource
from motord.importing.survey import Survey, survey
from motord.importing.tdms import MAGIC, TdmsSource
from motord.importing.ticks import TickMaker
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.writer import RunWriter

UNIX_FROM_NS = 10**17
"""Times later than this (1973) count as Unix times."""

SURVEY_SHARE = 0.4
"""Part of the work that the first pass is."""

CHUNK_S = 1.0

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Imported:
    """What has been written to `path`: ticks; points as told in `/operating_point`; problems: what
    was wrong, by kind, in words; notes: what was assumed, in words."""

    path: Path
    ticks: int
    duration_s: float
    rate_Hz: float
    missed: int
    points: tuple[dict[str, Any], ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {**vars(self), "path": str(self.path)}


def import_run(
    path: Path,
    map_path: Path,
    output: Path,
    *,
    strict: bool = False,
    progress: Progress = lambda done: None,
) -> Imported:
    """Write the recording `path` (CSV or TDMS) as the run `output`, as the map file says.

    strict: rows that lack something are an error. progress is called with the share of the work
    done, 0 to 1. Raises ConfigError for what is wrong with the map or the motor file, RecordError
    for the rest; `output` is then not there.
    """
    map_text, mapping = load_map(map_path)
    motor_text, motor_file = load_mapped_motor(map_path, mapping)
    part = part_of(output)
    for taken in (output, part):
        if taken.exists():
            raise RecordError(f"{taken}: exists already; choose another name or remove it")
    try:
        with _opened(path, mapping, output.parent) as source:
            wiring = Wiring(source, mapping, motor_file.motor.counts)
            seen = survey(source, wiring, mapping, lambda done: progress(SURVEY_SHARE * done))
            anchor_ns, anchor_words = _anchor(source.path, mapping, seen)
            metadata = _metadata(path, map_text, mapping, motor_text, motor_file)
            with RunWriter(output, metadata, chunk_s=CHUNK_S) as writer:
                job = _Job(source, wiring, mapping, motor_file, seen, anchor_ns)
                return job.write(writer, strict, anchor_words, progress)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def _opened(path: Path, mapping: ImportMap, scratch: Path) -> Iterator[RowSource]:
    try:
        with path.open("rb") as file:
            is_tdms = path.suffix.lower() == ".tdms" or file.read(len(MAGIC)) == MAGIC
        scratch.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(f"{error.filename or path}: {error.strerror}") from error
    if is_tdms:
        with TdmsSource(path, mapping.tdms, scratch) as source:
            yield source
    else:
        names = [c.column for c in mapping.columns.values() if c.column]
        yield CsvSource(path, mapping.csv, names)


def _anchor(path: Path, mapping: ImportMap, seen: Survey) -> tuple[int, list[str]]:
    """Return the Unix time of the zero of the source's times, and words about it."""
    if seen.first_ns >= UNIX_FROM_NS:
        unused = ["the times are Unix times: start is not used"] if mapping.start else []
        return 0, unused
    if mapping.start is not None:
        return round(mapping.start.timestamp() * 1e6) * 1000, []
    last_ns = path.stat().st_mtime_ns
    return last_ns - seen.last_ns, ["nothing tells when it was: the last row is as old as the file"]


def _metadata(
    path: Path, map_text: str, mapping: ImportMap, motor_text: str, motor_file: MotorFile
) -> dict[str, object]:
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RecordError(f"{path}: cannot read it: {error.strerror}") from error
    return {
        "bench": path.stem,
        "motor": motor_file.motor.model_dump(mode="json"),
        "plan": {},
        "versions": {name: version(name) for name in ("motord", "numpy")},
        "config": motor_text,
        "calibration": "",
        "host": {},
        "realtime": {},
        "notes": mapping.notes,
        "source": {"file": path.name, "bytes": path.stat().st_size, "sha256": digest},
        "map": map_text,
    }


@dataclass(frozen=True)
class _Job:
    """The second pass."""

    source: RowSource
    wiring: Wiring
    mapping: ImportMap
    motor_file: MotorFile
    survey: Survey
    anchor_ns: int

    def write(
        self, writer: RunWriter, strict: bool, notes: list[str], progress: Progress
    ) -> Imported:
        """Write all ticks and operating points; return what was written. Raises RecordError."""
        problems, points, missed = Problems(self.source.unit), [], 0
        maker = TickMaker(self.source, self.wiring, self.survey, self.anchor_ns)
        teller = self._teller()
        names = tuple(dict.fromkeys((*self.wiring.fields,)))
        for rows in usable_rows(self.source, self.wiring, names, problems):
            ticks = maker.take(rows, problems)
            writer.ticks(ticks)
            missed = int(ticks["missed"][-1])
            for point in teller.take(ticks):
                writer.operating_point(point["t_end_ns"], point)
                points.append(point)
            progress(SURVEY_SHARE + (1 - SURVEY_SHARE) * rows.done)
        if strict and problems:
            raise RecordError(f"{self.source.path}: {'; '.join(problems.words())}")
        seen, rated_Nm = self.survey, self.motor_file.motor.rated_torque_Nm
        given = {*self.wiring.fields, *self.wiring.constants}
        remarks = [
            *on_rows(problems, seen),
            *on_torque(given, points, maker.torque_largest_Nm, rated_Nm),
            *on_speed_and_points(given, points),
        ]
        result = Imported(
            path=writer.path,
            ticks=seen.rows,
            duration_s=(seen.last_ns - seen.first_ns) * 1e-9,
            rate_Hz=1 / seen.period_s,
            missed=missed,
            points=tuple(points),
            problems=tuple(problems.words()),
            notes=(*self.source.notes, *self.wiring.notes, *notes, *remarks),
        )
        account = {"problems": problems.to_json(), "notes": result.notes}
        end_ns = seen.last_ns + self.anchor_ns
        writer.event(end_ns, "import", f"imported {self.source.path.name}", account)
        writer.close({"reason": "imported"})
        return result

    def _teller(self) -> PointTeller:
        split, motor = self.mapping.split, self.motor_file.motor
        return PointTeller(
            self.survey.stretches,
            split.min_turns if split else 1,
            self.motor_file.torque_sensor.highpass_time_constant_s == 0,
            motor.rated_torque_Nm,
        )
