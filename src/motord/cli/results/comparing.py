"""`motord results compare`: two recordings, motors or versions."""

from collections.abc import Iterable
from math import isfinite
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.common_options import AsJson
from motord.cli.console import fail, print_json, print_line
from motord.cli.results.printing import aligned, plain
from motord.cli.results.store_options import StoreReading, StoreToRead
from motord.cli.results.trends import Where

if TYPE_CHECKING:
    from motord.results.comparison import Difference, Key
    from motord.results.figures import ResultFigure
    from motord.results.stored_result import ResultRow


def compare(
    a: Annotated[str, typer.Argument(metavar="A", help="Serial number, recording or version.")],
    b: Annotated[str, typer.Argument(metavar="B", help="Another one of the same kind.")],
    where: Where = "",
    every: Annotated[
        bool, typer.Option("--all", help="Also figures without uncertainties, in the text.")
    ] = False,
    store: StoreToRead = None,
    as_json: AsJson = False,
) -> None:
    """Compare two motors, recordings or versions: differences B - A with combined uncertainty.

    Of each recording the newest version's result counts, unless versions are compared; of several
    results the mean, whose stated uncertainty is that of one: it may be an error in common. A
    difference counts as a change if chance makes any so large in 5 % of such comparisons.
    """
    from motord.results.comparison import compare as differences
    from motord.results.selection import either, newest, rows_of

    if a == b:
        raise typer.BadParameter(f"{a} and {b} are the same")
    reading = StoreReading(store)
    column, of_a, of_b = either(rows_of(reading.table, None, where), a, b)
    of_a, of_b = newest(of_a), newest(of_b)
    found = differences(_by_key(of_a), _by_key(of_b))
    if not found:
        fail(f"{a} and {b} have no figures in common: were different experiments made of them?")
    if as_json:
        print_json({"compared": column, "a": a, "b": b, "differences": [*map(_as_json, found)]})
    else:
        _print(found, every)
        if column == "version" and {row.run for row in of_a} & {row.run for row in of_b}:
            print_line(
                "both versions analysed the same recordings, whose noise they share: they should "
                "differ by much less than the uncertainties"
            )
    reading.finish()


def _by_key(rows: "Iterable[ResultRow]") -> "dict[Key, list[ResultFigure]]":
    found: dict[Key, list[ResultFigure]] = {}
    for row in rows:
        found.setdefault((row.experiment, row.field, row.unit), []).append(row.figure)
    return found


def _print(found: "list[Difference]", every: bool) -> None:
    known = [one for one in found if one.half_width is not None]
    columns = ("experiment", "field", "unit", "A", "B", "B - A", "+- (95 %)", "p", "")
    rows = [
        (one.experiment, one.field, one.unit, *_rounded(one), "changed" if one.changed else "")
        for one in (found if every else known)
    ]
    for line in aligned(columns, rows):
        print_line(line)
    if any(max(one.a.results, one.b.results) > 1 for one in known):
        print_line(
            "means of several results: the uncertainty that they state counts as common to a side "
            "and is not divided by their number, their scatter is"
        )
    changed = sum(one.changed for one in found)
    more = len(found) - len(known)
    print_line(
        f"{changed} of {len(known)} differences are more than the uncertainties explain (5 % for "
        f"all of them together)" + (f"; {more} figures state no uncertainty" if more else "")
    )


def _rounded(one: "Difference") -> tuple[float | None, ...]:
    """Return A, B, B - A and half its interval, with two digits of the latter; p with three."""
    from motord.intervals import decimals_of

    figures = (one.a.value, one.b.value, one.difference)
    if one.half_width is None or one.p_value is None:
        return *figures, one.half_width, one.p_value
    p_value = float(f"{one.p_value:.3g}")
    if not isfinite(one.half_width) or one.half_width <= 0:
        return *figures, one.half_width, p_value
    decimals = decimals_of(one.half_width)
    rounded = (round(x, decimals) + 0.0 for x in (*figures, one.half_width))  # -0.0 + 0.0 is 0.0
    return *rounded, p_value


def _as_json(one: "Difference") -> dict[str, object]:
    found: dict[str, object] = plain({**vars(one), "a": vars(one.a), "b": vars(one.b)})
    return found
