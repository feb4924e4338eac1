"""What an experiment announces of the figures that its results state with an uncertainty."""

from dataclasses import dataclass
from typing import Literal

from motord.config.unit_suffixes import split_unit, unit_of


@dataclass(frozen=True)
class FigureKind:
    """A figure in the JSON result of an analysis, for which a motor type can have limits.

    Keys are those of the result, with dots between. rows: the list of objects that have one each,
    by default the result itself; by: keys that separate the rows. value: in the row; a list of
    three is of phases a, b, c. stderr: its standard uncertainty, in the row; low, high: the ends of
    its 95 % interval. freedom: degrees of freedom, in the row or else in the result; without it
    stderr and the ends say them.
    budget: quantity of the result's uncertainty budget, whose Type B adds to the uncertainty, and
    whose Type A is the uncertainty if nothing else is named.

    combine: one figure of all rows or phases, the largest less the smallest, or the mean.
    """

    name: str
    unit: str
    summary: str
    value: str
    stderr: str = ""
    low: str = ""
    high: str = ""
    freedom: str = ""
    budget: Literal["", "alpha", "beta_A", "delta_epsilon", "cogging_Nm"] = ""
    rows: str = ""
    by: tuple[str, ...] = ()
    combine: Literal["", "spread", "mean"] = ""


def with_ends(name: str, summary: str, rows: str = "", by: tuple[str, ...] = ()) -> FigureKind:
    """Return the kind of a figure `x_Nm`; x_stderr_Nm, x_low_Nm, x_high_Nm are in the same row."""
    x, suffix = split_unit(name)
    stderr, low, high = (
        "_".join(filter(None, (x, of, suffix))) for of in ("stderr", "low", "high")
    )
    return FigureKind(name, unit_of(name), summary, name, stderr, low, high, rows=rows, by=by)
