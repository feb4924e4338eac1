"""What an experiment announces of the figures that its results state with an uncertainty."""

from dataclasses import KW_ONLY, dataclass
from typing import Literal

from motord.config.unit_suffixes import unit_of


@dataclass(frozen=True)
class FigureKind:
    """A figure in the JSON result of an analysis, for which a motor type can have limits.

    rows: the list of objects that have one each, by default the result itself; by: keys that
    separate the rows. value: its key in the row, by default its name; a list of three is of phases
    a, b, c. unit: by default that of its name. Standard error, 95 % interval and degrees of freedom
    are found by the names of their keys, as `motord.results.figures` says. leading: errors without
    a name, such as stderr_Nm, are of this figure, though others in its row have its unit, too.
    budget: quantity of the result's uncertainty budget, whose Type B adds to the uncertainty, and
    whose Type A is the uncertainty if no key is of one; null there says that it is not known.

    combine: one figure of all rows or phases, the largest less the smallest, or the mean.
    """

    name: str
    _: KW_ONLY
    summary: str
    value: str = ""
    unit: str = ""
    budget: Literal["", "alpha", "beta_A", "delta_epsilon", "cogging_Nm"] = ""
    rows: str = ""
    by: tuple[str, ...] = ()
    combine: Literal["", "spread", "mean"] = ""
    leading: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", self.value or self.name)
        for field in ("value", "rows"):
            if "." in (key := getattr(self, field)):
                raise ValueError(
                    f"figure {self.name}: {field} = {key!r} is a path: name a key of the result, or"
                    " of a row of its list `rows`, and let the analysis state the figure there"
                )
        object.__setattr__(self, "unit", self.unit or unit_of(self.name))
