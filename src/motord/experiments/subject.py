"""What was recorded: the bench, its motor and its torque sensor."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from motord.config import (
    AccuracyConfig,
    Config,
    MotorConfig,
    MotorFile,
    Section,
    TorqueSensorConfig,
    load,
    read_toml,
)
from motord.config.motor.accuracy import widest
from motord.config.reading import load_motor
from motord.identification.operating_points import good_points
from motord.recording.reader import Run, bounds_of, open_run
from motord.schema import rows_of
from motord.untrusted import parse_toml

Settings = TypeVar("Settings", bound=Section)


PhaseProgress = Callable[[str, float], None]
"""Called with what an analysis is doing, and the part of it that is done."""


class AnalysisError(Exception):
    """Recordings that cannot be analysed together; the message says which and what to do."""


@dataclass(frozen=True)
class Subject:
    """What was recorded: bench, motor and torque sensor, and what is known of their accuracy."""

    bench: str
    motor: MotorConfig
    sensor: TorqueSensorConfig
    accuracy: AccuracyConfig = field(default_factory=AccuracyConfig)
    magnet_channel: str = ""
    """The channel that a bench file has for the magnets' temperature; "": as each run says."""

    @property
    def lead(self) -> str:
        """Motor and bench, as the first line of a report."""
        return f"{self.motor.name} on bench {self.bench}"

    @classmethod
    def of_config(cls, config: Config) -> "Subject":
        """Return the subject of a bench."""
        channel = next((one.name for one in config.channels if one.role == "magnet"), "")
        return cls(config.bench.name, config.motor, config.torque_sensor, config.accuracy, channel)

    @classmethod
    def of_file(cls, path: Path) -> "Subject":
        """Return the subject of a bench file or of a motor file. Raises ConfigError."""
        if bench := bench_of(path):
            return cls.of_config(bench)
        file = load_motor(path)
        return cls(path.stem, file.motor, file.torque_sensor, file.accuracy)

    @classmethod
    def of_runs(cls, runs: Sequence[Run]) -> "Subject":
        """Return what the recordings say they are of. Raises AnalysisError if they differ.

        A serial number that only some of them name is that of all. Of accuracies that they state
        differently, the wider limit of each holds.
        """
        subjects = _with_serial([_recorded(run) for run in runs])
        for run, subject in zip(runs, subjects, strict=True):
            if (subject.motor, subject.sensor) != (subjects[0].motor, subjects[0].sensor):
                raise AnalysisError(
                    f"{run.path}: is of another motor or torque sensor than {runs[0].path}; "
                    "analyse them one by one, or name the bench file that holds for both with -c"
                )
        return replace(subjects[0], accuracy=widest([one.accuracy for one in subjects]))


@dataclass(frozen=True)
class Recordings:
    """Recordings that are analysed together, and the bench or motor file that was named, if any.

    progress: called by analyses that take long.
    """

    runs: tuple[Run, ...]
    config: Path | None = None
    progress: PhaseProgress = lambda phase, fraction: None

    @classmethod
    def open(
        cls,
        paths: Sequence[Path],
        config: Path | None = None,
        progress: PhaseProgress = lambda phase, fraction: None,
    ) -> "Recordings":
        """Open the files. Raises RecordError, OSError."""
        return cls(tuple(open_run(path) for path in paths), config, progress)

    @property
    def names(self) -> list[str]:
        """Return the files' names."""
        return [run.path.name for run in self.runs]

    @cached_property
    def subject(self) -> Subject:
        """Return what they are of. Raises AnalysisError, ConfigError.

        Where the file that was named has no serial number it is the recorded one.
        """
        if self.config is None:
            return Subject.of_runs(self.runs)
        named = Subject.of_file(self.config)
        recorded = {motor_serial(run) for run in self.runs} - {""}
        if named.motor.serial or len(recorded) != 1:
            return named
        return replace(named, motor=named.motor.model_copy(update={"serial": recorded.pop()}))

    @property
    def facts(self) -> list[tuple[str, str]]:
        """Rows (name, value) about bench, motor and recordings, as reports show them."""
        motor = self.subject.motor
        serial = f", serial {motor.serial}" if motor.serial else ""
        return [
            ("bench", self.subject.bench),
            (
                "motor",
                f"{motor.name}{serial}: {motor.slots} slots, {2 * motor.pole_pairs} poles, "
                f"{motor.counts} counts, {motor.rated_torque_Nm:g} Nm rated, {motor.connection}",
            ),
            ("recordings", ", ".join(self.names)),
        ]


def bench_of(path: Path) -> Config | None:
    """Return the bench of a bench file; None for a motor file. Raises ConfigError."""
    return None if set(read_toml(path)[1]) <= set(MotorFile.model_fields) else load(path)


def plan_name(run: Run) -> str:
    """Return the plan that a run is of, "" if it does not say."""
    return str(run.plan_metadata.get("name", ""))


def motor_serial(run: Run) -> str:
    """Return the serial number of the motor that a run is of, "" if it does not say."""
    return str(run.motor_metadata.get("serial", ""))


def check_plan(run: Run, *needed: str, hint: str = "; no imported recording names one") -> None:
    """Raise AnalysisError if a run is not of one of the plans; hint: for one that names none."""
    name = plan_name(run)
    if name not in needed:
        of_plan = f"is of the plan {name}" if name else "names no plan"
        raise AnalysisError(
            f"{run.path}: {of_plan}; needed: {' or '.join(needed)}{'' if name else hint}"
        )


def require_columns(run: Run, names: Iterable[str]) -> None:
    """Raise AnalysisError if a run has not all of the columns."""
    if missing := [name for name in names if name not in run.columns]:
        raise AnalysisError(f"{run.path}: the recording has no {', '.join(missing)}")


def check_applied(run: Run, calibration_id: str) -> None:
    """Raise AnalysisError if another calibration, or none, was in force during a run."""
    applied = str(run.metadata.get("calibration", ""))
    if applied != calibration_id:
        raise AnalysisError(
            f"{run.path}: was taken with calibration {applied or 'none'}, not with "
            f"{calibration_id}; name the calibration that was in force with --calibration"
        )


def plan_settings(
    recordings: Recordings, plan: str, section: type[Settings], *alike: str
) -> Settings:
    """Return `[plans.PLAN]` of the bench file that was named, else the settings as recorded.

    alike: names of those that all recordings have to agree in. Raises AnalysisError, ConfigError.
    """
    if recordings.config and (bench := bench_of(recordings.config)):
        return bench.plans.of(plan, section)
    hint = "; name a bench file with -c"
    first, *others = recordings.runs
    own = recorded_settings(first, section, hint)
    for run in others if alike else ():
        other = recorded_settings(run, section, hint)
        if differing := [name for name in alike if getattr(other, name) != getattr(own, name)]:
            raise AnalysisError(
                f"{run.path}: [plans.{plan}] differs from that of {first.path} in "
                f"{', '.join(differing)}; analyse them one by one, or name the bench file that "
                "holds for both with -c"
            )
    return own


def recorded_settings(run: Run, section: type[Settings], hint: str = "") -> Settings:
    """Return the settings that the plan of a run had, defaults for those that it does not name.

    Raises AnalysisError, with the hint, for values that are not allowed.
    """
    given = run.plan_metadata.get("settings", {})
    known = {name: value for name, value in given.items() if name in section.model_fields}
    try:
        return section.model_validate(known)
    except ValueError:
        raise AnalysisError(
            f"{run.path}: this version cannot read the settings of its plan{hint}"
        ) from None


def captured_ticks(run: Run, columns: Sequence[str]) -> Iterator[np.ndarray]:
    """Yield the ticks of each good operating point of a run, in time order.

    Ticks of which a column is missing (nan), as in a recording from elsewhere, are left out.
    """
    for point in good_points(run.operating_points()):
        ticks = run.ticks(("plan_point", *columns), **bounds_of(point))
        whole = ticks["plan_point"] == int(point["index"])
        for name in columns:
            whole &= np.isfinite(ticks[name])
        yield rows_of(ticks, whole)


def _with_serial(subjects: Sequence[Subject]) -> list[Subject]:
    """Return them with a serial number, where one of them names one."""
    known = {"serial": next(filter(None, (one.motor.serial for one in subjects)), "")}
    return [
        one if one.motor.serial else replace(one, motor=one.motor.model_copy(update=known))
        for one in subjects
    ]


def _recorded(run: Run) -> Subject:
    try:
        motor = MotorConfig.model_validate(run.metadata["motor"])
        bench = parse_toml(run.metadata["config"])
        sensor = TorqueSensorConfig.model_validate(bench.get("torque_sensor", {}))
        accuracy = AccuracyConfig.model_validate(bench.get("accuracy", {}))
    except (KeyError, TypeError, ValueError) as error:
        raise AnalysisError(
            f"{run.path}: does not say which motor and torque sensor it is of "
            f"({type(error).__name__}); name a bench file or motor file with -c"
        ) from None
    return Subject(str(run.metadata.get("bench", "")), motor, sensor, accuracy)
