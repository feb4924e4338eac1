"""Driven operating points made ready: samples in time order, motion, whole turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.identification import IdentifyError
from motord.identification.motion import Motion
from motord.identification.operating_points import CURRENTS, PointData
from motord.identification.orders import main_order
from motord.identification.resample import rising
from motord.identification.turning import steadiest, steady_segments, unwrapped, whole_turns

CURRENT_SHARE = 0.02
"""Part of the rated current that may turn with the rotor in a run without current."""

RIPPLE_MARGIN = 2.2
LEAST_RIPPLE_ORDERS, MOST_RIPPLE_ORDERS = 64, 256
"""Speed ripple is looked for up to a little above twice the main order, within these bounds."""

LEAST_TURNS = 3
"""Turns that a segment of a run without operating points needs to count as one."""


@dataclass(frozen=True)
class Driven:
    """Samples of a driven rotor, n of them, time rising strictly.

    t_s (n,); turns: (first, end) of each whole turn at a
    steady speed, as places in these n; motion: of all n.
    """

    label: str
    speed_set_Hz: float
    ticks: np.ndarray
    t_s: np.ndarray
    turns: tuple[tuple[int, int], ...]
    motion: Motion

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
        """Mean speed over the whole turns (turns/s), positive either way round."""
        duration_s = sum(float(self.t_s[end] - self.t_s[first]) for first, end in self.turns)
        return len(self.turns) / duration_s


def require(ticks: np.ndarray, names: Sequence[str], label: str, what: str) -> None:
    """Raise IdentifyError for columns that are not there, or hold nothing."""
    have = ticks.dtype.names or ()
    missing = [name for name in names if name not in have]
    if missing:
        raise IdentifyError(f"{label}: the recording has no {', '.join(missing)}: {what}")
    empty = [n for n in names if not np.any(np.isfinite(ticks[n]) & (ticks[n] != 0))]
    if empty:
        raise IdentifyError(f"{label}: nothing was recorded in {', '.join(empty)}: {what}")


def prepare(point: PointData, motor: MotorConfig, names: Sequence[str], what: str) -> Driven:
    """Return the steadiest turns of a driven point; `names` must be finite. Raises IdentifyError.

    what: what is missing without `names`. The motor must carry no current that turns with the
    rotor.
    """
    label = f"driven at {point.speed_Hz:.3g} Hz"
    require(point.ticks, names, label, what)
    ticks, t_s = _usable(point.ticks, names)
    position_rad, grid = unwrapped(ticks, motor.counts, label)
    turns = tuple((t.first, t.end) for t in steadiest(t_s, whole_turns(position_rad)))
    if not turns:
        raise IdentifyError(f"{label}: no whole turn; record at least 2 turns")
    if min(end - first for first, end in turns) < 8:
        raise IdentifyError(f"{label}: fewer than 8 samples in a turn; sample faster")
    motion = Motion.of(t_s, position_rad, turns, grid, _ripple_orders(motor))
    driven = Driven(label, point.speed_Hz, ticks, t_s, turns, motion)
    _check_no_current(driven, motor)
    return driven


def steady_segments_of(
    ticks: np.ndarray, motor: MotorConfig, names: Sequence[str]
) -> list[PointData]:
    """Return what a run without operating points holds: each segment of a steady speed.

    Where no segment has LEAST_TURNS turns, the whole run is one. Raises IdentifyError.
    """
    require(ticks, names, "the whole run", "there is nothing to measure")
    usable, t_s = _usable(ticks, names)
    position_rad, _ = unwrapped(usable, motor.counts, "the whole run")
    found = steady_segments(t_s, whole_turns(position_rad))
    long = [group for group in found if len(group) >= LEAST_TURNS]
    points = []
    for group in long:
        speed_Hz = len(group) / float(t_s[group[-1].end] - t_s[group[0].first])
        lead = max(group[0].first - (group[0].end - group[0].first), 0)
        points.append(PointData(0.0, speed_Hz, usable[lead : group[-1].end + 1]))
    if not points:
        turned = abs(float(position_rad[-1] - position_rad[0])) / (2 * np.pi)
        points.append(PointData(0.0, turned / float(t_s[-1] - t_s[0]), usable))
    return points


def _usable(ticks: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the ticks that rise in time and hold numbers, and their times (s)."""
    good = rising(ticks["t_ns"])
    for name in names:
        good &= np.isfinite(ticks[name])
    usable = ticks[good]
    return usable, (usable["t_ns"] - usable["t_ns"][:1]) * 1e-9


def _ripple_orders(motor: MotorConfig) -> int:
    """Return the highest order of speed ripple: twice the main order of the cogging torque."""
    main = main_order(motor.slots, 2 * motor.pole_pairs)
    return int(min(max(RIPPLE_MARGIN * main, LEAST_RIPPLE_ORDERS), MOST_RIPPLE_ORDERS))


def _check_no_current(driven: Driven, motor: MotorConfig) -> None:
    """Raise IdentifyError if a current turns with the rotor; constant offsets do not flow."""
    if not set(CURRENTS) <= set(driven.ticks.dtype.names or ()):
        return
    whole = slice(driven.turns[0][0], driven.turns[-1][1])
    angle_rad, _ = driven.motion.at(driven.t_s[whole])
    wave = np.exp(-1j * motor.pole_pairs * angle_rad)
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
