"""Whether a calibration in force has left its interval: a test that is made for years.

The error of the calibration, and what the model itself is good for, are the same at every look;
the noise of the turns is new after each memory of the tracking. So a quantity has departed beyond

    t(FALSE_ALARMS / 2 m) s_fixed + t(FALSE_ALARMS memory / (2 m year)) s_turns

of m quantities, with standard errors s: a calibration that holds raises FALSE_ALARMS findings by
its own error, and as many in a year by noise.
"""

from collections.abc import Sequence
from functools import partial
from math import hypot, sqrt

import numpy as np

from motord.experiments.check_calibration.estimate import without_consequences
from motord.experiments.check_calibration.law_shift import GAIN_ACCURACY
from motord.experiments.check_calibration.quantities import Quantity
from motord.experiments.check_calibration.result import FALSE_ALARMS, POWER, Change
from motord.experiments.check_calibration.shift import ParameterShift
from motord.intervals import t_quantile

YEAR_S = 365.25 * 86_400


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
    return Change(
        name=quantity.name,
        meaning=quantity.meaning,
        unit=quantity.unit,
        value=value,
        stderr=stderr,
        degrees_of_freedom=freedom,
        limit=limit,
        detectable=limit + t_quantile(POWER, freedom) * stderr,
        ripple_percent=0.0,
        drifted=abs(value) > limit,
    )


def _accuracy(quantity: Quantity, found: ParameterShift) -> float:
    """Return the standard deviation by which a gain that holds may differ, warmer or colder."""
    if quantity.family != "gain":
        return 0.0
    of_gains = quantity.direction[:3] * found.theta[:3]
    return float(GAIN_ACCURACY / sqrt(3) * np.linalg.norm(of_gains))
