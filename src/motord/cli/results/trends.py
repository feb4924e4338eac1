"""`motord results trend` and `compare`: a field over time, and two motors, recordings, versions."""

import io
from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from motord.atomic_write import write_whole
from motord.cli.common_options import AsJson, output_file
from motord.cli.console import fail, print_json, print_line
from motord.cli.results.printing import aligned
from motord.cli.results.store_options import StoreReading, StoreToRead

if TYPE_CHECKING:
    from motord.results.comparison import Difference, Key
    from motord.results.control_chart import Trend
    from motord.results.figures import ResultFigure
    from motord.results.stored_result import ResultRow

PICTURES = (".svg", ".png")
"""Kinds of pictures, by the end of their names."""

PANELS_MAX = 24
"""Charts on one picture."""

Where = Annotated[
    str,
    typer.Option(
        "--where", metavar="SQL", help="Only rows for which this holds, e.g. motor = 'A'."
    ),
]


def trend(
    field: Annotated[str, typer.Argument(metavar="FIELD", help="Such as alpha.a.")],
    by: Annotated[
        Literal["serial", "motor", "bench"],
        typer.Option("--by", help="What has a chart of its own."),
    ] = "serial",
    where: Where = "",
    output: Annotated[Path | None, output_file("Draw the charts: .svg or .png.")] = None,
    store: StoreToRead = None,
    as_json: AsJson = False,
) -> None:
    """Show how a field varies over time: control charts by the Western Electric rules.

    Of each recording the newest version's result counts. Limits are three standard deviations from
    the mean of all points, by the mean difference of successive points / 1.128.
    """
    from motord.results.control_chart import trends
    from motord.results.selection import newest, rows_of

    if output is not None and output.suffix not in PICTURES:
        raise typer.BadParameter(f"{output}: its name must end with {' or '.join(PICTURES)}")
    reading = StoreReading(store)
    found = trends(newest(rows_of(reading.table, field, where)), by)
    if output is not None:
        _draw(field, by, found, output)
    if as_json:
        print_json([_as_json(by, one) for one in found])
    else:
        for one in found:
            _print(by, one)
        if output is not None:
            print_line(f"wrote {output}")
    reading.finish()


def _print(by: str, one: "Trend") -> None:
    from motord.results.control_chart import PRELIMINARY, RULES

    name, unit = f"{by} {one.name or '(none)'}", f" {one.rows[0].unit}".rstrip()
    if one.chart is None:
        print_line(f"{name}: one result, {one.values[0]:.6g}{unit}: no limits")
        return
    low, high = one.chart.limits
    stated = f"{one.stderr:.2g}" if one.stderr is not None else "none"
    print_line(
        f"{name}: {len(one.rows)} results, mean {one.chart.centre:.6g}{unit}, "
        f"sigma {one.chart.sigma:.2g}, limits {low:.6g} to {high:.6g}; "
        f"stated standard error {stated}"
    )
    if one.chart.preliminary:
        print_line(f"  fewer than {PRELIMINARY} results: the limits are preliminary")
    if one.chart.correlated:
        print_line(
            f"  results resemble those before: correlation {one.chart.correlation:.2f}, by chance "
            f"up to {one.chart.correlation_limit:.2f}; the limits are too narrow for such results"
        )
    rows = [
        (one.rows[at].time, one.rows[at].run, float(one.values[at]), ", ".join(map(str, rules)))
        for at, rules in enumerate(one.violated)
        if rules
    ]
    if not rows:
        print_line("  no rule is violated")
        return
    for line in aligned(("time", "run", "value", "rules"), rows):
        print_line(f"  {line}")
    for rule in RULES:
        if any(rule.number in rules for rules in one.violated):
            print_line(f"  rule {rule.number}: {rule.words}")


def _as_json(by: str, one: "Trend") -> dict[str, Any]:
    from motord.recording.json_encoding import plain

    chart = one.chart
    points = zip(one.rows, one.values.tolist(), one.violated, strict=True)
    return {
        by: one.name,
        "field": one.rows[0].field,
        "unit": one.rows[0].unit,
        "mean": chart and chart.centre,
        "sigma": chart and chart.sigma,
        "limits": chart and list(chart.limits),
        "preliminary": chart and chart.preliminary,
        "correlation": chart and chart.correlation,
        "correlated": chart and chart.correlated,
        "points": [
            {
                "time": plain(row.time), "run": row.run, "version": row.version, "value": value,
                "stderr": row.stderr, "low": row.low, "high": row.high, "violated": list(rules),
            }
            for row, value, rules in points
        ],
    }  # fmt: skip


def _draw(field: str, by: str, found: "list[Trend]", path: Path) -> None:
    from motord.report.plots.control_charts import ChartPanel, control_charts
    from motord.report.style import PAPER, drawing

    if len(found) > PANELS_MAX:
        fail(f"{len(found)} charts, at most {PANELS_MAX} on a picture: choose with --where")
    panels = [
        ChartPanel(
            title=f"{by} {one.name or '(none)'}",
            values=one.values,
            errors=one.errors,
            dates=[f"{row.time:%Y-%m-%d}" for row in one.rows],
            limits=(one.chart.limits[0], one.chart.centre, one.chart.limits[1])
            if one.chart
            else None,
            violated=one.violated,
        )
        for one in found
    ]
    unit = found[0].rows[0].unit
    kind = path.suffix.removeprefix(".")
    label = f"{field} ({unit})" if unit else field
    buffer = io.BytesIO()
    with drawing():
        control_charts(label, panels).savefig(
            buffer, format=kind, dpi=150, facecolor=PAPER,
            metadata={"Date": None} if kind == "svg" else None,
        )  # fmt: skip
    write_whole(path, buffer.getvalue())


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
        print_json({"compared": column, "a": a, "b": b, "differences": [*map(_as_dict, found)]})
    else:
        _print_differences(found, every)
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


def _print_differences(found: "list[Difference]", every: bool) -> None:
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


def _as_dict(one: "Difference") -> dict[str, object]:
    from motord.recording.json_encoding import plain

    found: dict[str, object] = plain({**vars(one), "a": vars(one.a), "b": vars(one.b)})
    return found
