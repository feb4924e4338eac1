"""The file of a motor type: the plans that test it, and the limits of what they measure (TOML)."""

from collections import Counter
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from motord.config.base import Finite, Section
from motord.config.experiments import AnalysisKind, analysis_kinds, plan_kinds
from motord.config.figures import FigureKind
from motord.config.reading import read_toml, validate
from motord.section.complaints import wrong_setting
from motord.verdict.decision import Tolerance

RISK_PERCENT = 2.5

CHOICES = {"phase": ("a", "b", "c"), "direction": ("forwards", "backwards")}
NUMBERS = ("order", "torque_Nm", "speed_Hz", "compensate")
"""What `at` may be, by its keys."""


class PlanToRun(Section):
    """`[[plan]]`: a plan that the test of a motor runs."""

    name: str
    """The plan, as `motord plan list` names it."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Its settings, where they differ from the bench file's."""

    @model_validator(mode="after")
    def _known(self) -> "PlanToRun":
        kinds = plan_kinds()
        if self.name not in kinds:
            raise ValueError(f"no plan '{self.name}'; there are: {', '.join(kinds)}")
        own = kinds[self.name].settings
        try:
            type(own).model_validate({**own.model_dump(), **self.settings})
        except ValidationError as error:
            wrong = wrong_setting(error, [*type(own).model_fields])
            raise ValueError(f"{self.name}: {wrong}") from None
        return self


class FigureLimit(Section):
    """`[[limit]]`: limits of a figure, or of all figures of its name that `at` does not exclude."""

    analysis: str
    """The analysis whose result has it, as `motord analyse` names it."""
    figure: str
    """Its name; the reference lists those of each analysis."""
    at: dict[str, str | float] = Field(default_factory=dict)
    """Which of several: phase, order, direction, or set-point; without it, each of them."""
    unit: str | None = None
    """Unit of the limits, to be compared with the figure's."""
    low: Finite | None = None
    """What it is at least."""
    high: Finite | None = None
    """What it is at most."""

    @property
    def kind(self) -> FigureKind:
        """The figure, as its experiment announces it. Raises KeyError for one that none does."""
        return {one.name: one for one in analysis_kinds()[self.analysis].figures}[self.figure]

    @property
    def tolerance(self) -> Tolerance:
        """The limits."""
        return Tolerance(self.low, self.high)

    @model_validator(mode="after")
    def _possible(self) -> "FigureLimit":
        self._check_figure()
        if self.low is None and self.high is None:
            raise ValueError(f"{self.figure}: neither low nor high is given")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"{self.figure}: low = {self.low:g} is not below high = {self.high:g}")
        return self

    def _check_figure(self) -> None:
        kinds = {kind.name: kind for kind in analysis_kinds().values() if kind.figures}
        if self.analysis not in kinds:
            raise ValueError(
                f"analysis '{self.analysis}' states no figure with its uncertainty; these do: "
                f"{', '.join(kinds)}"
            )
        figures = [one.name for one in kinds[self.analysis].figures]
        if self.figure not in figures:
            raise ValueError(
                f"{self.analysis} has no figure '{self.figure}'; it has: {', '.join(figures)}"
            )
        if self.unit is not None and self.unit != self.kind.unit:
            own = f"'{self.kind.unit}'" if self.kind.unit else "none"
            raise ValueError(f"{self.figure}: unit is '{self.unit}', that of the figure {own}")
        self._check_place()

    def _check_place(self) -> None:
        """Refuse an `at` that no figure can have."""
        unknown = self.at.keys() - set(self.kind.by)
        if unknown:
            raise ValueError(
                f"{self.figure}: at has {', '.join(sorted(unknown))}; the figure is separated by "
                f"{', '.join(self.kind.by) or 'nothing'}"
            )
        for key, value in self.at.items():
            if key in CHOICES and value not in CHOICES[key]:
                raise ValueError(f"at {key} = {value!r}: one of {', '.join(CHOICES[key])}")
            if key in NUMBERS and isinstance(value, str):
                raise ValueError(f"at {key} = {value!r}: a number is needed")


class MotorType(Section):
    """The file of a motor type."""

    motor: Annotated[str, Field(min_length=1)]
    """The motor's name, as `[motor] name` of the bench file has it."""
    risk_percent: Annotated[float, Field(gt=0, lt=50)] = RISK_PERCENT
    """Probability at which a figure that passes may be out of its limits, and at which one that
    fails may be within them, at most."""
    plan: tuple[PlanToRun, ...] = ()
    """Plans to run, in order."""
    limit: Annotated[tuple[FigureLimit, ...], Field(min_length=1)]
    """Limits of figures."""

    @property
    def risk(self) -> float:
        """The risk in parts."""
        return self.risk_percent / 100

    @model_validator(mode="after")
    def _consistent(self) -> "MotorType":
        _refuse_doubles(self.limit)
        if not self.plan:
            return self
        analyses = Counter(kind.name for one in self.plan if (kind := analysis_of(one.name)))
        for name, count in analyses.items():
            if count > 1:
                raise ValueError(f"{count} plans are analysed by {name}; only one can be")
        for limit in self.limit:
            if limit.analysis not in analyses:
                raise ValueError(
                    f"limit of {limit.figure}, and no [[plan]] is analysed by {limit.analysis}"
                )
        return self


def _refuse_doubles(limits: tuple[FigureLimit, ...]) -> None:
    counts = Counter((one.analysis, one.figure, tuple(sorted(one.at.items()))) for one in limits)
    for (analysis, figure, _), count in counts.items():
        if count > 1:
            raise ValueError(f"{count} limits of {analysis} {figure} at the same place")


def analysis_of(plan: str) -> AnalysisKind | None:
    """Return the analysis of recordings of a plan, None if there is none."""
    kinds = analysis_kinds().values()
    return next((kind for kind in kinds if plan in (kind.name, *kind.aliases)), None)


def load_motor_type(path: Path) -> MotorType:
    """Read and check the file of a motor type. Raises ConfigError naming file, line and field."""
    text, data = read_toml(path)
    return validate(MotorType, path, text, data)
