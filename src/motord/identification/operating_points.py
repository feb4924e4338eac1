"""Operating points as samples: whole turns, currents at the instants of the torque samples."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from motord.identification import CaptureError, IdentifyError
from motord.identification.harmonics import lines_at
from motord.identification.orders import resolved_order
from motord.identification.resample import interpolate, rising, uncrowded
from motord.identification.signal_condition import (
    SignalFault,
    recorded,
    require_change,
    signal_faults,
    stuck_lines,
)
from motord.identification.turning import continuous_turns, countable
from motord.schema import rows_of

CURRENTS = ("i_a_A", "i_b_A", "i_c_A")
COMMANDS = ("i_cmd_a_A", "i_cmd_b_A", "i_cmd_c_A")
REQUIRED = ("t_ns", "encoder_count", *CURRENTS, "torque_Nm")

MAX_CURRENT_ORDER = 200
"""Highest order per turn that commanded currents are expected to have."""


def _label(recording: str, torque_Nm: float, speed_Hz: float) -> str:
    return f"{recording}: " * bool(recording) + f"{torque_Nm:g} Nm, {speed_Hz:g} Hz"


GOOD = "ok"
"""Quality of an operating point that was taken as it should be."""


@dataclass(frozen=True)
class PointData:
    """One captured operating point: its set-points and the ticks of its capture.

    ticks: structured array with at least the columns REQUIRED; with COMMANDS, `i_age_ns` and
    `sample_age_ns` where the source has them. compensate: 0 without compensation
    (schema.Compensate). induced: errors that were put on the currents on purpose
    (sequencing.Induced), so that its ripple is not the motor's; empty without. turns_from_start:
    whole turns count from the first sample, not from the encoder's zero. back_emf_factor: back-EMF
    over that of the motor's reference temperature; nan where it cannot be known. recording: name of
    its file; tick_start: tick at which it begins.
    """

    torque_Nm: float
    speed_Hz: float
    ticks: np.ndarray
    compensate: int = 0
    induced: Mapping[str, Any] = field(default_factory=dict)
    turns_from_start: bool = False
    back_emf_factor: float = 1.0
    recording: str = ""
    tick_start: int = 0

    @property
    def label(self) -> str:
        """Recording, if it is known, and set-points as text."""
        return _label(self.recording, self.torque_Nm, self.speed_Hz)

    @property
    def began(self) -> tuple[int, int]:
        """Tick and time (Unix ns) of its beginning, which no other capture has."""
        timed = self.ticks.size and "t_ns" in (self.ticks.dtype.names or ())
        return self.tick_start, int(self.ticks["t_ns"][0]) if timed else 0


@dataclass(frozen=True)
class Samples:
    """An operating point ready to be identified from; n samples, time rising strictly.

    t_s (n,) from the first sample; count (n,); torque_Nm (n,); i_A (n, 3) sensed currents at t_s;
    command_A (n, 3): commands where they were recorded (commanded), else the sensed currents;
    turns: (first, end) of each whole turn. Where the currents of a phase were not recorded
    all currents are nan. faults: signals that are not right; counts that are not are left out.
    recording: name of its file. sample_age_s (n,): how old each sample was when its tick began;
    None where that was not recorded.
    """

    torque_set_Nm: float
    speed_set_Hz: float
    compensate: int
    t_s: np.ndarray
    count: np.ndarray
    torque_Nm: np.ndarray
    i_A: np.ndarray
    command_A: np.ndarray
    turns: tuple[tuple[int, int], ...]
    commanded: bool = True
    back_emf_factor: float = 1.0
    faults: tuple[SignalFault, ...] = ()
    recording: str = ""
    sample_age_s: np.ndarray | None = None

    @property
    def label(self) -> str:
        """Recording, if it is known, and set-points as text."""
        return _label(self.recording, self.torque_set_Nm, self.speed_set_Hz)

    @cached_property
    def period_s(self) -> float:
        """Time between samples, the median (s)."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def whole(self) -> slice:
        """All samples of whole turns."""
        return slice(self.turns[0][0], self.turns[-1][1])

    @property
    def speed_Hz(self) -> float:
        """Mean speed over the whole turns (turns/s)."""
        duration_s = self.t_s[self.turns[-1][1] - 1] - self.t_s[self.turns[0][0]]
        return float(len(self.turns) / (duration_s + self.period_s))

    @property
    def velocity_Hz(self) -> float:
        """Mean speed over the whole turns (turns/s), negative backwards."""
        return self.speed_Hz if _forwards(self.count) else -self.speed_Hz


def _forwards(count: np.ndarray) -> bool:
    """Return whether most steps of the counts (n,) are upwards; a turn's end is one downwards."""
    steps = np.diff(count)
    return bool((steps > 0).sum() >= (steps < 0).sum())


def split(
    ticks: np.ndarray, operating_points: Sequence[Mapping[str, Any]], recording: str = ""
) -> Iterator[PointData]:
    """Yield the good operating points of a run, in their order.

    ticks: all ticks of the run, with columns `tick` and `plan_point` besides those of a point.
    operating_points: dicts as recorded in `/operating_point`; those not of good quality, and
    takes that were taken again, are left out. recording: name of its file.
    """
    for point in good_points(operating_points):
        first, last = int(point["tick_start"]), int(point["tick_end"])
        begin, end = np.searchsorted(ticks["tick"], [first, last + 1])
        chosen = ticks[begin:end]
        yield PointData(
            torque_Nm=float(point["torque_Nm"]),
            speed_Hz=float(point["speed_Hz"]),
            ticks=rows_of(chosen, chosen["plan_point"] == int(point["index"])),
            compensate=int(point.get("compensate", 0)),
            induced=point.get("induced", {}),
            turns_from_start=bool(point.get("turns_from_start", False)),
            recording=recording,
            tick_start=first,
        )


def good_points(operating_points: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the operating points of good quality, of several takes the last, in time order."""
    latest: dict[tuple[int, int], Mapping[str, Any]] = {}
    for point in operating_points:
        key = (int(point["index"]), int(point.get("compensate", 0)))
        if point.get("quality", GOOD) == GOOD:
            latest[key] = point
    return sorted(latest.values(), key=lambda point: int(point["tick_start"]))


def prepare(point: PointData, counts: int) -> Samples:
    """Return the samples of a point. Raises CaptureError, IdentifyError."""
    ticks, label = _complete(point), point.label
    t_ns = ticks["t_ns"]
    t_s = (t_ns - t_ns[:1]) * 1e-9
    i_A = _currents(ticks, t_s)
    torque_Nm = ticks["torque_Nm"].astype(float)
    good, sensed = rising(t_ns) & recorded(torque_Nm, "torque_Nm", label), _finite(*i_A.T)
    if sensed.any():
        good &= sensed
    else:
        i_A[:] = np.nan
    count = ticks["encoder_count"][good].astype(np.int64)
    good[good], position, faults = countable(t_s[good], count, counts, label)
    if good.all():
        good = slice(None)  # spares the copies
    count = ticks["encoder_count"][good].astype(np.int64)
    turns = continuous_turns(position, counts, label, from_start=point.turns_from_start)
    require_change({"torque_Nm": torque_Nm[good]}, label)
    i_A = np.ascontiguousarray(i_A[good])
    command_A = _commands(ticks, good) if sensed.any() else None
    return Samples(
        torque_set_Nm=point.torque_Nm,
        speed_set_Hz=point.speed_Hz,
        compensate=point.compensate,
        t_s=t_s[good],
        count=count,
        torque_Nm=torque_Nm[good],
        i_A=i_A,
        command_A=i_A if command_A is None else command_A,
        turns=turns,
        commanded=command_A is not None,
        back_emf_factor=point.back_emf_factor,
        faults=(*_faults(rows_of(ticks, good), len(turns), counts), *faults),
        recording=point.recording,
        sample_age_s=_ages(ticks, good),
    )


def _complete(point: PointData) -> np.ndarray:
    """Return the ticks of a point, with all columns REQUIRED. Raises IdentifyError."""
    names = point.ticks.dtype.names or ()
    if missing := [name for name in REQUIRED if name not in names]:
        raise IdentifyError(f"{point.label}: the recording has no {', '.join(missing)}")
    return point.ticks


def _faults(ticks: np.ndarray, turns: int, counts: int) -> tuple[SignalFault, ...]:
    """Return what is wrong with the signals; currents as sampled, not as interpolated."""
    commands = dict(zip(CURRENTS, COMMANDS, strict=True))
    names = ticks.dtype.names or ()
    known = {one: ticks[name] for one, name in commands.items() if name in names}
    signals = {name: ticks[name] for name in ("torque_Nm", *known)}
    encoder = stuck_lines(ticks["encoder_count"].astype(np.int64), counts)
    return (*signal_faults(signals, turns, known), *encoder)


def require_turns(samples: Samples, least: int) -> Samples:
    """Return samples of so many whole turns. Raises CaptureError for fewer."""
    if len(samples.turns) < least:
        raise CaptureError(
            f"{samples.label}: {len(samples.turns)} of the {least} whole turns that it needs; "
            "take more turns"
        )
    return samples


def require_currents(samples: Samples) -> Samples:
    """Return samples whose currents were recorded. Raises IdentifyError for others."""
    if not np.isfinite(samples.i_A).all():
        raise IdentifyError(
            f"{samples.label}: {', '.join(CURRENTS)} were not recorded: without currents "
            "gains and offsets cannot be identified; verify and cogging do without"
        )
    return samples


def _commands(ticks: np.ndarray, good: np.ndarray | slice) -> np.ndarray | None:
    """Return the commanded currents of the samples `good` (n, 3), None where there are none."""
    if not set(COMMANDS) <= set(ticks.dtype.names or ()):
        return None
    commands = stacked(ticks, COMMANDS)[good]
    return commands if np.isfinite(commands).all() else None


def _ages(ticks: np.ndarray, good: np.ndarray | slice) -> np.ndarray | None:
    """Return how old the samples `good` were when their ticks began (n,), None where unknown."""
    known = "sample_age_ns" in (ticks.dtype.names or ())
    return ticks["sample_age_ns"][good] * 1e-9 if known else None


def current_lines(
    count: np.ndarray, i_A: np.ndarray, turns: tuple[tuple[int, int], ...], counts: int
) -> np.ndarray:
    """Return the lines (h + 1, m) of currents (n, m) over the turn, complex: freed of noise."""
    fewest = min(end - first for first, end in turns)
    highest = max(resolved_order(fewest, counts, MAX_CURRENT_ORDER), 1)
    return lines_at(count, i_A.T, counts, highest).T


def _finite(*columns: np.ndarray) -> np.ndarray:
    """Return in which rows all columns (n,) are finite (n,)."""
    finite: np.ndarray = np.isfinite(columns[0])
    for column in columns[1:]:
        finite &= np.isfinite(column)
    return finite


def stacked(ticks: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Return columns of ticks (n,) side by side (n, columns), as float64."""
    columns = np.empty((ticks.size, len(names)))
    for number, name in enumerate(names):
        columns[:, number] = ticks[name]
    return columns


def _currents(ticks: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """Return the sensed currents at the instants of the torque samples (n, 3)."""
    i_A = stacked(ticks, CURRENTS)
    if "i_age_ns" not in (ticks.dtype.names or ()) or not ticks["i_age_ns"].any():
        return i_A
    source_s = t_s - ticks["i_age_ns"] * 1e-9
    fresh = rising(source_s) & _finite(*i_A.T)
    fresh[fresh] = uncrowded(source_s[fresh])
    moved = np.full_like(i_A, np.nan)
    interpolate(source_s[fresh], np.ascontiguousarray(i_A[fresh]), t_s, moved)
    return moved
