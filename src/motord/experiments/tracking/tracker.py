"""The calibration in force, tracked in ordinary operation; it changes nothing by itself.

Whether it has left its interval is a test that is made for years. The error of the calibration, and
what the model itself is good for, are the same at every look; the noise of the turns is new after
each memory of the tracking. So a quantity has departed beyond

    t(FALSE_ALARMS / 2 m) s_fixed + t(FALSE_ALARMS memory / (2 m year)) s_turns

of m quantities, with standard errors s: a calibration that holds raises FALSE_ALARMS findings by
its own error, and as many in a year by noise.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from math import hypot, sqrt

import numpy as np

from motord.calibration import Calibration, CalibrationError
from motord.config import Config
from motord.experiments.check_calibration.estimate import is_seen, without_consequences
from motord.experiments.check_calibration.quantities import Quantity, quantities
from motord.experiments.check_calibration.result import FALSE_ALARMS, Change
from motord.experiments.check_calibration.shift import GAIN_ACCURACY, ParameterShift
from motord.experiments.tracking.adopted import adopted, is_adoptable
from motord.experiments.tracking.shift import COMMON_GAIN_DRIFT, operating_points, tracked_shift
from motord.experiments.tracking.stated import stated
from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity
from motord.experiments.tracking.window_lines import TurnWindows, WindowLines, WindowModel
from motord.identification import IdentifyError
from motord.intervals import t_quantile

YEAR_S = 365.25 * 86_400

WINDOW_SHARE = 0.01
"""Length of a window, in parts of the memory."""

FORGOTTEN = 4.0
"""Age of a window, in parts of the memory, from which on it does not count at all."""

MOST_WINDOWS = 600
"""Windows that are kept: where set-points change often they are short, and the oldest go."""

COMMON_GAIN = "gain-common"

SEEN_COMMON_PERCENT = 100 * COMMON_GAIN_DRIFT / 3
"""Standard error of the common gain with which it counts as seen: what is assumed of its drift has
little part in it."""


def changes(seen: Sequence[Quantity], found: ParameterShift, memory_s: float) -> list[Change]:
    """Return how each quantity that is seen has changed; drifted: whether it has departed."""
    test = partial(_change, found=found, tests=len(seen), memory_s=memory_s)
    return without_consequences(seen, [test(one) for one in seen], test)


def _change(quantity: Quantity, found: ParameterShift, tests: int, memory_s: float) -> Change:
    """Return a change with the standard error of the tracking alone."""
    measured = found.along(quantity.direction)
    assert measured is not None
    value, stderr, freedom = measured
    of_turns = quantity.direction @ found.errors.of("turns") @ quantity.direction
    fixed = hypot(sqrt(max(stderr**2 - of_turns, 0.0)), quantity.stderr, _accuracy(quantity, found))
    once, often = FALSE_ALARMS / 2 / tests, FALSE_ALARMS / 2 / tests * memory_s / YEAR_S
    limit = t_quantile(1 - once, quantity.degrees_of_freedom or np.inf) * fixed
    limit -= t_quantile(often, freedom) * sqrt(of_turns)
    return replace(quantity.change(value, stderr, freedom, limit), ripple_percent=0.0)


def _accuracy(quantity: Quantity, found: ParameterShift) -> float:
    """Return the standard deviation by which a gain that holds may differ, warmer or colder."""
    if quantity.family != "gain":
        return 0.0
    of_gains = quantity.direction[:3] * found.theta[:3]
    return float(GAIN_ACCURACY / sqrt(3) * np.linalg.norm(of_gains))


class CalibrationTracker:
    """Takes ticks as they come; states, when asked, what they show of a calibration."""

    def __init__(self, config: Config, calibration: Calibration, memory_s: float) -> None:
        """calibration: the one in force; memory_s: after which a turn counts 1/e.

        Raises CalibrationError where the calibration is not of the bench's motor.
        """
        calibration.check_motor(config.motor)
        self._config, self._calibration, self._memory_s = config, calibration, memory_s
        self._cutter = TurnWindows(
            calibration, config.loop.rate_Hz, max(WINDOW_SHARE * memory_s, 1.0)
        )
        self._reader = WindowModel(config, calibration)
        self._windows: deque[WindowLines] = deque(maxlen=MOST_WINDOWS)
        self._turns = 0
        self._unreadable = ""

    def take(self, ticks: np.ndarray) -> None:
        """Take ticks (n,) of TICK_DTYPE in time order; some may be missing between."""
        for window in self._cutter.take(ticks):
            try:
                self._windows.append(self._reader.lines(window))
                self._turns += self._windows[-1].turns
                self._unreadable = ""
            except IdentifyError as error:
                self._unreadable = str(error)
        if self._windows and ticks.size:
            oldest_ns = int(ticks["t_ns"][-1]) - round(1e9 * FORGOTTEN * self._memory_s)
            while self._windows and self._windows[0].t_ns < oldest_ns:
                self._windows.popleft()

    def tracked(self) -> TrackedCalibration | None:
        """Return what is known as of the newest turns; None before there are any."""
        try:
            found = self._found()
        except IdentifyError as error:
            if not self._windows and not self._unreadable:
                return None
            return self._stated((), (), self._unreadable or str(error))
        by_name = {one.name: one for one in found.changes}
        each = tuple(
            stated(self._calibration, one, by_name, is_adoptable(one, found.seen))
            for one in found.seen
        )
        return self._stated(each, found.unseen, self._unreadable)

    def adopted(self) -> Calibration:
        """Return the calibration with what is tracked better than it states, or has departed.

        Raises CalibrationError where that is nothing.
        """
        try:
            found = self._found()
        except IdentifyError as error:
            raise CalibrationError(f"nothing to adopt: {self._unreadable or error}") from error
        created = datetime.fromtimestamp(1e-9 * self._windows[-1].t_ns, UTC)
        return adopted(self._calibration, found.seen, found.changes, created)

    def _found(self) -> "_Found":
        """Return what the windows show. Raises IdentifyError."""
        points = operating_points(self._windows, self._config, self._memory_s)
        shift = tracked_shift(points, self._calibration, self._config, self._memory_s)
        each = [_limited(one) for one in quantities(self._calibration, shift, self._config.motor)]
        seen = [one for one in each if is_seen(one, shift)]
        unseen = [one.meaning for one in each if not is_seen(one, shift)]
        if not any(one.name == COMMON_GAIN for one in each):
            unseen.insert(0, "the common gain of the phases (delta epsilon)")
        shown = {one.name for one in each}
        orders = [one.order for one in self._calibration.tau_cog_harmonics]
        missing = [order for order in orders if f"cogging-{order}-amplitude" not in shown]
        unseen += [f"order {order} of the cogging torque" for order in missing]
        return _Found(seen, changes(seen, shift, self._memory_s), tuple(unseen))

    def _stated(
        self, each: tuple[TrackedQuantity, ...], unseen: tuple[str, ...], obstacle: str
    ) -> TrackedCalibration:
        return TrackedCalibration(
            calibration=self._calibration.id,
            t_ns=self._windows[-1].t_ns if self._windows else 0,
            turns=self._turns,
            memory_s=self._memory_s,
            quantities=each,
            unseen=unseen,
            obstacle=obstacle,
        )


@dataclass(frozen=True)
class _Found:
    """Quantities that operation shows, their changes, and meanings of those that it does not."""

    seen: list[Quantity]
    changes: list[Change]
    unseen: tuple[str, ...]


def _limited(quantity: Quantity) -> Quantity:
    """Return a quantity that counts as seen only where the turns, no prior, show it."""
    if quantity.name == COMMON_GAIN:
        return replace(quantity, seen=SEEN_COMMON_PERCENT)
    return quantity
