"""Which orders are learned, and which of those that the torque shows are out of reach, and why.

What the torque shows comes first: over the points, |e_h|^2 / n_h^2 is more than noise makes of any
of the orders. Errors of currents make torque at multiples of the pole pairs: these are in the list
as far as there is room.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np

from motord.config import TorqueSensorConfig
from motord.experiments.ilc.seen import SeenRipple
from motord.identification import IdentifyError
from motord.identification.torque.torque_sensor import MOUNT_SHARE
from motord.intervals import f_tail, two_digits
from motord.learned import MAX_ORDERS

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
        return f"{self.order} ({1e3 * self.amplitude_Nm:.1f} mNm: {_WHY[self.why]})"


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
