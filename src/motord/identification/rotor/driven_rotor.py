"""Driven operating points made ready: samples in order, motion, whole turns, what is left out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np

from motord.config import MotorConfig
from motord.identification import CaptureError, IdentifyError
from motord.identification.operating_points import CURRENTS, PointData
from motord.identification.orders import main_order
from motord.identification.resample import rising
from motord.identification.rotor.left_out import (
    LOST,
    PART,
    LeftOut,
    spans_left_out,
    whole_left_out,
)
from motord.identification.rotor.motion import Motion
from motord.identification.signal_condition import (
    SignalFault,
    require_change,
    signal_faults,
    sound_counts,
    stuck_lines,
)
from motord.identification.turning import (
    TURN_MORE,
    NoWholeTurn,
    Turn,
    segments,
    uncounted,
    unwrapped,
    whole_turns,
)
from motord.schema import rows_of

CURRENT_SHARE = 0.02
"""Part of the rated current that may turn with the rotor in a run without current."""

RIPPLE_MARGIN = 2.2
LEAST_RIPPLE_ORDERS, MOST_RIPPLE_ORDERS = 64, 256
"""Speed ripple is looked for up to a little above twice the main order, within these bounds."""

JERKY = 2.0
"""Residual of a smooth motion, over the encoder's rounding, beyond which the rotor is jerky."""


@dataclass(frozen=True)
class Driven:
    """Samples of a driven rotor, n of them, time rising strictly.

    t_s (n,); direction: 1 or -1; turns: (first, end) of each whole turn of that direction, as
    places in these n; motion: of all n. grid: points a turn of the angle, 0 if it has none;
    rounding_rad: RMS of the encoder's rounding; residual_rms_rad: of the measured angle less the
    smooth motion, root of its covariance with the next sample's, to which noise adds nothing.
    back_emf_factor: that of the point; faults: what is wrong with its signals.
    """

    label: str
    speed_set_Hz: float
    direction: int
    ticks: np.ndarray
    t_s: np.ndarray
    turns: tuple[tuple[int, int], ...]
    motion: Motion
    grid: int
    rounding_rad: float
    residual_rms_rad: float
    back_emf_factor: float = 1.0
    faults: tuple[SignalFault, ...] = ()

    @property
    def jerky(self) -> bool:
        """Whether the smooth motion does not explain the encoder: the rotor sticks and slips."""
        return bool(self.residual_rms_rad > JERKY * self.rounding_rad)

    @property
    def period_s(self) -> float:
        """Time between samples, the median (s)."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def samples_per_turn(self) -> int:
        """Samples in the turn that has fewest."""
        return min(end - first for first, end in self.turns)

    @property
    def speed_Hz(self) -> float:
        """Mean speed over the whole turns (turns/s), positive in either direction."""
        duration_s = sum(float(self.t_s[end] - self.t_s[first]) for first, end in self.turns)
        return len(self.turns) / duration_s


def require(ticks: np.ndarray, names: Sequence[str], label: str, what: str) -> None:
    """Raise IdentifyError for columns that are not there, or hold nothing."""
    have = ticks.dtype.names or ()
    missing = [name for name in names if name not in have]
    if missing:
        raise IdentifyError(f"{label}: the recording has no {', '.join(missing)}: {what}")
    if not ticks.size:
        raise CaptureError(f"{label}: the recording has no ticks of it")
    empty = [n for n in names if not np.any(np.isfinite(ticks[n]) & (ticks[n] != 0))]
    if empty:
        raise CaptureError(f"{label}: nothing was recorded in {', '.join(empty)}: {what}")


def prepare(
    points: Iterable[PointData], motor: MotorConfig, names: Sequence[str], what: str
) -> tuple[list[Driven], tuple[LeftOut, ...]]:
    """Return the whole turns of driven points by direction and speed, and the spans left out.

    A point may be a capture at one speed, or a whole recording, its speed 0: slow starts, several
    speeds and both directions in it are found. `names` must be finite; what: what is missing
    without them. The motor must carry no current that turns with the rotor. A
    point without a turn that can be counted is left out, unless there is no other. Raises
    IdentifyError.
    """
    driven: list[Driven] = []
    left_out: list[LeftOut] = []
    errors: list[CaptureError] = []
    for number, point in enumerate(points, start=1):
        try:
            found, rest = _prepare(point, number, motor, names, what)
        except CaptureError as error:
            errors.append(error)
            left_out.append(whole_left_out(point, number, error))
            continue
        driven += found
        left_out += rest
    if errors and not driven:
        raise errors[0]
    if not driven:
        raise IdentifyError("there is no good operating point in the recording")
    return driven, tuple(left_out)


def _prepare(
    point: PointData, number: int, motor: MotorConfig, names: Sequence[str], what: str
) -> tuple[list[Driven], tuple[LeftOut, ...]]:
    label = f"driven at {point.speed_Hz:.3g} Hz" if point.speed_Hz else "the whole run"
    require(point.ticks, names, label, what)
    good = rising(point.ticks["t_ns"])
    for name in names:
        good &= np.isfinite(point.ticks[name])
    good[good], of_encoder = _readable(point.ticks, good, motor.counts, label)
    ticks = rows_of(point.ticks, good)
    all_s = (point.ticks["t_ns"] - point.ticks["t_ns"][:1]) * 1e-9
    t_s = all_s[good]
    position_rad, grid = unwrapped(ticks, motor.counts, label)
    gaps, _ = uncounted(t_s, position_rad * (motor.counts / (2 * np.pi)), motor.counts)
    groups, dropped = _segments(t_s, position_rad, gaps + 1)
    if not groups:
        raise NoWholeTurn(f"{label}: no whole turn; {TURN_MORE}")
    reasons = _reasons(t_s.size, groups, dropped, gaps)
    signals = {name: ticks[name] for name in names}
    require_change(signals, label)
    faults = signal_faults(signals, sum(map(len, groups)), {})
    if grid:
        faults += stuck_lines(ticks["encoder_count"].astype(np.int64), motor.counts)
    faults += of_encoder
    driven = [
        replace(_segment(point, group, ticks, t_s, position_rad, grid, motor, gaps), faults=faults)
        for group in groups
    ]
    return driven, spans_left_out(f"point {number}, {label}", all_s, good, reasons)


def _segments(
    t_s: np.ndarray, position_rad: np.ndarray, begins: np.ndarray
) -> tuple[list[list[Turn]], list[tuple[Turn, str]]]:
    """Return segments, and turns in none with the reason; none goes on over samples `begins`."""
    turns = [
        Turn(first + one.first, first + one.end, one.direction)
        for first, end in pairwise([0, *begins.tolist(), t_s.size])
        for one in whole_turns(position_rad[first:end])
    ]
    groups, dropped = segments(t_s, turns)

    def span(turn: Turn) -> int:
        return int(np.searchsorted(begins, turn.first, "right"))

    return [list(part) for group in groups for _, part in groupby(group, span)], dropped


def _reasons(
    samples: int, groups: list[list[Turn]], dropped: list[tuple[Turn, str]], gaps: np.ndarray
) -> np.ndarray:
    """Return why each of the samples (n,) is not used, "" if it is."""
    reasons = np.full(samples, PART, dtype=object)
    for turn, reason in dropped:
        reasons[turn.first : turn.end] = reason
    for group in groups:
        for turn in group:
            reasons[turn.first : turn.end] = ""
    whole = np.flatnonzero(reasons != PART)
    for gap in gaps:
        after = int(np.searchsorted(whole, gap, "right"))
        first = whole[after - 1] + 1 if after else 0
        reasons[first : whole[after] if after < whole.size else samples] = LOST
    return reasons


def _readable(
    ticks: np.ndarray, good: np.ndarray, counts: int, label: str
) -> tuple[np.ndarray, tuple[SignalFault, ...]]:
    """Return which of the good samples have a sound count; all where it never moves: no angle.

    And the faults of the others. Raises CountsOutOfRange, MisreadCounts.
    """
    if "encoder_count" in (ticks.dtype.names or ()):
        count = ticks["encoder_count"][good].astype(np.int64)
        if np.unique(count).size > 1:
            return sound_counts(count, counts, label)
    return np.ones(int(good.sum()), bool), ()


def _segment(
    point: PointData,
    group: list[Turn],
    ticks: np.ndarray,
    t_s: np.ndarray,
    position_rad: np.ndarray,
    grid: int,
    motor: MotorConfig,
    gaps: np.ndarray,
) -> Driven:
    """Return a segment with a turn before it, in which filters settle, but none over `gaps`."""
    began = int(max(gaps[gaps < group[0].first], default=-1)) + 1
    lead = max(group[0].first - (group[0].end - group[0].first), began)
    part = slice(lead, group[-1].end + 1)
    turns = tuple((turn.first - lead, turn.end - lead) for turn in group)
    speed_Hz = len(group) / sum(float(t_s[turn.end] - t_s[turn.first]) for turn in group)
    label = f"driven at {point.speed_Hz or speed_Hz:.3g} Hz"
    label += " backward" if group[0].direction < 0 else ""
    if min(end - first for first, end in turns) < 8:
        raise CaptureError(f"{label}: fewer than 8 samples in a turn; sample faster")
    at_s = t_s[part] - t_s[lead]
    motion = Motion.of(at_s, position_rad[part], turns, grid, _ripple_orders(motor))
    residual_rad = motion.residual_rad(np.concatenate([np.arange(*turn) for turn in turns]))
    driven = Driven(
        label=label,
        speed_set_Hz=point.speed_Hz or speed_Hz,
        direction=group[0].direction,
        ticks=ticks[part],
        t_s=at_s,
        turns=turns,
        motion=motion,
        grid=grid,
        rounding_rad=float(2 * np.pi / motor.counts / np.sqrt(12)),
        residual_rms_rad=float(
            np.sqrt(max(float(np.mean(residual_rad[1:] * residual_rad[:-1])), 0.0))
        ),
        back_emf_factor=point.back_emf_factor,
    )
    _check_no_current(driven, motor)
    return driven


def _ripple_orders(motor: MotorConfig) -> int:
    """Return the highest order of speed ripple: twice the main order of the cogging torque."""
    main = main_order(motor.slots, 2 * motor.pole_pairs)
    return int(min(max(RIPPLE_MARGIN * main, LEAST_RIPPLE_ORDERS), MOST_RIPPLE_ORDERS))


def _check_no_current(driven: Driven, motor: MotorConfig) -> None:
    """Raise IdentifyError if a current turns with the rotor; constant offsets do not flow."""
    if not set(CURRENTS) <= set(driven.ticks.dtype.names or ()):
        return
    whole = slice(driven.turns[0][0], driven.turns[-1][1])
    wave = np.exp(-1j * motor.pole_pairs * driven.motion.position_rad[whole])
    for name in CURRENTS:
        i_A = driven.ticks[name][whole].astype(float)
        if not np.isfinite(i_A).all():
            continue
        amplitude_A = float(2 * np.abs(((i_A - i_A.mean()) * wave).mean()))
        noise_A = float(i_A.std() * np.sqrt(2 / i_A.size))
        if amplitude_A > max(CURRENT_SHARE * motor.rated_current_A(), 5 * noise_A):
            raise IdentifyError(
                f"{driven.label}: {amplitude_A:.2g} A turn with the rotor in {name}: this needs a "
                "run without current, driven from outside with the power stage off"
            )
