"""What is questionable about an efficiency map, each with its meaning and what to do."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import pi, sqrt

from motord.config import AccuracyConfig
from motord.experiments.signal_findings import mean_torque_scale
from motord.experiments.subject import Subject
from motord.experiments.torque_speed.result import OperatingPower
from motord.experiments.torque_speed.uncertainty import freedom_of_blocks
from motord.findings import Finding, Severity, listed
from motord.intervals import t_quantile

CONFIDENCE_LEVEL = 0.995
"""One-sided, of the test of a drift of the losses."""

DRIFT_PART = 0.03
"""Part of the losses that they may drift within a capture."""

SAMPLING_PART = 0.5
"""Part of the electrical power's standard uncertainty that slow readings may make."""

RIPPLE_PART = 0.5
"""Part of the electrical power's standard uncertainty that the bus voltage's ripple may make."""

SHAFT_PART = 0.5
"""Part of the mechanical power's standard uncertainty that ripple of the shaft may make."""

IN_STEP = 0.3
"""How far readings may fall on the same angles; evenly spread ones are below."""

BY_CHANCE = 2.2
"""Of evenly spread readings, times the root of their number: exceeded once in a hundred."""

BETWEEN_TICKS = 0.002
"""Part of the torque that may be unseen between ticks."""

ACCURACIES = ("torque_gain_percent", "torque_zero_Nm", "power_gain_percent", "power_zero_W")


def findings(points: Sequence[OperatingPower], subject: Subject) -> tuple[Finding, ...]:
    """Return what is questionable about the points."""
    return (
        *mean_torque_scale(
            ((one.torque_Nm, one.torque_mean_Nm) for one in points),
            "mechanical power and efficiency",
        ),
        *_negative(points),
        *_in_step(points),
        *_between_ticks(points, subject),
        *DRIFTING.of(_drifts(points)),
        *SLOW.of(
            (one.sampling_W, SAMPLING_PART * _electrical_stderr_W(one), one) for one in points
        ),
        *RIPPLING.of(
            (one.bus_ripple_W, RIPPLE_PART * sqrt(3) * _electrical_stderr_W(one), one)
            for one in points
        ),
        *SHAFT.of(
            (one.shaft_ripple_W, SHAFT_PART * (one.mechanical.stderr or 0.0), one) for one in points
        ),
        *_assumed(subject.accuracy),
    )


def _negative(points: Sequence[OperatingPower]) -> Iterator[Finding]:
    """Yield a finding where the losses are surely below zero."""
    below = [one for one in points if (one.loss.high or 0.0) < 0]
    if below:
        worst = min(below, key=lambda one: one.loss.high or 0.0)
        yield Finding(
            "negative-losses", worst.loss.value or 0.0, 0.0, "W", "serious",
            f"{_labels(below)}: more power comes out than goes in: sign or gain of torque or power "
            "reading is wrong, or the reading is not of the inverter's supply",
            "check the sign of the torque and of the power, their gains, and the analyser's wiring",
        )  # fmt: skip


def _in_step(points: Sequence[OperatingPower]) -> Iterator[Finding]:
    """Yield a finding where instants of the power are always at the same angles."""
    stuck = [one for one in points if one.in_step > max(IN_STEP, BY_CHANCE / one.readings**0.5)]
    if stuck:
        yield Finding(
            "readings-in-step", max(one.in_step for one in stuck), IN_STEP, "", "serious",
            f"{_labels(stuck)}: the power is read in step with the rotor, at the same electrical "
            "angles in each turn: its ripple is taken for its mean",
            "take other speeds, or let the analyser average from one reading to the next",
        )  # fmt: skip


def _between_ticks(points: Sequence[OperatingPower], subject: Subject) -> Iterator[Finding]:
    """Yield a finding where torque between the ticks may be another than at the ticks.

    Currents that are held for a period T while the rotor turns on make a torque that falls off by
    up to (w_el T)^2 / 8 at the ends, (w_el T)^2 / 24 in the mean; a low-pass hides it.
    """
    filtered_Hz = subject.sensor.resonance_Hz
    parts = [
        ((2 * pi * subject.motor.pole_pairs * one.speed_mean_Hz * one.tick_s) ** 2 / 12, one)
        for one in points
        if not 0 < filtered_Hz < 0.5 / one.tick_s
    ]
    parts = [each for each in parts if each[0] > BETWEEN_TICKS]
    if parts:
        worst, _ = max(parts, key=lambda each: each[0])
        yield Finding(
            "torque-between-ticks", 100 * worst, 100 * BETWEEN_TICKS, "%", "warning",
            f"{_labels([one for _, one in parts])}: a drive that holds its phase currents from "
            "tick to tick makes another torque in between, which a sensor without a low-pass does "
            "not show in the ticks",
            "set the sensor's filter below half of the loop's rate and state it as [torque_sensor] "
            "resonance_Hz, or raise [loop] rate_Hz",
        )  # fmt: skip


@dataclass(frozen=True)
class _Excess:
    """A finding where a power is beyond its limit, of the point where it is by most."""

    name: str
    severity: Severity
    meaning: str
    action: str

    def of(self, sizes: Iterable[tuple[float, float, OperatingPower]]) -> Iterator[Finding]:
        """Yield it for sizes and limits (W) of points, if one is beyond."""
        beyond = [each for each in sizes if each[0] > each[1]]
        if beyond:
            worst_W, limit_W, _ = max(beyond, key=lambda each: each[0] - each[1])
            labels = _labels([one for *_, one in beyond])
            yield Finding(
                self.name, worst_W, limit_W, "W", self.severity, f"{labels}: {self.meaning}",
                self.action,
            )  # fmt: skip


DRIFTING = _Excess(
    "losses-drift", "warning",
    "the losses change within the capture: motor and inverter are not at a steady temperature, or "
    "the torque sensor's zero or gain drifts, of which half may not be in the intervals; the "
    "figures are those of the means",
    "raise settle_s, or run the motor warm before the plan; read the torque at rest before and "
    "after",
)  # fmt: skip
SLOW = _Excess(
    "slow-readings", "note",
    "that the power is read slowly makes most of its uncertainty; it is in the intervals",
    "raise rate_Hz of the channel, or turns; choose speeds that are not in step with it",
)  # fmt: skip
RIPPLING = _Excess(
    "bus-voltage-ripple", "warning",
    "the bus voltage ripples between readings of the mean current; one that ripples along makes "
    "another mean power, by up to this much if its ripple (RMS) is at most its mean: that is in "
    "the intervals, more is not",
    "read the power with an analyser, or the current as instants; keep the bus steadier",
)  # fmt: skip
SHAFT = _Excess(
    "shaft-ripple", "warning",
    "torque and speed ripple together once or twice a turn, by this much of the power: where the "
    "encoder is eccentric, or the torque sensor shows a misaligned coupling, that is no power; "
    "the intervals hold both",
    "centre the encoder's disc, align the coupling",
)  # fmt: skip


def _drifts(points: Sequence[OperatingPower]) -> Iterator[tuple[float, float, OperatingPower]]:
    """Yield drifts of the losses that chance does not make, and what they may be.

    That is a part of the losses, or half of their interval if that is less: as large a drift of the
    torque sensor's zero is not in it. Then a drift counts that no point of all has by chance.
    """
    for one in points:
        drift_W, most_W = abs(one.loss_drift_W), DRIFT_PART * abs(one.loss.value or 0.0)
        by_chance = (1 - CONFIDENCE_LEVEL) / (1 if drift_W > most_W else len(points))
        factor = t_quantile(1 - by_chance, freedom_of_blocks(one.blocks))
        if drift_W > factor * one.loss_drift_stderr_W:
            half_width_W = (one.loss.high or 0.0) - (one.loss.value or 0.0)
            yield drift_W, min(most_W, half_width_W), one


def _electrical_stderr_W(one: OperatingPower) -> float:
    return one.electrical.stderr or 0.0


def _assumed(accuracy: AccuracyConfig) -> Iterator[Finding]:
    assumed = [name for name in ACCURACIES if name not in accuracy.model_fields_set]
    if assumed:
        yield Finding(
            "accuracy-assumed", len(assumed), 0, "limits", "note",
            f"[accuracy] does not state {', '.join(assumed)}: what is typical was assumed, and is "
            "in the intervals",
            "state them from data sheets or calibration certificates",
        )  # fmt: skip


def _labels(points: Sequence[OperatingPower]) -> str:
    return listed([one.label for one in points])
