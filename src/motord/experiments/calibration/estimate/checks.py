"""Checks of operating points before the fit, and of the fit: each refusal says what is missing.

And notes on what of the data a calibration does not use.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from motord.config import AccuracyConfig
from motord.experiments.calibration.estimate.least_squares.joint import NO_GAINS, JointFit
from motord.experiments.calibration.estimate.least_squares.normal_equations import ALPHA
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.estimate.turn_products import TurnProducts
from motord.experiments.magnet_temperature import UNKNOWN
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.intervals import coverage_factor

MIN_TURNS = 2
"""Whole turns that each operating point needs; one of fewer is left out."""

MIN_ALL_TURNS = 8
"""Whole turns over all operating points that a standard error needs."""

MIN_TORQUE_RATIO = 1.2
"""Ratio of the largest to the smallest current of a phase that separates alpha from cogging."""

DEAD_SHARE = 0.05
"""Current of a phase, in parts of the others', below which it counts as dead."""

CURRENT_SCALE_RANGE = (0.2, 5.0)
"""Sensed over commanded current of a phase; anything else is another unit, or no command."""

OPPOSITE_PART = 0.7
"""Correlation of a current with its negative command that no swapped phase makes: that has half."""

MAX_ALPHA_STDERR = 0.05
"""Standard error of alpha above which there is nothing to compensate with."""

NOTHING = 1e-9
"""Part of the square of the sensed currents below which nothing was commanded."""

ALPHA_RANGE = (0.5, 2.0)
"""Gains that an inverter's current sensors can have; anything else is a fault."""


REPEATS = 5.0
"""Misfit, in standard errors, beyond which the residual of a fit is not noise."""

COMMON_GAIN_RANGE = (0.5, 2.0)
"""Products of torque sensor's and current sensors' gain errors that there can be."""

COMMON_GAIN_PERCENT = 15.0
"""Common gain, less 1, that no error of a gain makes but a wrong scale, such as RMS for amplitude;
where `[accuracy]` allows more, that."""

MISSING_PERCENT = 2.0
"""Part of the periods without a usable sample from which on it is said."""

ONE_DIRECTION = (
    "friction ripple: not separated from cogging torque, as all points turn the same way; what "
    "repeats in friction is counted as cogging torque, whose intervals do not cover it (set "
    "directions = both where the load may be turned backwards)"
)


class NoFitError(IdentifyError):
    """The fit is no calibration, for a reason that another finding may explain.

    fact: what is wrong, without what is usually behind it and what to do.
    """

    def __init__(self, fact: str, advice: str) -> None:
        super().__init__(f"{fact}{advice}")
        self.fact = fact


def check_points(
    points: Sequence[TurnProducts], unknown: Sequence[str] = (), left_out: Sequence[str] = ()
) -> None:
    """Raise IdentifyError if the points cannot separate alpha, beta and cogging.

    unknown: points left out as the temperature of their magnets is not known; left_out: why others
    cannot be used.
    """
    try:
        if left_out and not points:
            raise IdentifyError("no operating point can be used")
        _check_separable(points)
    except IdentifyError as error:
        if not unknown:
            raise
        raise IdentifyError(
            f"{error}. {', '.join(unknown)}: left out, as {UNKNOWN}; repair its channel, or take "
            "back_emf_temperature_percent_per_K out of [motor]"
        ) from error


def _check_separable(points: Sequence[TurnProducts]) -> None:
    if not points:
        raise IdentifyError(
            f"there is no good operating point of {MIN_TURNS} whole turns in the recording; "
            "set turns to 3 or more"
        )
    turns = sum(point.samples.size for point in points)
    if turns < MIN_ALL_TURNS:
        raise IdentifyError(
            f"{turns} whole turns in all: too few for standard errors, "
            f"at least {MIN_ALL_TURNS} are needed"
        )
    phases_A = np.array([_phase_currents_A(point) for point in points])
    levels = np.linalg.norm(phases_A, axis=1)
    largest, smallest = points[int(np.argmax(levels))], points[int(np.argmin(levels))]
    if (phases_A.max(axis=0) < MIN_TORQUE_RATIO * phases_A.min(axis=0)).all():
        raise IdentifyError(
            f"all operating points are at about the same torque ({smallest.torque_set_Nm:g} to "
            f"{largest.torque_set_Nm:g} Nm): phase gains and cogging cannot be separated; "
            f"add a torque at least {MIN_TORQUE_RATIO:g} times as large or small, or points at "
            "which one phase's current is scaled (gain_steps)"
        )
    _check_phases(points)


def _phase_currents_A(point: TurnProducts) -> np.ndarray:
    squares = np.diagonal(point.currents, axis1=1, axis2=2)[:, :3].sum(axis=0)
    return np.asarray(np.sqrt(squares / point.samples.sum()))


def _check_phases(points: Sequence[TurnProducts]) -> None:
    rms_A = np.sqrt(np.mean([_phase_currents_A(point) ** 2 for point in points], axis=0))
    for phase in range(3):
        others_A = float(np.delete(rms_A, phase).mean())
        if rms_A[phase] < DEAD_SHARE * others_A:
            raise IdentifyError(
                f"phase {'abc'[phase]} is dead: {rms_A[phase]:.2g} A RMS where the others have "
                f"{others_A:.2g} A; check its wiring and its current sensor"
            )
    _check_scale(points)


def _check_scale(points: Sequence[TurnProducts]) -> None:
    """Raise IdentifyError if the sensed currents are in another unit than those commanded.

    By their slope on the commands, which noise of the sensors does not make steeper, and by their
    RMS, which a lag does not make smaller; both without the means. Where no commands were recorded
    the sensed currents stand for them.
    """
    products = np.sum([point.currents.sum(axis=0) for point in points], axis=0)
    centred = products - np.outer(products[3], products[3]) / products[3, 3]
    sensed, commanded = np.diagonal(centred)[:3], np.diagonal(centred)[4:]
    for phase in range(3):
        if commanded[phase] < NOTHING * sensed[phase]:
            raise IdentifyError(
                f"phase {'abc'[phase]} had a current, and none was commanded: leave the columns of "
                "the commands out (import map), or record what the drive is sent"
            )
        if commanded[phase] == 0.0:  # nor did any flow: other checks say so
            continue
        slope = centred[phase, 4 + phase] / commanded[phase]
        part = np.sqrt(sensed[phase] / commanded[phase])
        if slope < -OPPOSITE_PART * part:
            raise IdentifyError(
                f"the sensed current of phase {'abc'[phase]} has the opposite sign of its command: "
                "check the sensor's direction and the scale in the drive's DBC file, or in the "
                "import map"
            )
        if slope > CURRENT_SCALE_RANGE[1] or part < CURRENT_SCALE_RANGE[0]:
            raise IdentifyError(
                f"the sensed current of phase {'abc'[phase]} is {part:.3g} times the commanded one "
                "(RMS): one of them is in another unit; check the scale in the drive's DBC file, "
                "or in the import map"
            )


def check_fit(fitted: JointFit, misfit: Callable[[], float] = lambda: 1.0) -> None:
    """Raise IdentifyError if a fit is no calibration. misfit: see `lack_of_fit.analysis`."""
    alpha, stderr = fitted.solution.alpha, fitted.stderr[ALPHA]
    if not (np.isfinite(fitted.solution.vector).all() and np.isfinite(stderr).all()):
        raise IdentifyError(NO_GAINS)
    worst = int(np.argmax(stderr))
    if stderr[worst] > MAX_ALPHA_STDERR:
        known = f"alpha of phase {'abc'[worst]} is known to +-{stderr[worst]:.2g} only"
        if misfit() > REPEATS:
            raise NoFitError(
                known,
                f": {fitted.noise_Nm.mean():.2g} Nm of the torque repeat from turn to turn and "
                "are neither of the currents nor cogging torque, so that more turns do not help; "
                "check sign and gain of the torque sensor, the encoder's lines and the back-EMF",
            )
        raise NoFitError(
            known,
            f" (torque noise {fitted.noise_Nm.mean():.2g} Nm): take more turns and larger torques",
        )
    low, high = ALPHA_RANGE
    for phase in range(3):
        half = coverage_factor(fitted.errors.freedom[phase]) * stderr[phase]
        if not low - half <= alpha[phase] <= high + half:
            raise IdentifyError(
                f"phase {'abc'[phase]} comes out with a gain of {alpha[phase]:.2f} relative to the "
                "others: no sensor error is that large; check wiring, back-EMF and encoder offset"
            )
    common = fitted.solution.delta_epsilon
    if not COMMON_GAIN_RANGE[0] <= common <= COMMON_GAIN_RANGE[1]:
        raise NoFitError(
            f"the torque that the currents make comes out {common:.2f} times as large as the "
            "back-EMF says",
            ": no sensor error is that large; check [torque_sensor] gain_Nm_per_V, the back-EMF "
            "and the scale of the currents",
        )


def common_gain_finding(result: CalibrationResult, accuracy: AccuracyConfig) -> Iterator[Finding]:
    """Yield a finding where the common gain was measured and no error of a gain explains it."""
    if result.delta_epsilon_stderr is None:
        return
    freedom = result.degrees_of_freedom.delta_epsilon if result.degrees_of_freedom else None
    half_width_percent = 100 * coverage_factor(freedom) * result.delta_epsilon_stderr
    gains = accuracy.torque_gain_percent, accuracy.back_emf_percent, accuracy.current_gain_percent
    limit_percent = max(COMMON_GAIN_PERCENT, sum(gains)) + half_width_percent
    percent = 100 * (result.delta_epsilon - 1)
    if abs(percent) > limit_percent:
        yield Finding(
            "common-gain", percent, limit_percent, "%", "serious",
            f"the currents make {result.delta_epsilon:.3g} times the torque that the back-EMF "
            "says: the scale of torque, currents or back-EMF is wrong (1.41 and 0.71: RMS for "
            "amplitude; 1.73 and 0.58: line for phase), and the calibration carries that over",
            "check [torque_sensor] gain_Nm_per_V with a weight on a lever, the scale of the "
            "currents, and the back-EMF (`motord plan start back-emf`)",
        )  # fmt: skip


def data_notes(
    points: Sequence[TurnProducts],
    *,
    short: Sequence[str],
    unknown: Sequence[str],
    without_zero_sequence: bool,
    too_high: Sequence[int],
) -> list[str]:
    """Return which points, currents, orders and directions are not in the data used.

    short, unknown: points of too few whole turns, and with magnets of an unknown temperature;
    without_zero_sequence: the currents were recorded without; too_high: cogging orders.
    """
    notes = []
    if short:
        notes.append(
            f"left out, as they have fewer than {MIN_TURNS} whole turns: "
            f"{', '.join(short)} (set turns to 3 or more)"
        )
    if unknown:
        notes.append(f"left out, as {UNKNOWN}: {', '.join(unknown)}")
    if without_zero_sequence:
        notes.append(
            "zero sequence (common part) of the currents: not recorded (currents along d and "
            "q, or of two sensors); from Kirchhoff's law with the gains found"
        )
    if too_high:
        dropped = ", ".join(map(str, too_high))
        notes.append(f"cogging orders {dropped} are too high for the sampling rate: left out")
    missing_percent = _missing_percent(points)
    if missing_percent > MISSING_PERCENT:
        notes.append(
            f"samples: {missing_percent:.0f} % of the periods have none that can be used (a "
            "computer or link that is too busy; `motord status` counts missed ticks): the "
            "intervals hold what the others show, and are wider for it"
        )
    if len({point.spectrum.direction for point in points}) < 2:
        notes.append(ONE_DIRECTION)
    return notes


def _missing_percent(points: Sequence[TurnProducts]) -> float:
    """Return the part of the periods of all turns without a sample (%)."""
    present_s = sum(float(point.samples.sum()) * point.period_s for point in points)
    turned_s = sum(point.samples.size / abs(point.spectrum.velocity_Hz) for point in points)
    return 100 * (1 - present_s / turned_s)
