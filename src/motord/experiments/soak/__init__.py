"""A plan repeated for hours, and the trend of torque, temperatures and timing over them."""

from typing import Annotated, Any

from pydantic import Field

from motord.config import Section
from motord.config.experiments import experiment
from motord.config.figures import FigureKind

NAME = "soak"

YEAR_H, DAY_S = 8760, 86_400
"""Longest soak, and longest rest."""


class SoakConfig(Section):
    """`[plans.soak]`: a plan again and again, for the trend of what it shows."""

    plan: str = "verify"
    """The plan that is repeated."""
    inner: dict[str, Any] = Field(default_factory=dict)
    """Settings of that plan, over the bench's own."""
    repeats: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """Repetitions; 0: as many as hours allow."""
    hours: Annotated[float, Field(ge=0, le=YEAR_H)] = 1.0
    """With repeats = 0: time after which no further repetition begins."""
    pause_s: Annotated[float, Field(ge=0, le=DAY_S)] = 60.0
    """Rest between two repetitions, the bench switched off."""
    cool_below_C: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Temperature of the inverter that the rest waits for; 0: it does not wait."""
    cool_timeout_s: Annotated[float, Field(gt=0, le=DAY_S)] = 3600.0
    """Longest time that it waits, then the plan fails."""


EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=SoakConfig(),
    plan="another plan again and again, for hours, for the trend afterwards",
    analysis="Find drifts of torque, temperatures and timing over the repetitions of a plan.",
    schema="motord.soak/1",
    position=65,
    figures=(
        FigureKind(
            "slope",
            summary="trend of a figure over the repetitions",
            value="value",
            rows="trends",
            by=("name",),
            unit="unit of the figure an hour",
        ),
    ),
)
