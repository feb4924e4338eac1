"""What is questionable about the signals of a profile's cycles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.experiments.signal_findings import (
    SCALE_PART,
    current_scale,
    signal_findings,
    torque_scale,
)
from motord.experiments.subject import Subject
from motord.findings import Finding
from motord.identification.operating_points import COMMANDS, CURRENTS, stacked
from motord.identification.signal_condition import (
    CurrentProducts,
    SignalFault,
    signal_faults,
    stuck_lines,
)
from motord.identification.turning import unwrap_counts

SHOWN_PART = 0.05
"""RMS of the set torque about its mean, in parts of rated, that shows the scale of the measured."""

SPOILED = "energy, power and torque"


@dataclass(frozen=True)
class CycleSignals:
    """A cycle's signals, to be checked: faults, and products with what was set.

    currents: nan where no commands were recorded. set_Nm2: sum of the squares of the set torque
    about its mean, as the sensor would pass it; sensor_Nm2: of its products with the measured one.
    own_Nm2, currents_Nm2: the same of the set torque itself and the torque that the currents make,
    where that is used.
    """

    label: str
    samples: int
    faults: tuple[SignalFault, ...]
    currents: CurrentProducts
    set_Nm2: float
    sensor_Nm2: float
    own_Nm2: float
    currents_Nm2: float

    @classmethod
    def of(
        cls,
        label: str,
        ticks: np.ndarray,
        passed_Nm: np.ndarray,
        currents_Nm: np.ndarray,
        motor: MotorConfig,
    ) -> "CycleSignals":
        """Return the signals of ticks (n,).

        passed_Nm (n,): what the sensor passes of the set torque; currents_Nm (n,): torque of the
        currents, nan where it is not used.
        """
        count, names = ticks["encoder_count"].astype(np.int64), ticks.dtype.names or ()
        sensed_A, used = stacked(ticks, CURRENTS), bool(np.isfinite(currents_Nm).all())
        commanded = set(COMMANDS) <= set(names)
        commanded_A = stacked(ticks, COMMANDS) if commanded else np.full((ticks.size, 3), np.nan)
        watched = ("torque_Nm", *CURRENTS) if used else ("torque_Nm",)
        commands = {
            one: ticks[name] for one, name in zip(CURRENTS, COMMANDS, strict=True) if name in names
        }
        turns = float(np.abs(np.diff(unwrap_counts(count, motor.counts))).sum()) / motor.counts
        faults = signal_faults({name: ticks[name] for name in watched}, turns, commands)
        return cls(
            label,
            ticks.size,
            (*faults, *stuck_lines(count, motor.counts)),
            CurrentProducts.of(sensed_A, commanded_A),
            *_products(ticks["torque_Nm"].astype(float), passed_Nm),
            *(_products(currents_Nm, ticks["torque_set_Nm"].astype(float)) if used else (0.0, 0.0)),
        )


def _products(torque_Nm: np.ndarray, set_Nm: np.ndarray) -> tuple[float, float]:
    """Return the sums of squares of the set torque (n,) and of its products with another."""
    about_Nm = set_Nm - set_Nm.mean() if set_Nm.size else set_Nm
    return float(about_Nm @ about_Nm), float(about_Nm @ torque_Nm)


def findings(cycles: Sequence[CycleSignals], subject: Subject) -> tuple[Finding, ...]:
    """Return what is questionable about the signals of the cycles."""
    least_Nm2 = (SHOWN_PART * subject.motor.rated_torque_Nm) ** 2 * sum(c.samples for c in cycles)
    set_Nm2, own_Nm2 = sum(c.set_Nm2 for c in cycles), sum(c.own_Nm2 for c in cycles)
    products = cycles[0].currents
    for cycle in cycles[1:]:
        products += cycle.currents
    found = list(signal_findings((one.label, one.faults) for one in cycles))
    if set_Nm2 > least_Nm2:
        found += torque_scale(sum(c.sensor_Nm2 for c in cycles) / set_Nm2, SPOILED)
    if own_Nm2 > 0:
        found += current_scale(products.ratios, f"{SPOILED} rest on them")
    if own_Nm2 > least_Nm2:
        found += _torque_of_currents(sum(c.currents_Nm2 for c in cycles) / own_Nm2)
    return tuple(found)


def _torque_of_currents(ratio: float) -> Iterator[Finding]:
    """Yield a finding if the currents make much more or less than the torque that was set."""
    if abs(ratio - 1) > SCALE_PART:
        yield Finding(
            "torque-of-currents", 100 * (ratio - 1), 100 * SCALE_PART, "%", "serious",
            f"the currents make {ratio:.3g} times the torque that was set, by the back-EMF at the "
            f"encoder's angle: zero or direction of the encoder, the back-EMF or the currents are "
            f"wrong, and {SPOILED} with them",
            "align (`motord plan start align`); check the scale of the currents",
        )  # fmt: skip
