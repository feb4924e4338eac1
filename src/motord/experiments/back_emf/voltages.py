"""Voltages of a driven rotor: their samples, at which angle and speed, and their spectra."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.identification import IdentifyError
from motord.identification.harmonics import lines_at
from motord.identification.orders import resolved_order
from motord.identification.resample import rising
from motord.identification.rotor.driven_rotor import Driven

VOLTAGES = ("u_a_V", "u_b_V", "u_c_V")

COUNTS_PER_ORDER = 4
"""Encoder counts that a period of the highest order needs."""

OTHER_ORDERS = 256
"""Highest order per turn that is looked at for such."""

OTHER_FUNDAMENTAL = 2.0
"""Times that another order may be as large as the fundamental: beyond, the pole pairs are wrong."""

ABOVE_NOISE = 4.0
"""Times the median line that the strongest is at least, if there is a back-EMF."""


@dataclass(frozen=True)
class VoltageSamples:
    """Voltages at their own instants, all points: n samples."""

    u_V: np.ndarray
    angle_rad: np.ndarray
    speed_rad_s: np.ndarray
    turn: np.ndarray


def voltage_samples(driven: Driven, delay_s: float) -> VoltageSamples:
    """Return the voltages of the whole turns, with angle and speed `delay_s` before they say.

    As they are with magnets of the reference temperature.
    """
    u_V = np.column_stack([driven.ticks[name].astype(float) for name in VOLTAGES])
    u_V /= driven.back_emf_factor
    at_s = driven.t_s
    if "i_age_ns" in (driven.ticks.dtype.names or ()):
        at_s = at_s - driven.ticks["i_age_ns"] * 1e-9
    fresh = rising(at_s)
    at_s = at_s - delay_s
    fresh &= (at_s >= driven.t_s[0]) & (at_s <= driven.t_s[-1])
    rows = [first + np.flatnonzero(fresh[first:end]) for first, end in driven.turns]
    turn = np.repeat(np.arange(len(rows)), [places.size for places in rows])
    chosen = np.concatenate(rows)
    angle_rad, speed_rad_s = driven.motion.at(at_s[chosen])
    return VoltageSamples(u_V[chosen], angle_rad, speed_rad_s, turn)


def joined(parts: list[VoltageSamples]) -> VoltageSamples:
    """Return the samples of all points, their turns numbered on."""
    before = np.cumsum([0, *(int(part.turn[-1]) + 1 for part in parts)])
    return VoltageSamples(
        np.concatenate([part.u_V for part in parts]),
        np.concatenate([part.angle_rad for part in parts]),
        np.concatenate([part.speed_rad_s for part in parts]),
        np.concatenate([part.turn + first for part, first in zip(parts, before, strict=False)]),
    )


def check_pole_pairs(samples: VoltageSamples, driven: list[Driven], motor: MotorConfig) -> None:
    """Raise IdentifyError if they are noise, or their strongest line is not at the pole pairs."""
    size = np.linalg.norm(
        spectra((samples.u_V / samples.speed_rad_s[:, None]).T, samples.angle_rad, driven, motor),
        axis=0,
    )
    strongest = int(np.argmax(size)) + 1
    if size[strongest - 1] < ABOVE_NOISE * float(np.median(size)):
        raise IdentifyError(
            "the voltages are noise, without periods in a turn: is the motor connected, and does "
            "the inverter measure voltages while its power stage is off?"
        )
    if size[strongest - 1] > OTHER_FUNDAMENTAL * size[motor.pole_pairs - 1]:
        raise IdentifyError(
            f"the voltages have {strongest} periods a turn, where [motor] pole_pairs says "
            f"{motor.pole_pairs}: correct it, or counts, if the encoder has others"
        )


def spectra(
    values: Iterable[np.ndarray], angle_rad: np.ndarray, driven: list[Driven], motor: MotorConfig
) -> np.ndarray:
    """Return the lines (m, h) of orders 1 to h of m columns of values (n,) at angles."""
    fewest = min(one.samples_per_turn for one in driven)
    highest = resolved_order(fewest, motor.counts, OTHER_ORDERS, counts_per_order=COUNTS_PER_ORDER)
    cell = np.rint(angle_rad * (motor.counts / (2 * np.pi))).astype(np.int64) % motor.counts
    return np.array([lines_at(cell, one, motor.counts, highest)[1:] for one in values])
