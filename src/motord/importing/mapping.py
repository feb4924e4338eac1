"""The map file: which column of a foreign recording is which field of a tick."""

import codecs
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from motord.config import (
    ConfigError,
    Finite,
    MotorFile,
    NonNegative,
    Positive,
    Section,
    load,
    read_toml,
)
from motord.config.named_files import resolve
from motord.config.reading import load_motor, validate
from motord.importing.dates import date_of
from motord.schema import TICK_DTYPE
from motord.section.complaints import suggestion

TICK_FIELDS = TICK_DTYPE.names or ()

IN_OTHER_UNITS = {"speed_Hz": "speed_rad_s", "speed_set_Hz": "speed_set_rad_s"}
"""Names in turns/s that a map may use, and the field of a tick that each becomes."""

TIME_S = "t_s"
SET_POINTS = ("torque_set_Nm", "speed_set_rad_s", "speed_set_Hz")
"""Names that a recording is usually split by; one that it does not have does not split it."""

KNOWN = (TIME_S, *IN_OTHER_UNITS, *TICK_FIELDS)
NOT_CONSTANT = (TIME_S, "t_ns", "tick", "encoder_count", "encoder_gray", "angle_rad")


def _known_field(name: str) -> str:
    if name not in KNOWN:
        raise ValueError("no field of a tick" + suggestion(name, KNOWN))
    return name


FieldName = Annotated[str, AfterValidator(_known_field)]


class Column(Section):
    """A column by its name, or by its position from 1 on; the field is scale x value + offset."""

    column: str = ""
    """Name of the column."""
    position: Annotated[int, Field(ge=1)] | None = None
    """Place of the column, from 1 on, instead of its name."""
    scale: Finite = 1.0
    """Factor to the field's unit."""
    offset: Finite = 0.0
    """Added after that, in the field's unit."""

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {"column": value}
        if isinstance(value, int) and not isinstance(value, bool):
            return {"position": value}
        return value

    @model_validator(mode="after")
    def _one_of_both(self) -> "Column":
        if bool(self.column) == (self.position is not None):
            raise ValueError("give either column (its name) or position (1 for the first)")
        if self.scale == 0:
            raise ValueError("scale must not be 0; give a fixed value in [constants]")
        return self

    @property
    def as_it_is(self) -> bool:
        """True if the field is the column's value without scale and offset."""
        return self.scale == 1.0 and self.offset == 0.0


class SplitMap(Section):
    """`[split]`: where one operating point ends and the next begins."""

    by: Annotated[tuple[str, ...], Field(min_length=1)]
    """Fields, or columns of the file that are no fields, which are constant during an operating
    point."""
    tolerance: NonNegative = 0.0
    """By how much they may differ within one."""
    settle_s: NonNegative = 0.0
    """Time left out at the beginning of each."""
    min_turns: Annotated[int, Field(ge=1)] = 2
    """Whole turns, from zero point to zero point, that a good one has."""


class CsvMap(Section):
    """`[csv]`: what cannot be seen from the file itself."""

    delimiter: Literal[",", ";", "\t", "|", " "] | None = None
    """Between columns; left out: found in the file."""
    decimal: Literal[".", ","] | None = None
    """Decimal sign; left out: found in the file."""
    header_line: Annotated[int, Field(ge=0)] | None = None
    """Line with the names of the columns, from 1 on; 0: there are none; left out: found in the
    file."""
    skip_lines: Annotated[int, Field(ge=0)] = 0
    """Lines left out at the beginning."""
    encoding: str | None = None
    """Such as utf-8, latin-1, utf-16; left out: found in the file."""
    comment: str = "#"
    """Lines that begin with it are left out."""
    date_format: str | None = None
    """How dates are written, as in Python's `strptime`: `%d.%m.%Y %H:%M:%S.%f`; left out: in ISO
    form. One without a day, such as `%H:%M:%S.%f`, counts from the first row's midnight, which
    `start` then is, one with a day but no year from New Year's Day of a year that has no 29
    February."""

    @field_validator("encoding")
    @classmethod
    def _known_encoding(cls, name: str | None) -> str | None:
        try:
            return None if name is None else codecs.lookup(name).name
        except (LookupError, ValueError):
            raise ValueError("no encoding of this name; utf-8, latin-1, utf-16 are some") from None

    @field_validator("date_format")
    @classmethod
    def _each_part_once(cls, date_format: str | None) -> str | None:
        try:
            date_of("", date_format or "")
        except re.error:
            raise ValueError("takes each part of a date once") from None
        except ValueError:
            pass  # no date is written so: rows say which
        return date_format

    @model_validator(mode="after")
    def _comma_once(self) -> "CsvMap":
        if self.delimiter == "," and self.decimal == ",":
            raise ValueError("delimiter and decimal cannot both be a comma")
        return self


class TdmsMap(Section):
    """`[tdms]`: what cannot be seen from the file itself."""

    group: str | None = None
    """Where channels named without their group are looked for; left out: in all."""


class MdfMap(Section):
    """`[mdf]`: what cannot be seen from the file itself."""

    group: str | None = None
    """Where channels named without their group are looked for: the name of its acquisition, or its
    number from 0 on if it has none; left out: in all."""


class ImportMap(Section):
    """A map file."""

    motor: Path
    """A file with `[motor]` and, if wanted, `[torque_sensor]`; or a bench file."""
    columns: Annotated[dict[FieldName, Column], Field(min_length=1)]
    """Field of a tick = column, or {column, scale, offset}; the field is scale x column + offset.
    """
    constants: dict[FieldName, Finite] = Field(default={})
    """Field of a tick = what it is in all rows."""
    split: SplitMap | None = None
    """Where one operating point ends and the next begins; left out: the file is one."""
    csv: CsvMap = CsvMap()
    """What cannot be seen from a CSV file itself."""
    tdms: TdmsMap = TdmsMap()
    """What cannot be seen from a TDMS file itself."""
    mdf: MdfMap = MdfMap()
    """What cannot be seen from an MDF file itself."""
    start: datetime | None = None
    """When t_s was 0; left out: the last row is as old as the file."""
    period_s: Positive | None = None
    """Time between rows where no column has the time."""
    notes: str = ""
    """Free text, for the recording."""

    @field_validator("start")
    @classmethod
    def _in_utc(cls, start: datetime | None) -> datetime | None:
        if start is None:
            return None
        start = start if start.tzinfo else start.replace(tzinfo=UTC)
        if start.year < 1971:
            raise ValueError("must be after 1970")
        return start

    @model_validator(mode="after")
    def _consistent(self) -> "ImportMap":
        given = (*self.columns, *self.constants)
        for name in self.constants:
            if name in self.columns:
                raise ValueError(f"{name} is both in [columns] and in [constants]; leave one out")
            if name in NOT_CONSTANT:
                raise ValueError(f"{name} in [constants]: it cannot be constant in a recording")
        for other, field in IN_OTHER_UNITS.items():
            if other in given and field in given:
                raise ValueError(f"{other} and {field} are the same; give one of them")
        if not {"encoder_count", "angle_rad"} & set(self.columns):
            raise ValueError("[columns] must have encoder_count or angle_rad")
        times = [TIME_S in self.columns, "t_ns" in self.columns, self.period_s is not None]
        if sum(times) > 1:
            raise ValueError("give one of t_s, t_ns (in [columns]) and period_s, not several")
        return self


def load_map(path: Path) -> tuple[str, ImportMap]:
    """Return text and content of a map file. Raises ConfigError naming file, line and key."""
    text, data = read_toml(path)
    return text, validate(ImportMap, path, text, data)


def load_mapped_motor(map_path: Path, mapping: ImportMap) -> tuple[str, MotorFile]:
    """Return text and content of the motor file, or bench file, that a map names.

    Raises ConfigError.
    """
    path = resolve(map_path, mapping.motor)
    if not path.is_file():
        raise ConfigError(f"{map_path}: motor: there is no file {path}")
    text, data = read_toml(path)
    if set(data) <= set(MotorFile.model_fields):
        return text, load_motor(path)
    bench = load(path)
    return text, MotorFile(motor=bench.motor, torque_sensor=bench.torque_sensor)
