"""Logarithmic decrement and period of a free oscillation, from its crossings and turning points."""

from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt

import numpy as np

from motord.identification import IdentifyError
from motord.identification.resample import rising
from motord.identification.turning import unwrap_counts

PERIODS = 5
"""Periods whose mean is taken."""

CYCLES = 4
"""Cycles over which the logarithmic decrement is taken."""

FEWEST_COUNTS = 5.0
"""Amplitude in encoder counts down to which an oscillation is used."""

FADED_PART = 0.04
"""Part of the first amplitude down to which an oscillation is used: then friction dominates."""

FEWEST_SAMPLES = 8
"""Samples that a crossing or a turning point is found from, at least."""

LEAVING_COUNTS = 4
"""Counts that a bar has moved by once it is let go."""

CROSSING_PART, TURNING_PART = 1 / 8, 1 / 6
"""Part of a period on either side from which a crossing, or a turning point, is found."""


@dataclass(frozen=True)
class FreeOscillation:
    """One release: t_s, angle_rad (n,) from the release on, not wrapped, rising times.

    rest_rad: angle that it oscillates about; crossings_s (m,): when it passes that; turns_rad
    (m - 1,): the turning point after each crossing but the last, from rest, of alternating sign.
    """

    t_s: np.ndarray
    angle_rad: np.ndarray
    resolution_rad: float
    rest_rad: float
    crossings_s: np.ndarray
    turns_rad: np.ndarray

    @property
    def used(self) -> slice:
        """The samples from the first crossing to the last."""
        first, last = np.searchsorted(self.t_s, self.crossings_s[[0, -1]])
        return slice(int(first), int(last))


@dataclass(frozen=True)
class FivePeriods:
    """What Poels 2008 takes of an oscillation: eqs. (2.5), (2.6).

    period_s: mean of five, of crossings in either direction; square_rad2: mean square of the
    amplitude meanwhile.
    """

    period_s: float
    decrement: float
    damping_ratio: float
    square_rad2: float

    def frequency_rad_s(self, *, damped: bool = True, cubic_per_rad2: float = 0.0) -> float:
        """Return the undamped natural frequency; without `damped`, damping is neglected.

        With a stiffness that changes as 1 + cubic x^2, w^2 rises by 3/4 cubic amplitude^2: that is
        taken off.
        """
        frequency_rad_s = 2 * pi / self.period_s
        if damped:
            frequency_rad_s /= sqrt(1 - self.damping_ratio**2)
        return frequency_rad_s / sqrt(1 + 0.75 * cubic_per_rad2 * self.square_rad2)


def find_free_oscillation(t_ns: np.ndarray, count: np.ndarray, counts: int) -> FreeOscillation:
    """Return the free oscillation in samples (n,) that begin while the bar is held.

    counts: of a turn of the encoder. Raises IdentifyError.
    """
    t_s, angle_rad = _unwrapped(t_ns, count, counts)
    resolution_rad = 2 * pi / counts
    angle_rad, t_s = _from_release(t_s, angle_rad, resolution_rad)
    rest_rad = float(np.mean(angle_rad[-max(angle_rad.size // 4, 1) :]))
    for _ in range(3):  # rest and crossings depend on each other
        rough_s = _rough_crossings(t_s, angle_rad - rest_rad, resolution_rad)
        if rough_s.size < 2 * PERIODS + 2:
            raise IdentifyError(
                f"a release swings for {max(rough_s.size - 1, 0) / 2:g} periods only, "
                f"{PERIODS + 0.5:g} are needed; less damping or more deflection"
            )
        period_s = 2 * float(np.mean(np.diff(rough_s[: 2 * PERIODS])))
        turns_rad = _turning_points(t_s, angle_rad, rough_s, period_s)
        rest_rad = _middle(turns_rad)
    crossings_s = np.array([_crossing(t_s, angle_rad - rest_rad, t, period_s) for t in rough_s])
    return FreeOscillation(
        t_s=t_s,
        angle_rad=angle_rad,
        resolution_rad=resolution_rad,
        rest_rad=rest_rad,
        crossings_s=crossings_s,
        turns_rad=turns_rad - rest_rad,
    )


def five_periods(oscillation: FreeOscillation) -> FivePeriods:
    """Return the mean of five periods and the damping over four cycles."""
    crossings_s, size = oscillation.crossings_s, np.abs(oscillation.turns_rad)
    period_s = float(np.mean(crossings_s[2 * PERIODS :][:2] - crossings_s[:2])) / PERIODS
    ratios = size[:2] / size[2 * CYCLES :][:2]
    decrement = float(np.mean(np.log(ratios))) / CYCLES  # (2.5)
    return FivePeriods(
        period_s=period_s,
        decrement=decrement,
        damping_ratio=decrement / sqrt(4 * pi**2 + decrement**2),  # (2.6)
        square_rad2=float(np.mean(size[: 2 * PERIODS] ** 2)),
    )


def _unwrapped(t_ns: np.ndarray, count: np.ndarray, counts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times (s) that rise and the angles (rad) at them, not wrapped."""
    t_ns = np.asarray(t_ns, np.int64)
    newer = rising(t_ns)
    if int(newer.sum()) < 10 * PERIODS:
        raise IdentifyError(f"a release has {int(newer.sum())} samples only")
    t_s = (t_ns[newer] - t_ns[0]) * 1e-9
    return t_s, unwrap_counts(np.asarray(count)[newer], counts) * (2 * pi / counts)


def _from_release(
    t_s: np.ndarray, angle_rad: np.ndarray, resolution_rad: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples from the release on: from when the bar has left where it was held."""
    held_rad = float(np.median(angle_rad[:20]))
    away_rad = max(LEAVING_COUNTS * resolution_rad, 0.05 * float(np.ptp(angle_rad)))
    gone = np.flatnonzero(np.abs(angle_rad - held_rad) > away_rad)
    if np.ptp(angle_rad) < 4 * FEWEST_COUNTS * resolution_rad or gone.size == 0:
        raise IdentifyError("a release hardly moves: nothing swings in it")
    return angle_rad[gone[0] :], t_s[gone[0] :]


def _rough_crossings(t_s: np.ndarray, x_rad: np.ndarray, resolution_rad: float) -> np.ndarray:
    """Return about when `x_rad` changes sign, while its amplitude is enough counts."""
    band_rad = 0.4 * FEWEST_COUNTS * resolution_rad
    sign = np.where(x_rad > band_rad, 1, np.where(x_rad < -band_rad, -1, 0))
    beyond = np.flatnonzero(sign)
    change = np.flatnonzero(np.diff(sign[beyond]))
    before, after = beyond[change], beyond[change + 1]
    if change.size == 0:
        return np.zeros(0)
    sizes = [
        float(np.abs(x_rad[a:b]).max())
        for a, b in zip(after, [*before[1:], x_rad.size], strict=True)
    ]
    crossings = []
    for number, (first, last) in enumerate(zip(before, after, strict=True)):
        ends = [first, last] if x_rad[first] < x_rad[last] else [last, first]
        crossings.append(float(np.interp(0.0, x_rad[ends], t_s[ends])))
        if sizes[number] < max(FEWEST_COUNTS * resolution_rad, FADED_PART * sizes[0]):
            break
    return np.array(crossings)


def _near(t_s: np.ndarray, at_s: float, reach_s: float) -> slice:
    """Return the samples that are no further than `reach_s` from `at_s`."""
    first, last = np.searchsorted(t_s, [at_s - reach_s, at_s + reach_s])
    if last - first < FEWEST_SAMPLES:
        raise IdentifyError(
            "too few samples a period; is the loop's rate far above the oscillation's?"
        )
    return slice(int(first), int(last))


def _crossing(t_s: np.ndarray, x_rad: np.ndarray, rough_s: float, period_s: float) -> float:
    """Return when a cubic through the samples around `rough_s` is zero."""
    reach_s = CROSSING_PART * period_s
    part = _near(t_s, rough_s, reach_s)
    fitted = np.polynomial.Polynomial.fit(
        t_s[part], x_rad[part], 3, domain=[rough_s - reach_s, rough_s + reach_s]
    )
    roots = fitted.roots()
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(real[np.argmin(np.abs(real - rough_s))])


def _turning_points(
    t_s: np.ndarray, angle_rad: np.ndarray, crossings_s: np.ndarray, period_s: float
) -> np.ndarray:
    """Return the angle furthest out between neighbouring crossings."""
    turns = []
    for first_s, last_s in pairwise(crossings_s):
        middle_s, reach_s = (first_s + last_s) / 2, TURNING_PART * period_s
        part = _near(t_s, middle_s, reach_s)
        fitted = np.polynomial.Polynomial.fit(t_s[part], angle_rad[part], 4)
        values = fitted(np.linspace(middle_s - reach_s, middle_s + reach_s, 201))
        edge_rad = (values[0] + values[-1]) / 2
        turns.append(float(values.max() if values[100] > edge_rad else values.min()))
    return np.array(turns)


def _middle(turns_rad: np.ndarray) -> float:
    """Return what turning points of either side lie about, whose distance shrinks evenly."""
    return float(np.mean((turns_rad[:-2] + 2 * turns_rad[1:-1] + turns_rad[2:]) / 4))
