"""What lines that are not locked to the rotor leave in the average over turns, at most."""

from collections.abc import Sequence
from dataclasses import replace
from math import hypot
from typing import NamedTuple, TypeVar

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.disturbances.asynchronous_line import MOST_LINES, from_order, waves
from motord.identification.disturbances.periodogram import SOUGHT
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import (
    AsynchronousLine,
    PointRipple,
    even_and_odd,
    response_of_orders,
)

Ripple = TypeVar("Ripple", bound=PointRipple)

COVERAGE_FACTOR = 2.0
"""Standard errors that the amplitude is taken to be larger."""

WANDERS = 4e-4
"""Part of its frequency by which a line may be elsewhere at another point: 0.02 of 50 Hz."""


class _OfSquare(NamedTuple):
    """By how much a line changes the mean square of the repeating torque (Nm^2).

    first: at most, by its product with the rest; second: at most, by its own square; mean: of the
    latter over all phases.
    """

    first: float
    second: float
    mean: float


def lines_in_average(
    own: Sequence[AsynchronousLine],
    others: Sequence[AsynchronousLine],
    samples: Samples,
    ripple: PointRipple,
) -> tuple[AsynchronousLine, ...]:
    """Return the lines of a point with the amplitudes that may be in its average over turns.

    own: what it shows; others: what other points show. An own line near an order has the amplitude
    that other points show, if that is more; where none does it may be all that there is at that
    order. Of others count those that this point could not show by itself.
    """
    resolution_Hz = samples.speed_Hz / len(samples.turns)
    found = []
    for line in own:
        same = [one for one in others if abs(_apart_Hz(one, line)) < resolution_Hz]
        if line.amplitude_known:
            found.append(line)
        elif any(one.amplitude_known for one in same):
            found.append(_larger(line, [one for one in same if one.amplitude_known], samples))
        else:
            found.append(_as_large_as_its_order(line, samples, ripple))
    for line in sorted(others, key=lambda line: -line.amplitude_Nm):
        near = SOUGHT + WANDERS * line.frequency_Hz / resolution_Hz
        apart = min((abs(_apart_Hz(one, line)) for one in found), default=np.inf)
        if from_order(samples, line.frequency_Hz) < near and apart > resolution_Hz:
            found.append(line)
    return tuple(sorted(found, key=lambda line: -line.amplitude_Nm)[: 2 * MOST_LINES])


def _apart_Hz(one: AsynchronousLine, other: AsynchronousLine) -> float:
    return one.frequency_Hz - other.frequency_Hz


def _larger(
    line: AsynchronousLine, same: Sequence[AsynchronousLine], samples: Samples
) -> AsynchronousLine:
    """Return the largest of lines that are the same, where that is nearest to an order."""
    largest = max((line, *same), key=lambda one: one.amplitude_Nm)
    nearest = min((line, *same), key=lambda one: from_order(samples, one.frequency_Hz))
    return replace(largest, frequency_Hz=nearest.frequency_Hz)


def _as_large_as_its_order(
    line: AsynchronousLine, samples: Samples, ripple: PointRipple
) -> AsynchronousLine:
    """Return the line with the amplitude of all that there is at its order, if that is more."""
    order = round(line.frequency_Hz / samples.speed_Hz)
    if order > ripple.order.size:
        return line
    kept = np.sinc(from_order(samples, line.frequency_Hz))
    there_Nm = float(np.abs(ripple.line_Nm[order - 1])) / kept
    return replace(line, amplitude_Nm=max(line.amplitude_Nm, there_Nm))


def with_leakage(
    ripple: Ripple,
    lines: Sequence[AsynchronousLine],
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
) -> Ripple:
    """Return the ripple with what the lines may have left in it, in its standard error.

    At an unknown phase an error of b at most has a standard deviation of b / sqrt(2); 1.96 of that
    is more than b, so that the interval holds at whatever phase.
    """
    if not lines or ripple.noise_stderr_percent is None:
        return ripple
    seen = response_of_orders(samples, ripple.order, motor, sensor)
    in_percent = 100 / motor.rated_torque_Nm
    square_Nm2 = (ripple.rms_percent / in_percent) ** 2
    each = [_of_square(samples, line, ripple.even_odd_Nm, seen, motor) for line in lines]
    second_Nm2 = sum(one.second**0.5 for one in each) ** 2
    bound = in_percent * _of_root(square_Nm2, sum(one.first for one in each) + second_Nm2)
    without_Nm2 = max(square_Nm2 - sum(one.mean for one in each), 0.0)
    return replace(
        ripple,
        stderr_percent=float(np.hypot(ripple.noise_stderr_percent, bound / np.sqrt(2))),
        leakage_percent=bound,
        bias_percent=ripple.rms_percent - in_percent * float(np.sqrt(without_Nm2)),
        asynchronous_percent=in_percent * max(line.amplitude_Nm for line in lines),
        asynchronous_lines=tuple(lines),
    )


def noise_of_lines(
    ripple: PointRipple, samples: Samples, motor: MotorConfig, sensor: TorqueSensorConfig
) -> np.ndarray:
    """Return the RMS over all phases of what lines leave at each order of a ripple (n,)."""
    seen = response_of_orders(samples, ripple.order, motor, sensor)
    square_Nm2 = np.zeros(seen.size)
    for line in ripple.asynchronous_lines:
        pair = waves(samples, line.frequency_Hz)
        for left in (even_and_odd(samples, pair, motor.counts, seen.size) / seen).mean(axis=0):
            square_Nm2 += _upper_limit_Nm(line) ** 2 * np.abs(left) ** 2 / 2
    return np.asarray(np.sqrt(square_Nm2))


def _upper_limit_Nm(line: AsynchronousLine) -> float:
    return line.amplitude_Nm + COVERAGE_FACTOR * line.stderr_Nm


def _of_root(square: float, change: float) -> float:
    """Return by how much the root changes at most where its square does, up or down."""
    root = np.sqrt(square)
    return float(max(np.sqrt(square + change) - root, root - np.sqrt(max(square - change, 0.0))))


def _of_square(
    samples: Samples,
    line: AsynchronousLine,
    even_odd_Nm: np.ndarray,
    seen: np.ndarray,
    motor: MotorConfig,
) -> _OfSquare:
    """Return what the line does to the mean square.

    even_odd_Nm (2, m): lines of even and odd turns; seen (m,): the sensor's response, which they
    are divided by.
    """
    both = even_and_odd(samples, waves(samples, line.frequency_Hz), motor.counts, seen.size) / seen
    pair = both.swapaxes(0, 1)  # of cosine and sine, of even and odd turns
    first = [
        float((wave[0] * even_odd_Nm[1].conj() + wave[1] * even_odd_Nm[0].conj()).real.sum()) / 2
        for wave in pair
    ]
    cross = np.array(
        [[(one[0] * other[1].conj()).real.sum() / 2 for one in pair] for other in pair]
    )
    sizes = np.linalg.eigvalsh((cross + cross.T) / 2)
    upper_Nm = _upper_limit_Nm(line)
    return _OfSquare(
        upper_Nm * hypot(*first),
        float(upper_Nm**2 * np.abs(sizes).max()),
        float(max(line.amplitude_Nm**2 * sizes.mean(), 0.0)),
    )
