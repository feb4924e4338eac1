"""What a check tests of a calibration: gains, offsets and cogging torque, in figures to be read.

A gain or an offset of a phase is taken against the mean of the two others: these are seen by the
ripple they make, however well the common ones are. Only the Type A uncertainty of the calibration
counts: what is systematic in it is so in the check.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from motord.calibration import Calibration, Harmonic
from motord.config import MotorConfig
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    cogging_place,
)
from motord.experiments.check_calibration.result import POWER, Change
from motord.experiments.check_calibration.shift import ParameterShift
from motord.intervals import t_quantile

PHASES = "abc"

AGAINST_OTHERS = 1.5 * np.eye(3) - 0.5
"""Each phase less the mean of the two others."""

SEEN_GAIN_PERCENT = 1.0
SEEN_OFFSET_SHARE = 5e-3
SEEN_COGGING_SHARE = 2.5e-3
"""Standard errors of a check, of offsets in parts of the rated current and of cogging torque of the
rated torque, above which a quantity counts as not seen: what the model leaves would be taken for a
change then, many times enlarged."""

NO_OFFSET_A = 1e-9
"""Sum of beta below which it was set to 0: the common offset was not seen."""


@dataclass(frozen=True)
class Quantity:
    """Something that may have changed: `direction` (p,) times the change of theta, in `unit`.

    family: "gain" or "offset" of three phases, "common" or "cogging"; stderr of the calibration's
    value, with its degrees of freedom, None for many; seen: largest standard error of a check with
    which it counts as seen; ripple: RMS torque that a unit makes at rated torque, % of it.
    """

    name: str
    meaning: str
    family: str
    unit: str
    direction: np.ndarray
    stderr: float
    degrees_of_freedom: float | None
    seen: float
    ripple: float

    def change(self, value: float, stderr: float, freedom: float, limit: float) -> Change:
        """Return a change by `value`, its error known with degrees of freedom."""
        detectable = limit + t_quantile(POWER, freedom) * stderr
        figures = (value, stderr, freedom, limit, detectable, self.ripple * detectable)
        return Change(self.name, self.meaning, self.unit, *figures, drifted=abs(value) > limit)


def quantities(
    calibration: Calibration, found: ParameterShift, motor: MotorConfig
) -> Iterator[Quantity]:
    """Yield what the calibration states with an uncertainty."""
    freedom = calibration.degrees_of_freedom
    of_gain = 1 / (3 * sqrt(2))  # of 1 % in a phase, which makes a third of the torque
    rated_A = motor.rated_current_A()
    of_offset = 0.1 / (1.5 * sqrt(2) * rated_A)  # of 1 mA
    size = found.theta.size
    for p, phase in enumerate(PHASES):
        stderr = 1.5 * calibration.alpha_stderr[p] / calibration.alpha[p]
        yield Quantity(
            f"gain-{phase}", f"the gain of phase {phase} against the others", "gain", "%",
            _at(size, ALPHA, 100 * AGAINST_OTHERS[p] / found.theta[ALPHA]),
            100 * stderr, freedom.alpha[p] if freedom else None, SEEN_GAIN_PERCENT, of_gain,
        )  # fmt: skip
    yield from _common_gain(calibration, found)
    for p, phase in enumerate(PHASES):
        yield Quantity(
            f"offset-{phase}", f"the current offset of phase {phase} against the others",
            "offset", "mA", _at(size, BETA, 1e3 * AGAINST_OTHERS[p]),
            1.5e3 * calibration.beta_stderr_A[p], freedom.beta_A[p] if freedom else None,
            1e3 * SEEN_OFFSET_SHARE * rated_A, of_offset,
        )  # fmt: skip
    if abs(sum(calibration.beta_A)) > NO_OFFSET_A:
        yield Quantity(
            "offset-common", "the common offset of the currents", "common", "mA",
            _at(size, BETA, np.full(3, 1e3 / 3)), 1e3 * max(calibration.beta_stderr_A),
            min(freedom.beta_A) if freedom else None, 1e3 * SEEN_OFFSET_SHARE * rated_A, 0.0,
        )  # fmt: skip
    known = {one.order: one for one in calibration.tau_cog_harmonics}
    for row, order in enumerate(found.orders):
        yield from _cogging(known[order], size, cogging_place(row), motor.rated_torque_Nm)


def _common_gain(calibration: Calibration, found: ParameterShift) -> Iterator[Quantity]:
    """Yield the common gain, if it was measured and its error is stated."""
    stated = [one for one in calibration.budget if one.type == "A" and one.delta_epsilon > 0]
    if calibration.delta_epsilon_source == "assumed" or not stated:
        return
    stderr = hypot(*(one.delta_epsilon for one in stated)) / calibration.delta_epsilon
    yield Quantity(
        "gain-common", "the common gain of the phases (delta epsilon)", "common", "%",
        _at(found.theta.size, ALPHA, 100 / 3 / found.theta[ALPHA]), 100 * stderr,
        stated[0].degrees_of_freedom[2], SEEN_GAIN_PERCENT, 0.0,
    )  # fmt: skip


def _cogging(harmonic: Harmonic, size: int, place: slice, rated_Nm: float) -> Iterator[Quantity]:
    """Yield what a change adds to the amplitude of a cogging order, and what turns its phase."""
    if harmonic.stderr_Nm is None:
        return
    across_Nm = abs(harmonic.amplitude_Nm) * (harmonic.phase_stderr_rad or 0.0)
    sine, cosine = np.sin(harmonic.phase_rad), np.cos(harmonic.phase_rad)
    for name, along, stderr_Nm in (
        ("amplitude", (sine, cosine), harmonic.stderr_Nm),
        ("phase", (cosine, -sine), max(across_Nm, harmonic.stderr_Nm)),
    ):
        yield Quantity(
            f"cogging-{harmonic.order}-{name}",
            f"the {name} of order {harmonic.order} of the cogging torque",
            "cogging", "mNm", _at(size, place, 1e3 * np.array(along)),
            1e3 * stderr_Nm, harmonic.degrees_of_freedom, 1e3 * SEEN_COGGING_SHARE * rated_Nm,
            0.1 / sqrt(2) / rated_Nm,
        )  # fmt: skip


def _at(size: int, place: slice, values: np.ndarray) -> np.ndarray:
    direction = np.zeros(size)
    direction[place] = values
    return direction
