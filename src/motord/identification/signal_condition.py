"""Signals that do not show what they measure: clipped at the end of a range, frozen, misread.

They leave figures that look sound: a torque that does not change has no ripple, and a mean of
peaks that were cut off is too small with a small scatter.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from motord.identification import CaptureError, IdentifyError
from motord.identification.encoder.misread_counts import (
    MISREAD_MIN,
    far_from,
    misread,
    misread_in_rows,
)

CLIPPED_SHARE = 0.005
"""Of the samples that are at one end of the signal, from which on it may be clipped."""
CLIPPED_OVER_NEXT = 10.0
"""So many times as many samples are at the end as at any of the levels next to it: a sine that is
rounded has 2.4 times as many."""
ROUNDING = 1e-5
"""Part of the range within which values that differ by rounding count as one level."""
LEVELS_MIN = 20
"""Fewer different values are steps of a converter, of which one may well be the most frequent."""
COMMAND_SHARE = 0.02
"""What commands span while their current is at its end, of all that they span: less is a current
whose reference is flat there."""
COMMANDED_SHARE = 0.1
"""RMS of a phase's command, in parts of the largest, that shows the scale of its current."""
SAMPLES_A_COUNT = 0.25
"""Samples, for each count of the encoder, from which on each of its lines changes."""
MISREAD_SHARE = 0.05
"""Of the samples that are misread at most: of more the ones left are not all sound."""
MISREAD_IN_ROWS_SHARE = 0.001
"""Of the samples that are misread several in a row at most, where single ones are not: they stay,
as a rotor that rings may look like it, and make figures that no interval holds."""
OUT_OF_RANGE_SHARE = 0.01
"""Of the samples that are disturbed at most: with more, it is another encoder or none."""
FROZEN_TURN = 0.125
FROZEN_RUNS = 20.0
"""A value is frozen that stays for this part of a turn, and for so many times the mean time."""


class CountsOutOfRange(CaptureError):
    """Encoder counts are below 0, or not below the motor's counts a turn, and not by chance."""


class MisreadCounts(CaptureError):
    """Encoder counts are misread in more samples than can be left out."""


@dataclass(frozen=True)
class SignalFault:
    """What is wrong with a signal, in which share of its samples."""

    signal: str
    kind: Literal["clipped", "frozen", "stuck", "misread", "out-of-range"]
    share: float


@dataclass(frozen=True)
class CurrentProducts:
    """Sums over samples, by phase (3,): squares of sensed and of commanded currents, products."""

    sensed_A2: np.ndarray
    commanded_A2: np.ndarray
    both_A2: np.ndarray

    @classmethod
    def of(cls, sensed_A: np.ndarray, commanded_A: np.ndarray) -> "CurrentProducts":
        """Return the sums of currents (n, 3); samples that are not finite do not count."""
        pairs = ((sensed_A, sensed_A), (commanded_A, commanded_A), (sensed_A, commanded_A))
        good = np.isfinite(sensed_A).all(axis=1) & np.isfinite(commanded_A).all(axis=1)
        return cls(*(np.einsum("np,np->p", one[good], other[good]) for one, other in pairs))

    def __add__(self, other: "CurrentProducts") -> "CurrentProducts":
        return CurrentProducts(
            self.sensed_A2 + other.sensed_A2,
            self.commanded_A2 + other.commanded_A2,
            self.both_A2 + other.both_A2,
        )

    @property
    def ratios(self) -> np.ndarray:
        """RMS of the sensed over that of the commanded current (3,), negative where against it.

        A drive that lags does not make it smaller. nan where nothing was commanded, or little next
        to the other phases: noise and offset of a sensor are not its scale.
        """
        shown = self.commanded_A2 > COMMANDED_SHARE**2 * self.commanded_A2.max()
        commanded = np.where(shown, self.commanded_A2, np.nan)
        return np.asarray(np.sign(self.both_A2) * np.sqrt(self.sensed_A2 / commanded))


def recorded(values: np.ndarray, name: str, label: str) -> np.ndarray:
    """Return which samples of a signal (n,) have a number (n,). Raises CaptureError if none has."""
    known: np.ndarray = np.isfinite(values)
    if values.size and not known.any():
        raise CaptureError(f"{label}: no {name} was recorded")
    return known


def require_change(signals: Mapping[str, np.ndarray], label: str) -> None:
    """Raise CaptureError if a signal (n,) has one value all the time; label: of the point."""
    for name, values in signals.items():
        if values.size > 1 and values.max() == values.min():
            raise CaptureError(
                f"{label}: {name} is {values[0]:.4g} from the first sample to the last, while the "
                "rotor turned: the sensor is dead or not connected, or its converter hangs"
            )


def require_sound(
    signals: Mapping[str, np.ndarray], count: np.ndarray, counts: int, turns: float, label: str
) -> None:
    """Raise IdentifyError also if a signal (n,) is clipped or frozen, or count (n,) not right."""
    require_change(signals, label)
    for one in (*signal_faults(signals, turns, {}), *stuck_lines(count, counts)):
        raise IdentifyError(
            f"{label}: {one.signal} is {one.kind} in {one.share:.2%} of the samples"
        )


def signal_faults(
    signals: Mapping[str, np.ndarray], turns: float, commands: Mapping[str, np.ndarray]
) -> tuple[SignalFault, ...]:
    """Return what is wrong with signals (n,) of a rotor that turned so often meanwhile.

    commands (n,): what a signal with a command was to be; it is clipped only where that differs.
    """
    return tuple(
        SignalFault(name, kind, share)
        for name, values in signals.items()
        for kind, share in _faults(values, turns, commands.get(name))
    )


def in_range(count: np.ndarray, counts: int, label: str) -> np.ndarray:
    """Return which encoder counts (n,) are of `counts` a turn (n,): the others are disturbed.

    Raises CountsOutOfRange if these are several and more than OUT_OF_RANGE_SHARE, or if the rotor
    turns on into them more than once: the motor has another encoder then.
    """
    good = (count >= 0) & (count < counts)
    if good.all():
        return good
    inside = count[good]
    step = (inside[1:] - inside[:-1] + counts // 2) % counts - counts // 2
    usual = np.median(step) if step.size else 0
    near = np.abs(np.diff(count) - usual) <= (far_from(np.abs(step - usual)) if step.size else 0)
    edges = np.flatnonzero(near & (good[1:] != good[:-1]))
    onwards = np.unique(edges + good[edges])  # a sample that is next to two counts in range
    if onwards.size > 1 or good.size - good.sum() > max(OUT_OF_RANGE_SHARE * good.size, 1):
        raise CountsOutOfRange(
            f"{label}: encoder counts from {count.min()} to {count.max()}, "
            f"but the motor has {counts} counts a turn; correct counts in [motor]"
        )
    return good


def out_of_range(good: np.ndarray) -> tuple[SignalFault, ...]:
    """Return the fault of an encoder of whose samples only the `good` (n,) are in range."""
    number = good.size - int(good.sum())
    return (SignalFault("encoder_count", "out-of-range", number / max(good.size, 1)),) * bool(
        number
    )


def sound_counts(
    count: np.ndarray, counts: int, label: str
) -> tuple[np.ndarray, tuple[SignalFault, ...]]:
    """Return which counts (n,) are in range and not misread (n,), and the faults of the others.

    Raises CountsOutOfRange, MisreadCounts.
    """
    good = in_range(count, counts, label)
    faults, off = out_of_range(good), misread(count[good], counts)
    if off.sum() >= MISREAD_MIN:
        if off.mean() > MISREAD_SHARE:
            raise MisreadCounts(
                f"{label}: the encoder is misread in {off.mean():.1%} of the samples, more than "
                f"the {MISREAD_SHARE:.0%} that can be left out; shield its lines, record it again"
            )
        faults += (SignalFault("encoder_count", "misread", float(off.mean())),)
    _check_rows(misread_in_rows(count[good], counts) & ~off, label)
    good[good] = ~off
    return good, faults


def _check_rows(off: np.ndarray, label: str) -> None:
    """Raise MisreadCounts if many counts (n,) are off, several in a row, that are not left out."""
    rows = int((off[1:] & ~off[:-1]).sum())
    if rows >= MISREAD_MIN and off.mean() > MISREAD_IN_ROWS_SHARE:
        raise MisreadCounts(
            f"{label}: the encoder is misread in {off.mean():.1%} of the samples, several in a "
            "row; shield its lines, record it again"
        )


def stuck_lines(count: np.ndarray, counts: int) -> tuple[SignalFault, ...]:
    """Return an encoder whose counts (n,), of whole turns, show a line that never changes.

    Of a binary or a Gray code alike; the share is that of the counts which never come then. Too few
    samples, steps of one size and counts that are no power of two tell nothing.
    """
    if counts & (counts - 1) or count.size < SAMPLES_A_COUNT * counts:
        return ()
    if np.unique(np.diff(count) % counts).size < 2:
        return ()
    for code in (count, count ^ (count >> 1)):
        changing = np.bitwise_or.reduce(code) & ~np.bitwise_and.reduce(code)
        if int(changing) & (counts - 1) != counts - 1:
            return (SignalFault("encoder_count", "stuck", 0.5),)
    return ()


def is_stuck(faults: Iterable[SignalFault]) -> bool:
    """Return whether one of the faults is an encoder with a line that never changes."""
    return any(one.kind == "stuck" for one in faults)


def _faults(
    values: np.ndarray, turns: float, command: np.ndarray | None
) -> Iterator[tuple[Literal["clipped", "frozen"], float]]:
    values = values[np.isfinite(values)] if command is None else values
    if values.size < LEVELS_MIN or values.max() == values.min():
        return
    ends = [values == end for end in (values.max(), values.min())]
    clipped = [at for at in ends if _is_clipped(values, at, command)]
    if clipped:
        yield "clipped", float(np.mean(np.logical_or.reduce(clipped)))
    elif share := _frozen_share(values, turns):
        yield "frozen", share


def _is_clipped(values: np.ndarray, at: np.ndarray, command: np.ndarray | None) -> bool:
    if at.mean() < CLIPPED_SHARE or at.sum() < LEVELS_MIN:
        return False
    if command is not None and np.ptp(command[at]) < COMMAND_SHARE * np.ptp(command):
        return False
    from_end = np.abs(values - values[at][0]) // (ROUNDING * np.ptp(values))
    _, counts = np.unique(from_end, return_counts=True)
    if counts.size < LEVELS_MIN:
        return False
    counts[0] -= at.sum()
    return bool(at.sum() > CLIPPED_OVER_NEXT * counts[:4].max())


def _frozen_share(values: np.ndarray, turns: float) -> float:
    changes = np.flatnonzero(np.diff(values))
    runs = np.diff(changes, prepend=-1, append=values.size - 1)
    longest = max(FROZEN_TURN * values.size / max(turns, 1.0), FROZEN_RUNS * float(runs.mean()))
    return float(runs[runs >= longest].sum() / values.size)
