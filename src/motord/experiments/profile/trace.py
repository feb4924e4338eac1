"""Torque and speed over time, from a CSV file; whatever is wrong is named with file and line."""

import hashlib
import math
import stat
from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np

from motord.config import packaged
from motord.sequencing import PlanError

MAX_BYTES = 32 * 1024 * 1024
"""Largest file."""

MAX_ROWS = 1_000_000

SHORTEST_S, LONGEST_S = 1.0, 24 * 3600.0
"""Time from the first row to the last."""

PER_UNIT = {
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "torque": {"Nm": 1.0, "mNm": 1e-3},
    "speed": {"Hz": 1.0, "rpm": 1 / 60, "rad_s": 0.5 / math.pi, "rad_per_s": 0.5 / math.pi},
}
"""How many s, Nm and turns a second there are in each unit, by the column's name up to its unit."""

COLUMNS = "time_s, torque_Nm and speed_Hz (or time_ms, torque_mNm, speed_rpm, speed_rad_per_s)"

BETWEEN = "between them it is interpolated"

VALUE_MAX = 1e12
"""Beyond it a cell is no torque, speed or time."""

SHOWN = 40
"""Characters of a cell that a message shows."""


@dataclass(frozen=True)
class Trace:
    """Torque and speed over time, straight between rows; n rows, time rising strictly from 0.

    file: its name as given; sha256: digest of its content; line (n,): of each row in the file.
    """

    file: str
    sha256: str
    line: np.ndarray
    time_s: np.ndarray
    torque_Nm: np.ndarray
    speed_Hz: np.ndarray

    @property
    def duration_s(self) -> float:
        """Time of the last row."""
        return float(self.time_s[-1])

    @property
    def energy_J(self) -> float:
        """Mechanical energy: the integral of torque times speed."""
        (t0, t1), (n0, n1) = ((v[:-1], v[1:]) for v in (self.torque_Nm, self.speed_Hz))
        sums = 2 * (t0 * n0 + t1 * n1) + t0 * n1 + t1 * n0
        return float((np.diff(self.time_s) * sums).sum()) * math.pi / 3

    def scaled(self, torque_factor: float, speed_factor: float) -> "Trace":
        """Return the trace with torques and speeds multiplied by these factors."""
        return replace(
            self, torque_Nm=torque_factor * self.torque_Nm, speed_Hz=speed_factor * self.speed_Hz
        )

    def row_at(self, time_s: float) -> int:
        """Return the last row whose time has come."""
        row = int(np.searchsorted(self.time_s, time_s, side="right")) - 1
        return min(max(row, 0), self.line.size - 1)

    def refused(self, row: int, why: str) -> PlanError:
        """Return the error that refuses a row."""
        return PlanError(f"profile: {self.file}:{self.line[row]}: {why}")

    def refuse_first(self, wrong: np.ndarray, why: Callable[[int], str]) -> None:
        """Refuse the first row that is `wrong` (n,) of bool. Raises PlanError."""
        if wrong.any():
            row = int(np.argmax(wrong))
            raise self.refused(row, why(row))


def read(file: str, sha256: str = "") -> Trace:
    """Read a trace; sha256: what its content must have, if not "". Raises PlanError."""
    content = _content(file)
    digest = hashlib.sha256(content).hexdigest()
    if sha256 and digest != sha256:
        raise PlanError(
            f"profile: {file}: its content has changed: sha256 {digest[:12]}..., not "
            f"{sha256[:12]}...; put the file back as it was, or leave sha256 out"
        )
    try:
        content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise PlanError(
            f"profile: {file}: not a text file in UTF-8 (byte {error.start}); save it as CSV UTF-8"
        ) from None
    line, columns = _Table(file, TextIOWrapper(BytesIO(content), encoding="utf-8-sig")).rows()
    time_s, torque_Nm, speed_Hz = columns
    trace = Trace(file, digest, line, time_s - time_s[0], torque_Nm, speed_Hz)
    _check_times(trace, time_s)
    return trace


def _content(file: str) -> bytes:
    """Return what is in a file. Raises PlanError."""
    packed = file.startswith("package:")
    path = packaged(file.removeprefix("package:")) if packed else _with_home(file)
    if path.suffix.lower() != ".csv" or not file.isprintable():
        raise PlanError(
            f"profile: file = {file[:SHOWN]!r}: the name of a CSV file ends in .csv; "
            "motord plan start profile --set file=/path/cycle.csv"
        )
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise PlanError(f"profile: {file}: is no file")
        with path.open("rb") as opened:
            content = opened.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise PlanError(
            f"profile: {file}: cannot read it: {why}; it is read on the daemon's machine, name it "
            "by its whole path there"
        ) from None
    if len(content) > MAX_BYTES:
        raise PlanError(
            f"profile: {file}: larger than {MAX_BYTES >> 20} MiB: take fewer rows, {BETWEEN}"
        )
    return content


def _with_home(file: str) -> Path:
    """Return a path with the home that it begins with, if there is that user."""
    try:
        return Path(file).expanduser()
    except RuntimeError:  # else "~anna" is a name like others
        return Path(file)


class _Table:
    """The lines of a file as rows of numbers, read one by one: others may run meanwhile."""

    def __init__(self, file: str, lines: Iterable[str]) -> None:
        self._file = file
        self._filled = ((n, text) for n, text in enumerate(lines, start=1) if _is_filled(text))
        self._header, header = next(self._filled, (0, ""))
        if not header:
            raise PlanError(f"profile: {file}: is empty; its first line names {COLUMNS}")
        self._separator = next((mark for mark in ";\t" if mark in header), ",")
        names = self._cells(header)
        self._names = [self._column(names, quantity) for quantity in PER_UNIT]
        self._places = [names.index(name) for name in self._names]

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lines (n,) and the columns (3, n), in s, Nm and Hz. Raises PlanError."""
        numbers, values = array("q"), array("d")
        for number, text in self._filled:
            if len(numbers) == MAX_ROWS:
                raise self._error(number, f"more than {MAX_ROWS} rows; take fewer, {BETWEEN}")
            cells = self._cells(text)
            numbers.append(number)
            values.extend([self._number(number, cells, place) for place in self._places])
        if len(numbers) < 2:
            raise PlanError(f"profile: {self._file}: has {len(numbers)} rows; it takes two")
        known = zip(PER_UNIT, self._names, strict=True)
        units = [_units(quantity)[name] for quantity, name in known]
        table = np.frombuffer(values).reshape(-1, 3).T * np.array(units)[:, None]
        return np.frombuffer(numbers, np.int64), table

    def _cells(self, text: str) -> list[str]:
        return [cell.strip().strip('"').strip() for cell in text.split(self._separator)]

    def _number(self, number: int, cells: Sequence[str], place: int) -> float:
        if place >= len(cells):
            missing = self._names[self._places.index(place)]
            raise self._error(
                number, f"has {len(cells)} columns, {missing} is in column {place + 1}"
            )
        text = cells[place]
        if self._separator != "," and "." not in text:
            text = text.replace(",", ".")
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not abs(value) <= VALUE_MAX:
            name = self._names[self._places.index(place)]
            what = "beyond 1e12" if math.isfinite(value) else "no finite number"
            raise self._error(number, f"{name} is {cells[place][:SHOWN]!r}, {what}")
        return value

    def _column(self, names: Sequence[str], quantity: str) -> str:
        """Return the name of the column of a quantity. Raises PlanError unless it is one."""
        known = _units(quantity)
        found = [name for name in names if name in known]
        if len(found) == 1:
            return found[0]
        if found:
            raise self._error(
                self._header, f"{quantity} is ambiguous: {', '.join(found)}; leave all but one out"
            )
        near = [name for name in names if name.lower().startswith(quantity)]
        what = f"{near[0][:SHOWN]!r} has no known unit" if near else f"no column of the {quantity}"
        raise self._error(self._header, f"{what}; the first line names {COLUMNS}")

    def _error(self, number: int, why: str) -> PlanError:
        return PlanError(f"profile: {self._file}:{number}: {why}")


def _is_filled(text: str) -> bool:
    return bool(text.strip(' \t\n;,"')) and not text.lstrip().startswith("#")


def _units(quantity: str) -> dict[str, float]:
    """Return how many of the basic unit there are in that of a column, by its name."""
    return {f"{quantity}_{unit}": factor for unit, factor in PER_UNIT[quantity].items()}


def _check_times(trace: Trace, time_s: np.ndarray) -> None:
    falls = np.diff(trace.time_s, prepend=-np.inf) <= 0

    def why(row: int) -> str:
        return (
            f"time {time_s[row]:.10g} s does not come after {time_s[row - 1]:.10g} s in line "
            f"{trace.line[row - 1]}: times must rise; sort the rows, leave repeated ones out"
        )

    trace.refuse_first(falls, why)
    if not SHORTEST_S <= trace.duration_s <= LONGEST_S:
        raise trace.refused(
            -1,
            f"lasts {trace.duration_s:.4g} s; from {SHORTEST_S:g} to {LONGEST_S:g} s can be played",
        )
