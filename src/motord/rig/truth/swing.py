"""What a bar on the rotor, its springs and the hand that deflects it really are."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config import Finite, NonNegative, Positive, Section

MAX_SPRINGS = 8
"""Springs that a bar may have."""


class SpringTruth(Section):
    """A spring from the bar to the world: `lever_m` from the axle, on one `side` of the bar.

    Springs of opposite sides pull against each other.
    """

    stiffness_N_per_m: Positive
    lever_m: Positive
    mass_kg: NonNegative
    side: Literal[1, -1]


class SwingTruth(Section):
    """`[swing]`: a bar on the rotor, held by springs, and a hand that deflects it and lets go.

    bar_inertia_kg_m2: of the bar alone, about the axle. The springs are uniform, `length_m` long
    and stretched by `stretch_m` while the bar stands at rest_angle_rad, to which they are square.
    After first_s the hand pulls the bar to deflection_rad (times 1 +- a random part of standard
    deviation deflection_spread) within pull_s, holds it for hold_s, lets go, and begins again
    swing_s later.
    """

    bar_inertia_kg_m2: NonNegative
    springs: Annotated[tuple[SpringTruth, ...], Field(min_length=1, max_length=MAX_SPRINGS)]
    length_m: Positive = 0.6
    stretch_m: NonNegative = 0.2
    rest_angle_rad: Finite = 0.0
    deflection_rad: Annotated[float, Field(gt=0, lt=1)] = 0.17
    deflection_spread: Annotated[float, Field(ge=0, le=0.3)] = 0.05
    first_s: NonNegative = 1.0
    pull_s: Positive = 0.4
    hold_s: NonNegative = 0.6
    swing_s: Positive = 2.0

    @model_validator(mode="after")
    def _springs_stay_taut(self) -> "SwingTruth":
        longest_m = max(spring.lever_m for spring in self.springs)
        if self.stretch_m >= self.length_m:
            raise ValueError("stretch_m must be below length_m")
        if longest_m * self.deflection_rad > self.stretch_m:
            raise ValueError(
                f"the springs go slack: the bar moves them by {longest_m * self.deflection_rad:.3g}"
                f" m, they are stretched by stretch_m = {self.stretch_m:g}"
            )
        return self
