"""Narrow lines of a torque that are not locked to the rotor, such as mains hum.

The average over N turns keeps of a line of d turns' frequencies beyond an order D = sin(pi N d) /
(N sin(pi d)) of its amplitude, in even as in odd turns, so that their difference does not show it.
The line is sought in what the average leaves: periodogram over the local floor, the median of its
neighbours, over 1 - D^2, which the average leaves of it; its largest value against chance by
Fisher's test (Fisher 1929; of a coloured floor Percival and Walden 1993, 10.9). Nearer to an order
than NEAREST of the resolution it is not told from a ripple that changes from turn to turn.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.harmonics import over_one_turn
from motord.identification.operating_points import Samples
from motord.identification.orders import resolved_order
from motord.identification.point_ripple import (
    AsynchronousLine,
    PointRipple,
    even_and_odd,
    response_of_orders,
    without_drift,
)

FALSE_SHARE = 1e-3
"""Probability at which noise alone makes a line of a point."""

NEAREST = 0.1
"""Distance from the nearest order, in parts of the resolution, beyond which a line is fitted."""

SOUGHT = 0.3
"""The same, from which on lines are sought; the fit may take them nearer."""

LEAST_TURNS = 4.0
"""Order below which what is found is drift."""

HIGHEST_PART = 0.8
"""Part of the highest order that turns resolve up to which lines are sought: at a speed that
ripples a time-locked line has sidebands, which the average takes out below that order alone."""

APART = 2.0
"""Distance of two lines, in parts of the resolution: nearer ones are the skirt of the first."""

STANDS_OUT = 4.0
"""Standard errors that the amplitude of a line has at least, by itself and by its frequency."""

MOST_LINES = 4
ROUNDS = 4
"""Steps of Gauss and Newton, from a frequency within an eighth of the resolution."""

PADDING = 8
"""Frequencies that are looked at within the resolution."""

NEIGHBOURS = 96
"""Resolved frequencies to either side that make the floor."""

MEDIAN_VARIANCE = 2.08
"""Relative variance, times their number, of the median of exponential values, 1 / ln(2)^2."""

TRIALS = 2.5
"""Independent values of a periodogram on a grid so fine, in parts of the resolved ones."""

SURE = 2.0
"""Standard errors that the amplitude is taken to be larger."""


def asynchronous_lines(samples: Samples, counts: int) -> tuple[AsynchronousLine, ...]:
    """Return the lines beyond chance, strongest first. One turn alone shows none."""
    if len(samples.turns) < 2:
        return ()
    fewest = min(end - first for first, end in samples.turns)
    highest = max(resolved_order(fewest, counts, fewest), 1)
    rest_Nm = _asynchronous(samples, without_drift(samples, samples.torque_Nm), highest, counts)
    found: list[AsynchronousLine] = []
    tried_Hz: list[float] = []
    while len(tried_Hz) < MOST_LINES:
        frequency_Hz, floor_Nm2 = _strongest(samples, rest_Nm, highest, tried_Hz)
        if not frequency_Hz:
            break
        line, left_Nm = _fitted(samples, rest_Nm, frequency_Hz, floor_Nm2, (highest, counts))
        turns = line.frequency_Hz / samples.speed_Hz
        apart = abs(turns - round(turns)) * len(samples.turns) > 1.001 * NEAREST
        gain = float(rest_Nm @ rest_Nm - left_Nm @ left_Nm) / (2 * floor_Nm2)
        sure = line.amplitude_Nm > STANDS_OUT * line.stderr_Nm and gain > _limit(rest_Nm)
        if apart and sure:
            found.append(line)
            rest_Nm = left_Nm
        tried_Hz.append(frequency_Hz)
    return tuple(sorted(found, key=lambda line: -line.amplitude_Nm))


def _fitted(
    samples: Samples,
    rest_Nm: np.ndarray,
    frequency_Hz: float,
    floor_Nm2: float,
    orders: tuple[int, int],
) -> tuple[AsynchronousLine, np.ndarray]:
    """Return a line near a frequency by Gauss and Newton, and what it leaves of the rest (n,).

    floor_Nm2: variance of the noise; orders: highest order and encoder counts. The frequency keeps
    its side of the nearest order; its error is in that of the amplitude.
    """
    t_s, speed_Hz = samples.t_s[samples.whole], samples.speed_Hz
    middle_s, resolution_Hz = float(t_s.mean()), speed_Hz / len(samples.turns)
    order = round(frequency_Hz / speed_Hz)
    side = 1.0 if frequency_Hz > order * speed_Hz else -1.0
    for _ in range(ROUNDS):
        waves = _waves(samples, frequency_Hz)
        columns = np.column_stack([_asynchronous(samples, wave, *orders) for wave in waves])
        parts_Nm = np.linalg.lstsq(columns, rest_Nm, rcond=None)[0]
        slope = 2 * np.pi * (t_s - middle_s) * (parts_Nm[1] * waves[0] - parts_Nm[0] * waves[1])
        every = np.column_stack([columns, _asynchronous(samples, slope, *orders)])
        inverse = np.linalg.pinv(every.T @ every)
        step_Hz = float((inverse @ (every.T @ rest_Nm))[2])
        frequency_Hz += float(np.clip(step_Hz, -resolution_Hz / 4, resolution_Hz / 4))
        apart_Hz = max(side * (frequency_Hz - order * speed_Hz), NEAREST * resolution_Hz)
        frequency_Hz = order * speed_Hz + side * apart_Hz
    amplitude_Nm = float(np.hypot(*parts_Nm))
    along = np.array([*(parts_Nm / amplitude_Nm), 0.0])
    stderr_Nm = float(np.sqrt(floor_Nm2 * (along @ inverse @ along)))
    return AsynchronousLine(frequency_Hz, amplitude_Nm, stderr_Nm), rest_Nm - columns @ parts_Nm


def lines_near_orders(
    lines: Iterable[AsynchronousLine], own: Sequence[AsynchronousLine], samples: Samples
) -> tuple[AsynchronousLine, ...]:
    """Return lines of other points that this one cannot show: nearer to an order than it resolves.

    own: what it shows. Of those that are of one frequency, as far as it resolves, the strongest.
    """
    found: list[AsynchronousLine] = []
    speed_Hz = samples.speed_Hz
    resolution_Hz = speed_Hz / len(samples.turns)
    for line in sorted(lines, key=lambda line: -line.amplitude_Nm):
        same = [abs(one.frequency_Hz - line.frequency_Hz) for one in (*own, *found)]
        order = round(line.frequency_Hz / speed_Hz)
        near = abs(line.frequency_Hz - order * speed_Hz) < resolution_Hz
        if near and min(same, default=np.inf) > resolution_Hz:
            found.append(line)
    return tuple(found[:MOST_LINES])


def with_leakage(
    ripple: PointRipple,
    lines: Sequence[AsynchronousLine],
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
) -> PointRipple:
    """Return the ripple with what the lines may have left in it, in its standard error.

    At an unknown phase an error of b at most has a standard deviation of b / sqrt(2); 1.96 of that
    is more than b, so that the interval holds at whatever phase.
    """
    if not lines or ripple.stderr_percent is None:
        return ripple
    seen = response_of_orders(samples, ripple.order, motor, sensor)
    in_percent = 100 / motor.rated_torque_Nm
    square_Nm2 = (ripple.rms_percent / in_percent) ** 2
    leakage = [
        in_percent
        * _of_root(square_Nm2, leakage_of_square(samples, line, ripple.even_odd_Nm, seen, motor))
        for line in lines
    ]
    bound = float(np.linalg.norm(leakage))
    stderr = float(np.hypot(ripple.stderr_percent, bound / np.sqrt(2)))
    return replace(
        ripple,
        stderr_percent=stderr,
        leakage_percent=bound,
        asynchronous_percent=in_percent * max(line.amplitude_Nm for line in lines),
        asynchronous_lines=tuple(lines),
    )


def _of_root(square: float, change: float) -> float:
    """Return by how much the root changes at most where its square does, up or down."""
    root = np.sqrt(square)
    return float(max(np.sqrt(square + change) - root, root - np.sqrt(max(square - change, 0.0))))


def leakage_of_square(
    samples: Samples,
    line: AsynchronousLine,
    even_odd_Nm: np.ndarray,
    seen: np.ndarray,
    motor: MotorConfig,
) -> float:
    """Return by how much the line changes the mean square of the repeating torque at most (Nm^2).

    even_odd_Nm (2, m): lines of even and odd turns; seen (m,): the sensor's response, which they
    are divided by. At whatever phase, of which the first power of the amplitude's part has all
    sizes up to its own, the second one size.
    """
    cosine, sine = (
        even_and_odd(samples, wave, motor.counts, seen.size) / seen
        for wave in _waves(samples, line.frequency_Hz)
    )
    first = [
        float((wave[0] * even_odd_Nm[1].conj() + wave[1] * even_odd_Nm[0].conj()).real.sum()) / 2
        for wave in (cosine, sine)
    ]
    cross = [[(one[0] * other[1].conj()).real.sum() / 2 for one in (cosine, sine)]
             for other in (cosine, sine)]  # fmt: skip
    second = float(np.abs(np.linalg.eigvalsh((np.array(cross) + np.transpose(cross)) / 2)).max())
    amplitude_Nm = line.amplitude_Nm + SURE * line.stderr_Nm
    return float(amplitude_Nm * np.hypot(first[0], first[1]) + amplitude_Nm**2 * second)


def _waves(samples: Samples, frequency_Hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return cosine and sine of a frequency at the samples of whole turns (n,) each."""
    phase_rad = 2 * np.pi * frequency_Hz * samples.t_s[samples.whole]
    return np.cos(phase_rad), np.sin(phase_rad)


def _asynchronous(samples: Samples, values: np.ndarray, highest: int, counts: int) -> np.ndarray:
    """Return values (n,) of whole turns less their mean and their average over the turns."""
    values = values - values.mean()
    lines = even_and_odd(samples, values, counts, highest).mean(axis=0)
    table = over_one_turn(np.concatenate([[0.0], lines]), counts)
    return np.asarray(values - table[samples.count[samples.whole]])


def _strongest(
    samples: Samples, rest_Nm: np.ndarray, highest: int, tried_Hz: Sequence[float]
) -> tuple[float, float]:
    """Return frequency of the strongest line apart from those tried, 0 where it may be chance.

    And the variance of white noise of the floor's density there (Nm^2).
    """
    t_s = samples.t_s[samples.whole]
    place = np.rint((t_s - t_s[0]) / samples.period_s).astype(np.int64)
    grid_Nm = np.bincount(place, rest_Nm)
    power = np.abs(np.fft.rfft(grid_Nm, PADDING * grid_Nm.size)) ** 2 / rest_Nm.size
    frequency_Hz = np.fft.rfftfreq(PADDING * grid_Nm.size, samples.period_s)
    turns = frequency_Hz / samples.speed_Hz
    apart = turns - np.rint(turns)
    number = len(samples.turns)
    floor_Nm2 = _floor(power, np.abs(apart) * number > 0.5)
    kept = np.abs(np.sinc(number * apart) / np.sinc(apart)) ** 2
    sought = (np.abs(apart) * number > SOUGHT) & (turns > LEAST_TURNS)
    sought &= turns < HIGHEST_PART * highest
    for one_Hz in tried_Hz:
        sought &= np.abs(turns - one_Hz / samples.speed_Hz) * number > APART
    ratio = np.where(sought, power / np.maximum(1 - kept, 1e-9) / floor_Nm2, 0.0)
    best = int(np.argmax(ratio))
    seen = ratio[best] > _limit(rest_Nm)
    return float(frequency_Hz[best]) if seen else 0.0, float(floor_Nm2[best])


def _limit(rest_Nm: np.ndarray) -> float:
    """Return what a periodogram over its floor is beyond somewhere in FALSE_SHARE by chance.

    A median of n values has the relative variance MEDIAN_VARIANCE / n of a mean of n / that values:
    the ratio is one of F then, of 2 and twice as many degrees of freedom.
    """
    trials, values = TRIALS * rest_Nm.size / 2, min(2 * NEIGHBOURS + 1, rest_Nm.size // 2)
    known = values / MEDIAN_VARIANCE
    return known * float((trials / FALSE_SHARE) ** (1 / known) - 1)


def _floor(power: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Return the floor of a periodogram (n,): its median over neighbours, as a mean of noise.

    between (n,): where the average over turns, which leaves nothing at orders, leaves all of it.
    """
    places = np.arange(0, power.size, PADDING)
    places = places[between[places]]
    half = min(NEIGHBOURS, (places.size - 1) // 2)
    padded = np.pad(power[places], half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    median = np.median(windows, axis=1) / np.log(2)
    floor = np.interp(np.arange(power.size), places, median)
    return np.asarray(np.maximum(floor, np.finfo(float).tiny))
