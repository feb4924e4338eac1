"""The result of a check: changes with their limits, what would have been seen, and the verdict."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from motord.findings import Finding, listed
from motord.intervals import coverage_factor, plus_minus, two_digits

FALSE_ALARMS = 0.005
"""Probability that noise alone makes any of a check's changes count as drift."""

POWER = 0.95
"""Share of checks in which a change of the size `detectable` is found."""

NEEDED_PERCENT = 0.2
"""RMS ripple that no change may add unseen: a fifth of what a calibrated bench is to reach."""

MISFIT_LIMIT = 2.0
"""Mean square that may be left at the model's own orders, over what is expected."""

Verdict = Literal["valid", "drifted", "undecided"]


@dataclass(frozen=True)
class Change:
    """A change of what a calibration states, with the standard error of check and calibration.

    Beyond +-limit it is no chance; a change by `detectable` is found in 95 % of checks, and makes
    ripple_percent of RMS torque at rated torque (0: none). drifted: beyond the limit, and no
    consequence of another one.
    """

    name: str
    meaning: str
    unit: str
    value: float
    stderr: float
    degrees_of_freedom: float
    limit: float
    detectable: float
    ripple_percent: float
    drifted: bool

    JSON = (
        "name", "unit", "value", "stderr", "degrees_of_freedom", "half_width", "limit",
        "detectable", "ripple_percent", "drifted",
    )  # fmt: skip

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return coverage_factor(self.degrees_of_freedom) * self.stderr

    @property
    def finding(self) -> Finding:
        """What the change means."""
        return Finding(
            f"calibration-drifted-{self.name}", abs(self.value), self.limit, self.unit, "serious",
            f"{self.meaning} has changed by {self.value:+.3g} {self.unit} since the calibration",
            "calibrate again; if it goes on changing, look at temperature, plugs and sensors",
        )  # fmt: skip


@dataclass(frozen=True)
class CalibrationCheck:
    """The test of calibration `calibration` (its id) by whole turns of several points.

    misfit: see `LineFit`; needed_percent: RMS ripple at rated torque (% of it) that a change must
    not add unseen; unseen: text of what could not be tested; ripple_unseen: whether any of it
    makes ripple; more_findings: of the recording.
    """

    calibration: str
    changes: tuple[Change, ...]
    misfit: float
    turns: tuple[int, ...]
    needed_percent: float
    unseen: tuple[str, ...] = ()
    ripple_unseen: bool = False
    more_findings: tuple[Finding, ...] = ()

    JSON = (
        "calibration", "verdict", "sentence", "changes", "misfit", "turns", "needed_percent",
        "unseen",
    )  # fmt: skip

    @property
    def drifted(self) -> tuple[Change, ...]:
        """The changes that are no chance, the surest first."""
        found = [one for one in self.changes if one.drifted]
        return tuple(sorted(found, key=lambda one: -abs(one.value) / one.limit))

    @property
    def weakest(self) -> Change | None:
        """The change that could add most ripple unseen."""
        return max(self.changes, key=lambda one: one.ripple_percent, default=None)

    @property
    def verdict(self) -> Verdict:
        """Whether the calibration still holds."""
        if self.drifted:
            return "drifted"
        return "undecided" if any(self._doubts()) else "valid"

    def _doubts(self) -> Iterator[Finding]:
        """Yield what leaves a verdict in doubt that nothing has changed."""
        if not self.misfit <= MISFIT_LIMIT:
            yield Finding(
                "torque-not-as-modelled", self.misfit, MISFIT_LIMIT, "times noise", "warning",
                "the torque departs from the calibration's model in a way that no gain, offset or "
                "cogging torque explains; limits are wider by it",
                "align the encoder, check the torque sensor's settings, then calibrate again: its "
                "findings name the departure",
            )  # fmt: skip
        if self.ripple_unseen:
            yield Finding(
                "not-tested", len(self.unseen), 0, "quantities", "warning",
                f"these turns do not show {listed(self.unseen, 1)}",
                "take the turns by `motord plan start check-calibration`, in both directions; if "
                "they are, more of them, by --set turns=10",
            )  # fmt: skip
        weakest = self.weakest
        if weakest is not None and not weakest.ripple_percent <= self.needed_percent:
            yield Finding(
                "change-not-seen", weakest.ripple_percent, self.needed_percent, "% of rated",
                "warning",
                f"{weakest.meaning} would have to change by {weakest.detectable:.3g} "
                f"{weakest.unit} to be found, which adds more ripple than may stay unseen",
                "repeat the check with more turns or a larger torque; a calibration from more "
                "turns states smaller errors",
            )  # fmt: skip

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has changed, and what speaks against the test."""
        changed = tuple(one.finding for one in self.drifted)
        return (*changed, *self._doubts(), *self.more_findings)

    @property
    def sentence(self) -> str:
        """The verdict as text."""
        if self.verdict == "drifted":
            what = "; ".join(
                f"{one.meaning} by {one.value:+.3g} {one.unit} (limit {two_digits(one.limit)})"
                for one in self.drifted
            )
            return f"drifted: calibration {self.calibration} no longer holds: {what}"
        if self.verdict == "undecided":
            return (
                f"undecided: calibration {self.calibration} was not found to have changed, but "
                f"{next(self._doubts()).meaning}"
            )
        return f"valid: calibration {self.calibration} still holds; {self.power}"

    @property
    def power(self) -> str:
        """What is found, as text: of each kind the change that has to be largest."""
        parts = []
        for kind, what in (
            ("gain", "a phase's gain"),
            ("offset", "an offset"),
            ("cogging", "an order of the cogging torque"),
        ):
            found = [c for c in self.changes if c.name.startswith(kind) and c.ripple_percent > 0]
            if found:
                worst = max(found, key=lambda one: one.detectable)
                parts.append(f"of {what} by {two_digits(worst.detectable)} {worst.unit}")
        return f"a change {', '.join(parts)} is found in 95 % of such checks"

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row of text for each change."""
        return [
            (
                one.name,
                plus_minus(one.value, one.half_width),
                two_digits(one.limit),
                two_digits(one.detectable),
                one.unit,
                "drifted" if one.drifted else "",
            )
            for one in self.changes
        ]
