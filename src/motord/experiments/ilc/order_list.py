"""Which orders are learned, and which of those that the torque shows are out of reach, and why.

The ripple of operating points is freed of what sampling folds into it. A line that is not locked to
the rotor, such as mains hum, leaves a part of it in the average over the turns, nearly alike in
even and odd ones. That counts as noise of each order: it is not learned.

What the torque shows comes first: over the points, |e_h|^2 / n_h^2 is more than noise makes of any
of the orders. Errors of currents make torque at multiples of the pole pairs: these are in the list
as far as there is room.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification import IdentifyError
from motord.identification.aliased_ripple import ZeroOrderHold, image_torques, without_aliases
from motord.identification.disturbances.leakage import noise_of_lines
from motord.identification.disturbances.lines_of_points import DetectedLines, with_asynchronous
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import PointRipple, point_ripple
from motord.identification.torque.torque_sensor import MOUNT_SHARE
from motord.intervals import f_tail, significant, two_digits
from motord.learned import MAX_ORDERS

BAND_SHARE = 0.25
"""Part of the loop's rate up to which a correction comes out as it should."""

LEAST_TURNS = 4
"""Whole turns below which noise cannot be separated from what repeats."""

NO_CURRENTS = np.empty((0, 3))
"""Of points of which angle and torque alone are kept."""

FALSE_SHARE = 0.002
"""Probability that noise puts any order into the list."""

NOISE_FREEDOM = 30
"""Degrees of freedom of the noise of a point: it is averaged over 15 orders."""

PASSED = 0.7
"""Part of an order that the sensor's high-pass lets through, below which its noise is mentioned."""

Why = Literal["bandwidth", "highest-order", "one-point", "room"]

_WHY = {
    "bandwidth": "the currents do not follow",
    "highest-order": "above --highest-order",
    "one-point": "not shown over all points together",
    "room": f"there is room for {MAX_ORDERS} orders",
}


@dataclass(frozen=True, kw_only=True)
class SeenRipple(PointRipple):
    """Ripple of an operating point: orders 1 to n, and how far it is learned.

    noise_Nm has the part of lines that are not locked to the rotor. turns_Hz: speed as it was;
    band: highest order that the currents follow at that speed; highest: the highest to learn.
    """

    turns_Hz: float
    band: int
    highest: int


def band_order(samples: Samples, hold: ZeroOrderHold | None) -> int:
    """Return the highest order that the currents follow at this speed.

    A part of the loop's rate, or the corner of the current loops if that is lower. Without a bench
    file the loop is taken to be as fast as the samples.
    """
    band_Hz = BAND_SHARE / (samples.period_s if hold is None else hold.period_s)
    if hold is not None and hold.lag_s > 0:
        band_Hz = min(band_Hz, 1 / (2 * np.pi * hold.lag_s))
    return int(band_Hz / samples.speed_Hz)


def seen_points(
    points: Iterable[Samples],
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    gain: np.ndarray,
    hold: ZeroOrderHold | None,
    highest_order: int,
) -> list[SeenRipple]:
    """Return the ripple of each point, see `seen_by`, with what lines that others show leave."""
    found, turns = [], []
    for samples in points:
        seen = seen_by(samples, motor, sensor, gain, hold, highest_order)
        found.append((seen, DetectedLines.of(samples, motor.counts)))
        bare = replace(samples, i_A=NO_CURRENTS, command_A=NO_CURRENTS, sample_age_s=None)
        turns.append(bare)
    ripples = with_asynchronous(found, turns, motor, sensor)
    return [
        replace(one, noise_Nm=np.hypot(one.noise_Nm, noise_of_lines(one, samples, motor, sensor)))
        for one, samples in zip(ripples, turns, strict=True)
    ]


def seen_by(
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    gain: np.ndarray,
    hold: ZeroOrderHold | None,
    highest_order: int,
) -> SeenRipple:
    """Return the ripple of a point; gain (3,): what flows over what is commanded."""
    ripple = point_ripple(samples, motor, sensor)
    if hold is not None and hold.is_folded_by(samples):
        images_Nm = image_torques(samples, gain, motor, hold)
        ripple = without_aliases(ripple, samples, images_Nm, motor, sensor, hold)
    band = band_order(samples, hold)
    return SeenRipple(
        **vars(ripple), turns_Hz=samples.speed_Hz, band=band, highest=min(band, highest_order)
    )


@dataclass(frozen=True)
class Unreached:
    """An order that the torque of a point shows and that is not corrected there."""

    torque_Nm: float
    speed_Hz: float
    order: int
    amplitude_Nm: float
    why: Why

    def to_text(self) -> str:
        """Return the order and the reason."""
        return f"{self.order} ({significant(1e3 * self.amplitude_Nm, 3)} mNm: {_WHY[self.why]})"


def in_lines(found: Sequence[Unreached]) -> Iterator[str]:
    """Yield for each point which orders its torque shows that are not corrected, and why."""
    for (torque_Nm, speed_Hz), group in groupby(found, lambda one: (one.torque_Nm, one.speed_Hz)):
        orders = ", ".join(one.to_text() for one in group)
        yield f"{torque_Nm:g} Nm, {speed_Hz:g} /s: not corrected, order {orders}"


def shown(points: Sequence[SeenRipple]) -> tuple[int, ...]:
    """Return the orders that the torque of the points shows, the strongest first."""
    highest = max(point.order.size for point in points)
    square, seen, size = np.zeros(highest), np.zeros(highest, int), np.zeros(highest)
    for point in points:
        here = slice(0, point.order.size)
        line_Nm = point.line_Nm
        square[here] += np.abs(line_Nm) ** 2 / np.maximum(point.noise_Nm, 1e-30) ** 2
        size[here] = np.maximum(size[here], np.abs(line_Nm))
        seen[here] += 1
    p_values = f_tail(square / seen, 2 * seen, NOISE_FREEDOM * seen)
    good = np.flatnonzero(p_values < FALSE_SHARE / highest)
    return tuple(int(place) + 1 for place in good[np.argsort(-size[good])])


def to_learn(
    points: Sequence[SeenRipple], pole_pairs: int, before: Sequence[int] = ()
) -> tuple[int, ...]:
    """Return the orders to learn, rising: those `before`, those shown, multiples of the pole pairs.

    As many as there is room for, in this sequence. Raises IdentifyError if there are none.
    """
    highest = max(point.highest for point in points)
    wanted = [order for order in shown(points) if order <= highest]
    electrical = range(pole_pairs, highest + 1, pole_pairs)
    chosen = list(dict.fromkeys([*before, *wanted, *electrical]))[:MAX_ORDERS]
    if not chosen:
        raise IdentifyError(
            f"nothing can be learned: the loop corrects orders up to {highest}, where the torque "
            f"shows nothing, and currents make torque at multiples of {pole_pairs}; learn at lower "
            "speeds"
        )
    return tuple(sorted(chosen))


def unreached(point: SeenRipple, orders: Sequence[int]) -> tuple[Unreached, ...]:
    """Return what the torque of a point shows beyond the orders that are corrected there."""
    corrected = {order for order in orders if order <= point.highest}
    found = []
    for order in sorted(set(shown([point])) - corrected):
        why: Why = "room" if len(orders) >= MAX_ORDERS else "one-point"
        if order > point.band:
            why = "bandwidth"
        elif order > point.highest:
            why = "highest-order"
        found.append(
            Unreached(
                torque_Nm=point.torque_Nm,
                speed_Hz=point.speed_Hz,
                order=order,
                amplitude_Nm=float(abs(point.line_Nm[order - 1])),
                why=why,
            )
        )
    return tuple(found)


def reach_text(point: SeenRipple, sensor: TorqueSensorConfig) -> str:
    """Return up to which order the torque is corrected and seen at the speed of a point."""
    words = [
        f"{point.speed_Hz:g} /s: corrected up to order {min(point.highest, point.order.size)}",
        f"seen up to {point.order.size}",
    ]
    if sensor.resonance_Hz and point.order.size == int(
        MOUNT_SHARE * sensor.resonance_Hz / point.turns_Hz
    ):
        words[-1] += f" (the mount resonates at {sensor.resonance_Hz:g} Hz)"
    turned = 2 * np.pi * point.turns_Hz * sensor.highpass_time_constant_s * point.order
    weak = np.flatnonzero(turned / np.hypot(1, turned) < PASSED)
    if sensor.highpass_time_constant_s and weak.size:
        words.append(f"noise is larger up to order {int(weak[-1]) + 1} (the sensor's high-pass)")
    least_mNm = 1e3 * float(np.median(point.noise_Nm))
    return ", ".join(words) + f"; noise {two_digits(least_mNm)} mNm an order"
