"""Positions from encoder counts, whole turns in them, and segments of a steady speed.

Made for records of any origin: slow starts, several speeds in one file, both directions.
"""

from bisect import insort
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from motord.identification import CaptureError
from motord.identification.encoder.misread_counts import misread
from motord.identification.signal_condition import SignalFault, require_change, sound_counts

STEADY = 0.1
"""Part by which the durations of the turns of one segment may differ from their median."""

LEAST_TURNS = 3
"""Turns that a segment needs to count as one."""

GAP = 0.1
"""Part of a turn that may be missing between two turns of one segment: a rotor that trembles."""

SPEED_ERROR = 0.25
"""Part of the speed by which that between two samples may differ from that before or after them."""

SPEED_SAMPLES = 20
"""Sample intervals on either side of a gap from which the speed in it is taken."""

MISSING = 1.5
"""Spacing of samples, in the short spacings of which SHORT are shorter, from which on one of them
is missing."""

SHORT = 0.1
"""Part of the spacings that are short, however many samples are missing."""

SHOWN = 0.1
"""Part of the usual time that sample intervals take at least, if they are to show a speed."""

TURN_MORE = (
    "record at least 2 turns; if it did turn, a line of the encoder is stuck "
    "(`motord check` reads it)"
)
"""What to do where there is no whole turn."""


class NoWholeTurn(CaptureError):
    """The samples have no whole turn."""


class LostTurns(CaptureError):
    """Samples are so far apart that turns may have passed uncounted."""


@dataclass(frozen=True)
class Turn:
    """Samples `first` to `end` (not included) of one whole turn, forward (1) or backward (-1)."""

    first: int
    end: int
    direction: int


def unwrap_counts(count: np.ndarray, counts: int) -> np.ndarray:
    """Return encoder counts (n,) that run on over turns, beginning with the first as it is.

    The shorter way round counts: less than half a turn from sample to sample, but for misread ones.
    """
    count = np.asarray(count, np.int64)
    off = misread(count, counts)
    if not off.any():
        return np.unwrap(count, period=counts)
    position = np.empty_like(count)
    position[~off] = np.unwrap(count[~off], period=counts)
    last = np.maximum.accumulate(np.where(off, 0, np.arange(count.size)))  # that is not off
    step = (count - count[last] + counts // 2) % counts - counts // 2
    return np.asarray(position[last] + step)


def countable(
    t_s: np.ndarray, count: np.ndarray, counts: int, label: str
) -> tuple[np.ndarray, np.ndarray, tuple[SignalFault, ...]]:
    """Return which samples (n,) have a sound count, these unwrapped (m,), and faults.

    t_s (n,): rising; count (n,): of the encoder. Raises CountsOutOfRange, MisreadCounts, or
    LostTurns if the shorter way round may be another than the rotor's somewhere.
    """
    good, faults = sound_counts(count, counts, label)
    t_s, position = t_s[good], unwrap_counts(count[good], counts)
    doubtful, turned = uncounted(t_s, position, counts)
    if doubtful.size:
        worst = int(np.argmax(turned))
        apart_s = float(np.diff(t_s)[doubtful[worst]])
        raise LostTurns(
            f"{label}: {apart_s:.3g} s without usable samples, in which the rotor made about "
            f"{turned[worst]:.2g} turns: they cannot be counted; record it again"
        )
    return good, position, faults


def uncounted(t_s: np.ndarray, position: np.ndarray, counts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return after which samples turns may be lost (m,), and about how many passed there (m,).

    t_s (n,): rising; position (n,): running on, `counts` a turn. What the speed before, and that
    after, makes of the time between two samples must be what they differ by, to half a turn less
    SPEED_ERROR of it: another turn would be farther off.
    """
    [used] = np.nonzero(~misread(position, counts))
    spacing_s, step = np.diff(t_s[used]), np.diff(position[used]) / counts
    if spacing_s.size < 2 or _slow(spacing_s, step):
        return np.zeros(0, int), np.zeros(0)
    at = np.arange(spacing_s.size)
    missing = spacing_s > MISSING * np.quantile(spacing_s, SHORT)
    before = np.maximum(at - SPEED_SAMPLES, 0), at
    after = at + 1, np.minimum(at + 1 + SPEED_SAMPLES, spacing_s.size)
    expected = np.array(
        [_speeds(spacing_s, step, missing, *one) * spacing_s for one in (before, after)]
    )
    expected[0, 0], expected[1, -1] = expected[1, 0], expected[0, -1]  # nothing is before or after
    off = np.abs(expected - step) + SPEED_ERROR * np.abs(expected)
    [doubtful] = np.nonzero(off.max(axis=0) >= 0.5)
    return used[doubtful], np.abs(expected).max(axis=0)[doubtful]


def _slow(spacing_s: np.ndarray, step: np.ndarray) -> bool:
    """Return whether no turn can be in doubt, which spares long recordings the speeds.

    No speed is more than the largest step in SHOWN of the usual time.
    """
    largest = max(float(step.max()), -float(step.min()))
    longest_s = max(float(spacing_s.max()), -float(spacing_s.min()))
    bound, part = (1 + SPEED_ERROR) * largest * longest_s, (0.5 - largest) * SHOWN
    shortest_s = float(spacing_s.min())  # the usual time is no less, and takes longer to find
    return bound < part * shortest_s or bound < part * _usual_s(spacing_s)


def _speeds(
    spacing_s: np.ndarray, step: np.ndarray, missing: np.ndarray, first: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Return the speeds in sample intervals `first` to `end` (m,), not included, 0 where none are.

    Those where samples are missing (n,) do not count, as turns may be lost there; but they do where
    times come in bunches, so that the others show next to nothing of the time.
    """

    def sums(values: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(total[end] - total[first])

    usual_s = (end - first) * _usual_s(spacing_s)
    seen_s, all_s = sums(np.where(missing, 0.0, spacing_s)), np.maximum(sums(spacing_s), usual_s)
    shown = seen_s >= SHOWN * usual_s
    way = np.where(shown, sums(np.where(missing, 0.0, step)), sums(step))
    took_s = np.where(shown, seen_s, all_s)
    return way / np.where(took_s > 0, took_s, np.inf)


def _usual_s(spacing_s: np.ndarray) -> float:
    """Return the usual time between samples, also of times that come in bunches."""
    together = min(SPEED_SAMPLES, spacing_s.size)
    sums_s = np.convolve(spacing_s, np.ones(together), "valid")
    return float(np.median(sums_s)) / together


def unwrapped(ticks: np.ndarray, counts: int, label: str) -> tuple[np.ndarray, int]:
    """Return the position (n,), rad, running on over turns, and the number of its grid's points.

    From `encoder_count`, in range; from `angle_rad` where there is no such column. The grid is the
    encoder's, 0 for an angle that has none. Raises CaptureError: also for a count that stands, as
    at 0 where no encoder answers: the angle next to it may be an observer's, which smooths what the
    speed does within a turn.
    """
    names = ticks.dtype.names or ()
    count = ticks["encoder_count"].astype(np.int64) if "encoder_count" in names else None
    if count is not None and count.size and (count != count[0]).any():
        return 2 * np.pi / counts * unwrap_counts(count, counts), counts
    if count is not None:
        require_change({"encoder_count": count}, label)
    if "angle_rad" in names:
        angle_rad = ticks["angle_rad"].astype(float)
        if angle_rad.size and np.isfinite(angle_rad).all() and np.ptp(angle_rad) > 0:
            return np.unwrap(angle_rad), 0
    raise CaptureError(
        f"{label}: no encoder_count and no angle_rad that moves: the rotor's angle is not known"
    )


def whole_turns(position_rad: np.ndarray) -> list[Turn]:
    """Return the whole turns, from zero point to zero point.

    Where fewer than two fit between zero points, they count from the first sample's position.
    """
    turns = _turns_from(position_rad)
    if len(turns) < 2 and position_rad.size:
        just_after = 1e-6 if position_rad[-1] > position_rad[0] else -1e-6
        from_start = _turns_from(position_rad - position_rad[0] - just_after)
        turns = max(turns, from_start, key=len)
    return turns


def continuous_turns(
    position: np.ndarray, counts: int, label: str, *, from_start: bool = False
) -> tuple[tuple[int, int], ...]:
    """Return (first, end) of each turn from zero point to zero point, one after the other.

    position (n,): running on, `counts` a turn; from_start: from the first sample's position
    instead, so that short captures lose no part of a turn. For a capture, in which the rotor keeps
    its direction: a count that trembles at the end of a turn ends none, where `whole_turns` sees it
    turn back. Raises NoWholeTurn.
    """
    size = position.size
    if size and position[-1] < position[0]:
        position = -position
    if from_start and size > 1:  # the sample that would come next may end a turn
        position = np.append(position, 2 * position[-1] - position[-2]) - position[0]
    turn = np.maximum.accumulate(position // counts) if size else position
    first, last = (turn[0] + (not from_start), turn[-1]) if size else (0, 0)
    edges = np.searchsorted(turn, np.arange(first, last + 1))
    pairs = tuple((int(a), int(b)) for a, b in pairwise(edges) if b > a)
    if not pairs:
        raise NoWholeTurn(f"{label}: no whole turn from zero point to zero point; {TURN_MORE}")
    return pairs


def _turns_from(position_rad: np.ndarray) -> list[Turn]:
    turn = np.floor(position_rad / (2 * np.pi)).astype(np.int64)
    at = np.flatnonzero(np.diff(turn)) + 1
    step = np.sign(turn[at] - turn[at - 1])
    boundary = np.where(step > 0, turn[at], turn[at] + 1)
    return [
        Turn(int(at[a]), int(at[a + 1]), int(step[a]))
        for a in range(at.size - 1)
        if step[a] == step[a + 1] == boundary[a + 1] - boundary[a]
    ]


def steady_segments(t_s: np.ndarray, turns: list[Turn]) -> list[list[Turn]]:
    """Return groups of successive turns of one direction and of about the same duration."""
    groups: list[list[Turn]] = []
    rising_s: list[float] = []  # durations of the last group, in order
    for turn in turns:
        duration_s = float(t_s[turn.end] - t_s[turn.first])
        if not (groups and _continues(t_s, groups[-1][-1], rising_s, turn, duration_s)):
            groups.append([])
            rising_s = []
        groups[-1].append(turn)
        insort(rising_s, duration_s)
    return groups


def _continues(
    t_s: np.ndarray, last: Turn, rising_s: list[float], turn: Turn, duration_s: float
) -> bool:
    """Return whether a turn goes on after the last of a group, whose durations are `rising_s`."""
    usual_s = (rising_s[len(rising_s) // 2] + rising_s[(len(rising_s) - 1) // 2]) / 2
    near = t_s[turn.first] - t_s[last.end] <= GAP * usual_s
    alike = abs(duration_s / usual_s - 1) <= STEADY
    return bool(near and alike and last.direction == turn.direction)


def segments(t_s: np.ndarray, turns: list[Turn]) -> tuple[list[list[Turn]], list[tuple[Turn, str]]]:
    """Return the segments to measure in, and each turn that is in none with the reason.

    Each segment is of one direction and one speed. Where such segments hold less than half of the
    turns of a direction, because the motion is jerky, all its turns are one. A segment has
    LEAST_TURNS or more; if none has, the longest counts.
    """
    found = []
    for direction in (1, -1):
        own = [turn for turn in turns if turn.direction == direction]
        steady = [group for group in steady_segments(t_s, own) if len(group) >= LEAST_TURNS]
        found += steady if 2 * sum(map(len, steady)) >= len(own) else [own]
    longest = max(found, key=len, default=[])
    kept = [one for one in found if len(one) >= LEAST_TURNS or (one and one is longest)]
    used = {turn.first for one in kept for turn in one}
    ways = {one[0].direction for one in kept}
    dropped = [
        (turn, "at another speed" if turn.direction in ways else "few turns of this direction")
        for turn in turns
        if turn.first not in used
    ]
    return sorted(kept, key=lambda one: one[0].first), dropped
