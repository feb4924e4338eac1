"""Uncertainty budgets: what each source contributes to a result's standard uncertainty (GUM).

Type A is what the scatter of the data shows, Type B what is known otherwise: from data sheets, or
assumed. Contributions are standard uncertainties, and combine by the root of the sum of squares;
`coverage_factors` times these are expanded uncertainties.
"""

from collections.abc import Callable, Iterable, Sequence
from math import hypot
from typing import Annotated, Literal

from pydantic import BaseModel, Field

from motord.intervals import NOT_KNOWN, coverage_factor, plus_minus

Uncertainty = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Triple = tuple[Uncertainty, Uncertainty, Uncertainty]
Freedom = Annotated[float, Field(ge=1, allow_inf_nan=False)]


class Contribution(BaseModel, extra="forbid", frozen=True):
    """What a source contributes: standard uncertainties of alpha and beta_A of phases a, b, c, of
    delta epsilon, and of the amplitude of the cogging torque that it moves most.

    basis: "data"; "stated", by the bench file; or "assumed". limit: what is stated or assumed, half
    of a rectangular distribution's width, in `unit`. degrees_of_freedom: of QUANTITIES, of phases
    and orders the fewest; None for many.
    """

    source: str
    type: Literal["A", "B"]
    basis: Literal["data", "stated", "assumed"]
    limit: Uncertainty | None = None
    unit: str = ""
    alpha: Triple
    beta_A: Triple
    delta_epsilon: Uncertainty
    cogging_Nm: Uncertainty
    degrees_of_freedom: tuple[Freedom | None, Freedom | None, Freedom | None, Freedom | None] = (
        None, None, None, None,
    )  # fmt: skip

    @property
    def coverage_factors(self) -> tuple[float, float, float, float]:
        """Half of the 95 % intervals of QUANTITIES in standard uncertainties."""
        alpha, beta, delta_epsilon, cogging = map(coverage_factor, self.degrees_of_freedom)
        return alpha, beta, delta_epsilon, cogging

    @property
    def limit_text(self) -> str:
        """The limit with its unit, and whether it is assumed; "" for what data show."""
        if self.limit is None:
            return ""
        assumed = ", assumed" if self.basis == "assumed" else ""
        if self.unit == "s" and 0 < self.limit < 1e-3:
            return f"{1e6 * self.limit:g} us{assumed}"
        return f"{self.limit:g} {self.unit}{assumed}"


QUANTITIES: tuple[tuple[str, str, Callable[[Contribution], float]], ...] = (
    ("alpha", "%", lambda c: 100 * max(c.alpha)),
    ("beta", "mA", lambda c: 1e3 * max(c.beta_A)),
    ("delta epsilon", "%", lambda c: 100 * c.delta_epsilon),
    ("cogging torque", "mNm", lambda c: 1e3 * c.cogging_Nm),
)
"""What a budget shows of a contribution: name, unit, and value; of three phases the largest."""


def totals(budget: Sequence[Contribution]) -> tuple[Contribution, Contribution, Contribution]:
    """Return Type A, Type B and both, each combined."""
    of_data = combined("Type A: data", "A", [one for one in budget if one.type == "A"])
    others = combined("Type B: all else", "B", [one for one in budget if one.type == "B"])
    return of_data, others, combined("combined", "B", [of_data, others])


def delta_epsilon_text(value: float, source: str, budget: Sequence[Contribution]) -> str:
    """Return the common gain with its interval of Type A, and what it is from, or `assumed`."""
    if source == "assumed":
        return f"{value:.4f} ({source})"
    if not budget:
        return f"{value:.4f} ({source}; {NOT_KNOWN})"
    of_data, *_ = totals(budget)
    half_width = of_data.coverage_factors[2] * of_data.delta_epsilon
    return f"{plus_minus(value, half_width)} ({source})"


def combined(source: str, type_: Literal["A", "B"], parts: Sequence[Contribution]) -> Contribution:
    """Return the combination of contributions, as one of its own.

    Degrees of freedom by Welch and Satterthwaite (JCGM 100, G.4).
    """
    a, b, c = (_root(part.alpha[phase] for part in parts) for phase in range(3))
    beta_a, beta_b, beta_c = (_root(part.beta_A[phase] for part in parts) for phase in range(3))
    return Contribution(
        source=source,
        type=type_,
        basis="data",
        alpha=(a, b, c),
        beta_A=(beta_a, beta_b, beta_c),
        delta_epsilon=_root(part.delta_epsilon for part in parts),
        cogging_Nm=_root(part.cogging_Nm for part in parts),
        degrees_of_freedom=(
            _freedom(parts, 0),
            _freedom(parts, 1),
            _freedom(parts, 2),
            _freedom(parts, 3),
        ),
    )


def _freedom(parts: Sequence[Contribution], quantity: int) -> float | None:
    """Return the effective degrees of freedom of a quantity; None for many."""
    value = QUANTITIES[quantity][2]
    whole = _root(value(part) for part in parts)
    if whole == 0:
        return None
    each = ((value(part) / whole, part.degrees_of_freedom[quantity]) for part in parts)
    doubt = sum(share**4 / freedom for share, freedom in each if freedom is not None)
    return max(1 / doubt, 1.0) if doubt > 0 else None


def _root(values: Iterable[float]) -> float:
    return hypot(*values)
