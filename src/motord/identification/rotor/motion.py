"""The rotor's angle and speed as smooth functions of time, from the counts of its encoder.

    angle = S(t) + w(angle)

S is a cubic spline, fitted by least squares, that follows whatever the speed does slowly; w holds
what repeats in every turn and is too fast for the spline: the speed ripple that cogging torque
drives against a flexible belt. Neither smooths the other away.

A count says which cell the angle is in, not where in it. Over many turns that averages out, unless
counts and samples stay exactly in step; therefore w has no more orders than it needs, and S no more
pieces than leave what the cells explain. Swings that do not repeat need more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from motord.identification.basis import cell_gain
from motord.identification.harmonics import lines_at, over_one_turn
from motord.identification.orders import resolved_order

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

KNOTS_PER_TURN = (16, 32, 64, 128)
"""Pieces of the spline in a turn: as few as leave no more than the encoder's cells explain."""

CELL_MARGIN = 1.3
"""What may be left, over what the cells explain."""

GAIN = 0.85
"""More pieces are taken if they leave less than this part of what fewer left."""

SAMPLES_PER_KNOT = 8
"""Samples that a piece of the spline has at least."""

TABLE = 16_384
"""Points over a turn at which the ripple is tabulated."""

FREE_GRID = 8_192
"""Points that an angle without a grid of its own is sorted into."""

ITERATIONS = 3
LEAST_SLOPE = 0.1
"""1 - dw/dangle is not let below this: a rotor that stops within the turn has no w."""


@dataclass(frozen=True)
class Motion:
    """Angle and speed of the rotor; t_s (n,) rising, position_rad (n,) as measured.

    ripple_rad, slope (TABLE,): w and its slope over a turn, of orders up to ripple_orders;
    ripple_stderr_rad: standard error of each component of w's lines, from the encoder's cells.
    """

    t_s: np.ndarray
    position_rad: np.ndarray
    spline: "BSpline"
    ripple_rad: np.ndarray
    slope: np.ndarray
    ripple_orders: int
    ripple_stderr_rad: float

    @classmethod
    def of(
        cls,
        t_s: np.ndarray,
        position_rad: np.ndarray,
        turns: Sequence[tuple[int, int]],
        grid: int,
        ripple_orders: int,
    ) -> "Motion":
        """Fit the motion of samples that rise in time.

        turns: (first, end) of whole turns of a steady speed; grid: points a turn of the encoder
        that gave the positions, 0 if it has none; ripple_orders: highest order of w.
        """
        per_turn = min(end - first for first, end in turns)
        places = np.concatenate([np.arange(first, end) for first, end in turns])
        least_rad = CELL_MARGIN * 2 * np.pi / grid / np.sqrt(12) if grid else 0.0
        best, rest_rad = None, np.inf
        for knots in KNOTS_PER_TURN:
            spacing = max(per_turn // knots, SAMPLES_PER_KNOT)
            motion = cls._with(t_s, position_rad, places, grid, spacing, per_turn, ripple_orders)
            found_rad, _ = motion.at(t_s[places])
            residual_rms_rad = float(np.std(position_rad[places] - found_rad))
            if best is not None and residual_rms_rad > GAIN * rest_rad:
                break
            best, rest_rad = motion, residual_rms_rad
            if rest_rad <= least_rad or spacing == SAMPLES_PER_KNOT:
                break
        assert best is not None
        return best

    @classmethod
    def _with(
        cls,
        t_s: np.ndarray,
        position_rad: np.ndarray,
        places: np.ndarray,
        grid: int,
        spacing: int,
        per_turn: int,
        ripple_orders: int,
    ) -> "Motion":
        """Return the fit with a knot every `spacing` samples, w from the samples at `places`."""
        spline = _spline(t_s, position_rad, spacing)
        points = grid or FREE_GRID
        cell = np.rint(position_rad[places] * (points / (2 * np.pi))).astype(np.int64) % points
        rest_rad = position_rad[places] - spline(t_s[places])
        highest = resolved_order(per_turn, points, ripple_orders)
        lines = lines_at(cell, rest_rad, points, max(highest, 1))
        order = np.arange(lines.size)
        lines = lines / cell_gain(order, points)
        lines[0] = 0  # the spline has it
        return cls(
            t_s,
            position_rad,
            spline,
            over_one_turn(lines, TABLE),
            over_one_turn(1j * order * lines, TABLE),
            int(order[-1]),
            2 * np.pi / grid / np.sqrt(6 * places.size) if grid else 0.0,
        )

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return angle (rad, running on over turns) and speed (rad/s) at times (m,) within it."""
        base_rad = self.spline(t_s)
        angle_rad = np.interp(t_s, self.t_s, self.position_rad)
        for _ in range(ITERATIONS):
            wave_rad, slope = self._ripple(angle_rad)
            angle_rad = angle_rad - (angle_rad - base_rad - wave_rad) / (1 - slope)
        _, slope = self._ripple(angle_rad)
        return angle_rad, self.spline.derivative()(t_s) / (1 - slope)

    def residual_rad(self, places: np.ndarray) -> np.ndarray:
        """Return the measured positions less S + w, at some of the samples (m,)."""
        position_rad = self.position_rad[places]
        wave_rad, _ = self._ripple(position_rad)
        return np.asarray(position_rad - self.spline(self.t_s[places]) - wave_rad)

    def _ripple(self, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return w and its slope at the angles, straight between the points of the tables."""
        place = (angle_rad * (TABLE / (2 * np.pi))) % TABLE
        before = place.astype(np.int64) % TABLE
        share, after = place - np.floor(place), (before + 1) % TABLE
        wave_rad = (1 - share) * self.ripple_rad[before] + share * self.ripple_rad[after]
        slope = (1 - share) * self.slope[before] + share * self.slope[after]
        return wave_rad, np.minimum(slope, 1 - LEAST_SLOPE)


def _spline(t_s: np.ndarray, position_rad: np.ndarray, samples_per_knot: int) -> "BSpline":
    """Return the cubic least-squares spline with a knot every so many samples."""
    from scipy.interpolate import make_lsq_spline  # 0.2 s, of whoever asks for less

    inner = np.arange(samples_per_knot, t_s.size - samples_per_knot, samples_per_knot)
    knots = np.concatenate([np.repeat(t_s[0], 4), t_s[inner], np.repeat(t_s[-1], 4)])
    return make_lsq_spline(t_s, position_rad, knots, k=3)
