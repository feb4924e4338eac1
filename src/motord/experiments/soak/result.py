"""What is found of a soak: its repetitions, and the trend of each figure over them."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import ClassVar

import numpy as np

from motord.experiments.soak.step import Step
from motord.experiments.soak.trend import CORRELATION_MAX, LEAST, DriftSlope
from motord.findings import Finding, listed
from motord.intervals import coverage_factor, plus_minus

WARMS_UP = (
    "the bench was not at its steady temperature: begin once it is warm, or give it more rest "
    "(pause_s, cool_below_C)"
)
DRIFTS = (
    "compare it with the temperatures; let the bench warm up before, calibrate more often, or look "
    "for what wears, slips or gets loose"
)
CAUSES = {
    "torque_zero_Nm": "it is the same at all set-points: look at the sensor's zero (temperature, "
    "supply) and at friction",
    "torque_gain_percent": "it goes with the torque: look at the sensor's gain, and at the "
    "temperature of the magnets",
}
"""What to do about the drift of a figure, by its name."""

TITLES = {
    "rms_error_percent": "RMS error",
    "noise_rms_percent": "noise, RMS",
    "torque_mean_Nm": "mean torque",
    "torque_zero_Nm": "zero of the torque",
    "torque_gain_percent": "gain of the torque",
    "inverter_temperature_C": "temperature of the inverter",
    "missed_ticks": "missed ticks",
}
"""What the figures of the ticks are called in pictures; a channel of such a name has "channel"
before it."""

STEPPED = (
    "look for what was changed at that time, or slipped or came loose at once (the encoder's "
    "magnet, coupling, sensor); the slope is that of before and after"
)


@dataclass(frozen=True)
class Repetition:
    """A repetition: hours since the first one; complete: whether all of its points are there."""

    repetition: int
    run: str
    hours: float
    points: int
    complete: bool


@dataclass(frozen=True)
class FigureTrend:
    """A figure over the repetitions: hours (n,), values (n,), its slope an hour.

    name: the figure's, with its unit as suffix, then the set-point that it is of, if of one;
    drifts: the slope is no chance, that of all figures judged together. step: None if none is
    beyond chance; with one the slope is that of the values without it.
    """

    JSON: ClassVar = (
        "name", "value=slope.value", "unit=slope_unit", "stderr=slope.stderr", "low", "high",
        "p_value=slope.p_value", "correlation=slope.correlation", "drifts", "step",
        "figure_unit=unit", "time_series",
    )  # fmt: skip

    name: str
    unit: str
    hours: np.ndarray
    values: np.ndarray
    slope: DriftSlope
    drifts: bool = False
    of_point: bool = False
    step: Step | None = None

    @property
    def time_series(self) -> dict[str, np.ndarray]:
        """The values over hours."""
        return {"hours": self.hours, "values": self.values}

    @property
    def title(self) -> str:
        """What it is called in pictures."""
        name, of, point = self.name.partition(" of ")
        return f"{TITLES.get(name, name)}{of}{point}"

    @property
    def slope_unit(self) -> str:
        """Unit of the slope."""
        return f"{self.unit}/h"

    @property
    def low(self) -> float | None:
        """Lower end of the slope's 95 % interval."""
        half = self.slope.half_width
        return None if half is None else self.slope.value - half

    @property
    def high(self) -> float | None:
        """Upper end of the slope's 95 % interval."""
        half = self.slope.half_width
        return None if half is None else self.slope.value + half

    @property
    def mean(self) -> float:
        """Mean of the values."""
        return float(self.values.mean())

    def with_scale(self, scale: float) -> "FigureTrend":
        """Return the trend whose slope and step are as unsure as the scale of its values, too.

        scale: standard uncertainty, in parts (Type B).
        """
        slope, step = self.slope, self.step
        if slope.stderr is None:
            return self
        common = scale * slope.value
        half_width = hypot(slope.half_width or 0.0, coverage_factor() * common)
        slope = replace(slope, stderr=hypot(slope.stderr, common), half_width=half_width)
        if step is not None:
            half_width = hypot(step.half_width, coverage_factor() * scale * step.value)
            step = replace(step, half_width=half_width)
        return replace(self, slope=slope, step=step)

    def to_text(self) -> str:
        """Return the slope with half of its interval, if that is known."""
        half = self.slope.half_width
        if half is None:
            return f"{self.slope.value:.3g}"
        return plus_minus(self.slope.value, half)


@dataclass(frozen=True)
class SoakResult:
    """The repetitions of a plan, and the trends of their figures."""

    JSON: ClassVar = ("plan", "hours", "statement", "repetitions", "trends")

    plan: str
    repetitions: tuple[Repetition, ...]
    trends: tuple[FigureTrend, ...]
    questionable: tuple[Finding, ...] = ()

    @property
    def hours(self) -> float:
        """Time from the first repetition to the last."""
        return self.repetitions[-1].hours - self.repetitions[0].hours

    @property
    def statement(self) -> str:
        """Whether there is a drift, in a sentence."""
        count = len(self.repetitions)
        of = f"{count} repetitions of {self.plan} in {self.hours:.3g} h"
        judged = [one for one in self.trends if one.slope.p_value is not None]
        drift = [one.name for one in judged if one.drifts]
        stepped = [one.name for one in judged if one.step]
        if not judged:
            return f"{of}: too few to tell a drift from chance, {LEAST} are needed"
        if not drift and not stepped:
            return f"{of}: no drift in {len(judged)} figures beyond what chance explains"
        found = {"drift": drift, "changed at once": stepped}
        return f"{of}: " + "; ".join(
            f"{len(names)} of {len(judged)} figures {how}: {listed(names, 3, ', ')}"
            for how, names in found.items()
            if names
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Drifts, steps, a correlation too high for the intervals, and what is questionable."""
        return (*self._drifts(), *self._steps(), *self._correlated(), *self.questionable)

    def _drifts(self) -> Iterator[Finding]:
        """Yield a finding of each figure that drifts, by the set-point of the largest slope."""
        for name, several in _by_figure([one for one in self.trends if one.drifts]):
            worst = max(several, key=lambda one: abs(one.slope.value))
            also = _also([f"{one.name} by {one.to_text()}" for one in several if one is not worst])
            yield Finding(
                f"drift-of-{name}", worst.slope.value, worst.slope.half_width or 0.0,
                worst.slope_unit, "warning",
                f"{worst.name} changes by {worst.to_text()} {worst.slope_unit} over "
                f"{self.hours:.3g} h, from {worst.values[0]:.4g} to {worst.values[-1]:.4g} "
                f"{worst.unit}{also}",
                WARMS_UP if worst.unit == "degC" else CAUSES.get(worst.name, DRIFTS),
            )  # fmt: skip

    def _steps(self) -> Iterator[Finding]:
        """Yield a finding of each figure that has a step, by the set-point of the largest."""
        stepped = [(one, one.step) for one in self.trends if one.step is not None]
        steps = {one.name: step for one, step in stepped}
        for name, several in _by_figure([one for one, _ in stepped]):
            worst = max(several, key=lambda one: abs(steps[one.name].value))
            step = steps[worst.name]
            also = _also([
                f"{one.name} by {plus_minus(its.value, its.half_width)} after {its.hours:.3g} h"
                for one in several if one is not worst for its in [steps[one.name]]
            ])  # fmt: skip
            yield Finding(
                f"step-of-{name}", step.value, step.half_width, worst.unit, "warning",
                f"{worst.name} changed by {plus_minus(step.value, step.half_width)} {worst.unit} "
                f"at once, {step.hours:.3g} h after the first repetition, from "
                f"{worst.values[step.place - 1]:.4g} to {worst.values[step.place]:.4g} "
                f"{worst.unit}{also}",
                STEPPED,
            )  # fmt: skip

    def _correlated(self) -> Iterator[Finding]:
        slopes = (one.slope for one in self.trends)
        known = [one.correlation for one in slopes if one.stderr and one.correlation is not None]
        typical = float(np.median(known)) if known else 0.0
        if typical > CORRELATION_MAX:
            yield Finding(
                "correlated-repetitions", typical, CORRELATION_MAX, "1", "note",
                "figures wander slowly over the repetitions: intervals of slopes may be too "
                "narrow, and a drift may be claimed that is none",
                "repeat for longer, with more rest between the repetitions",
            )  # fmt: skip


def _by_figure(trends: Sequence[FigureTrend]) -> Iterator[tuple[str, list[FigureTrend]]]:
    """Yield the trends of each figure, of whatever set-points, by its part of a finding's name."""
    figures: dict[str, list[FigureTrend]] = {}
    for one in trends:
        figures.setdefault(one.name.partition(" of ")[0], []).append(one)
    for figure, several in figures.items():
        yield re.sub("[ _]", "-", figure).lower(), several


def _also(texts: Sequence[str]) -> str:
    return f"; so do {listed(texts)}" if texts else ""
