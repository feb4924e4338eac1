"""A file that was recorded elsewhere becomes a run."""

import hashlib
from collections.abc import Iterator, Sequence, Set
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from motord.config import MotorFile
from motord.importing.binary.mdf import MdfSource, begins_as_mdf
from motord.importing.binary.tdms import TdmsSource, begins_as_tdms
from motord.importing.column_map import ColumnMap
from motord.importing.csv.source import CsvSource
from motord.importing.mapping import ImportMap, load_map, load_mapped_motor
from motord.importing.point_builder import PointBuilder, remarks
from motord.importing.rows import usable_rows
from motord.importing.source import Problems, RowSource, readable
from motord.importing.survey import Progress, Survey, survey
from motord.importing.ticks import TickMaker
from motord.importing.times import hints
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of, require_free
from motord.recording.storage import make_folder
from motord.recording.writer import RunWriter

UNIX_FROM_NS = 10**17
"""Times later than this (1973) count as Unix times."""

SURVEY_SHARE = 0.4
"""Part of the work that the first pass is."""

CHUNK_S = 1.0

SPEED_RATIO = 2.0
"""Speed by position and time, in parts of the set-point or its inverse, that no control leaves."""

TORQUE_RATIO = 10.0
"""Torque, in parts of the rated one, that a motor hardly has."""

UNEVEN = "the rows are not evenly spaced: no missing ones are counted"

BACKWARDS = (
    "encoder_direction = -1 of the motor file is not applied: encoder_count has to rise forwards; "
    "turn one that falls by scale = -1"
)


@dataclass(frozen=True)
class Imported:
    """What was written to `path`. points: as in `/operating_point`; problems: what was wrong with
    rows, by kind, as text; notes: what was assumed, as text."""

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
    few_rows: bool = False,
    progress: Progress = lambda done: None,
) -> Imported:
    """Write the recording `path` (CSV, TDMS or MDF) as the run `output`, as the map file says.

    strict: rows that lack something are an error; few_rows: it is none if most rows are left out.
    progress is called with the share of the work done, 0 to 1. Raises ConfigError for what is
    wrong with the map or the motor file, RecordError for the rest; `output` is then not there.
    """
    map_text, mapping = load_map(map_path)
    motor_text, motor_file = load_mapped_motor(map_path, mapping)
    part = part_of(output)
    require_free(output, part)
    make_folder(output.parent)
    try:
        with ExitStack() as opened:
            source = _source(path, mapping, output.parent, opened)
            column_map = ColumnMap(source, mapping, motor_file.motor.counts)
            seen = survey(column_map, mapping, few_rows, lambda done: progress(SURVEY_SHARE * done))
            anchor_ns, anchor_notes = _anchor(source.path, mapping, seen)
            metadata = _metadata(path, map_text, mapping, motor_text, motor_file)
            with RunWriter(output, metadata, chunk_s=CHUNK_S) as writer:
                job = _Job(column_map, mapping, motor_file, seen, anchor_ns)
                return job.write(writer, strict, anchor_notes, progress)
    finally:
        part.unlink(missing_ok=True)


def _source(path: Path, mapping: ImportMap, scratch: Path, opened: ExitStack) -> RowSource:
    if path.suffix.lower() == ".tdms" or begins_as_tdms(path):
        return TdmsSource(path, mapping.tdms, scratch, opened)
    if path.suffix.lower() in (".mf4", ".mdf") or begins_as_mdf(path):
        return MdfSource(path, mapping.mdf, opened)
    return CsvSource(path, mapping.csv, [c.column for c in mapping.columns.values() if c.column])


def _anchor(path: Path, mapping: ImportMap, seen: Survey) -> tuple[int, list[str]]:
    """Return the Unix time of the zero of the source's times, and notes about it."""
    if seen.first_ns >= UNIX_FROM_NS:
        unused = ["the times are Unix times: start is not used"] if mapping.start else []
        return 0, unused
    if mapping.start is not None:
        return round(mapping.start.timestamp() * 1e6) * 1000, []
    last_ns = path.stat().st_mtime_ns
    return last_ns - seen.last_ns, ["no time of start is given: the last row is as old as the file"]


def _metadata(
    path: Path, map_text: str, mapping: ImportMap, motor_text: str, motor_file: MotorFile
) -> dict[str, object]:
    with readable(path), path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
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

    column_map: ColumnMap
    mapping: ImportMap
    motor_file: MotorFile
    survey: Survey
    anchor_ns: int

    @property
    def _counts_backwards(self) -> bool:
        counts = self.column_map.position_field == "encoder_count"
        return counts and self.motor_file.motor.encoder_direction < 0

    def write(
        self, writer: RunWriter, strict: bool, notes: list[str], progress: Progress
    ) -> Imported:
        """Write all ticks and operating points; return what was written. Raises RecordError."""
        source = self.column_map.source
        problems, points, missed = Problems(source.unit), [], 0
        maker = TickMaker(self.column_map, self.survey, self.anchor_ns)
        split, motor = self.mapping.split, self.motor_file.motor
        builder = PointBuilder(
            self.survey.segments,
            split.min_turns if split else 1,
            self.motor_file.torque_sensor.passes_mean,
            motor,
        )
        fields, held = self.column_map.fields, self.column_map.held
        for rows in usable_rows(self.column_map, fields, held, problems):
            ticks = maker.take(rows, problems)
            writer.ticks(ticks)
            missed = int(ticks["missed"][-1])
            for point in builder.take(ticks):
                writer.operating_point(point["t_end_ns"], point)
                points.append(point)
            progress(SURVEY_SHARE + (1 - SURVEY_SHARE) * rows.done)
        if strict and problems:
            raise RecordError(f"{source.path}: {'; '.join(problems.messages())}")
        seen, given = self.survey, {*self.column_map.fields, *self.column_map.constants}
        remarked = [
            *([] if seen.regular else [UNEVEN]),
            *([BACKWARDS] if self._counts_backwards else []),
            *hints(problems, seen.rows, self.column_map.position_field),
            *_on_torque(given, points, maker.torque_largest_Nm, motor.rated_torque_Nm),
            *remarks(builder.of_currents, motor.rated_torque_Nm),
            *_on_speed(given, points),
            *_on_points(points, split is not None),
        ]
        result = Imported(
            path=writer.path,
            ticks=seen.rows,
            duration_s=(seen.last_ns - seen.first_ns) * 1e-9,
            rate_Hz=1 / seen.period_s,
            missed=missed,
            points=tuple(points),
            problems=tuple(problems.messages()),
            notes=(*source.notes, *self.column_map.notes, *notes, *remarked),
        )
        account = {"problems": problems.to_json(), "notes": result.notes}
        end_ns = seen.last_ns + self.anchor_ns
        writer.event(end_ns, "import", f"imported {source.path.name}", account)
        writer.close({"reason": "imported"})
        return result


def _on_torque(
    given: Set[str], points: Sequence[dict[str, Any]], largest_Nm: float, rated_Nm: float
) -> Iterator[str]:
    """Yield remarks on torque. largest_Nm: the largest that was measured."""
    if "torque_Nm" not in given:
        yield "no torque: only what needs none can be analysed"
    if largest_Nm > TORQUE_RATIO * rated_Nm:
        yield f"the torque reaches {largest_Nm:g} Nm, {rated_Nm:g} Nm is rated: is its scale right?"
    if "torque_set_Nm" not in given and points:
        yield f"torque of the operating points: {points[0]['torque_source']}"


def _on_speed(given: Set[str], points: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield remarks on speed."""
    if not {"speed_rad_s", "speed_Hz"} & given:
        yield "speed: from angle and time"
    for point in points:
        mean_Hz, set_Hz = abs(point["speed_mean_Hz"]), abs(point["speed_Hz"])
        if set_Hz and not 1 / SPEED_RATIO < mean_Hz / set_Hz < SPEED_RATIO:
            yield (
                f"by position and time operating point {point['index']} turns at {mean_Hz:.3g} "
                f"turns/s, its set-point is {set_Hz:.3g}: are the scales of position, time and "
                "set-point right?"
            )
            return


def _on_points(points: Sequence[dict[str, Any]], split: bool) -> Iterator[str]:
    """Yield a remark if there is no operating point. split: whether the map cuts the file."""
    if points:
        return
    if split:
        yield "no operating point: the rotor never turns a whole turn at constant set-points"
    else:
        yield (
            "no operating point: without [split] the file is one, and it ends less than a turn "
            "from where it begins; cut it by [split] where the set-points change"
        )
