"""`motord latency`: punctuality of the loop on this machine, compared with cyclictest."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.analysis_command import print_text
from motord.cli.bench.wording import number
from motord.cli.common_options import AsJson, bench_file, bench_files, check_output_files
from motord.cli.console import fail, print_json, progress_bar

if TYPE_CHECKING:
    from motord.config import LoopConfig
    from motord.loop.latency.measurement import Measured, MeasurementPlan
    from motord.loop.latency.report import Condition, Figures, LatencyReport
    from motord.report.text import TextTable

DEFAULT_S, DEFAULT_COMPARE_S = 10.0, 60.0


def latency(
    config: Annotated[Path | None, bench_file("Take [loop] from this bench.")] = None,
    rate_Hz: Annotated[
        int | None,
        typer.Option("--rate-Hz", min=100, max=20_000, help="Loop rate, if not that of the bench."),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="Longest time to measure, by default 10, or 60 to compare; less once enough is "
            "known.",
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Run cyclictest in alternating slices.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the histograms into this file.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure wake-up and work of the loop on this machine, with the simulated rig.

    Time that the host of a virtual machine steals is counted apart: figures are over slices of a
    quarter of a second in which the processor's steal counter did not move, and over the others.
    """
    from motord.loop.latency.measurement import MeasurementPlan
    from motord.loop.latency.report import report

    check_output_files({"--plot": plot}, bench_files(config))
    limit_s = seconds if seconds is not None else DEFAULT_COMPARE_S if compare else DEFAULT_S
    measured = _measure(MeasurementPlan(_loop(config, rate_Hz), limit_s, compare), silent=as_json)
    found = report(measured)
    if as_json:
        print_json(found.model_dump())
    else:
        _print(found)
    if plot is not None:
        _draw(measured, plot)
    if compare and measured.clean == 0:
        fail(
            f"in {measured.took_s:.0f} s not one slice of each was clean: the host of this machine "
            "steals time all the while; try later or a larger --seconds"
        )


def _loop(config: Path | None, rate_Hz: int | None) -> "LoopConfig":
    from motord.config import load

    loop = load(config).loop
    return loop if rate_Hz is None else loop.model_copy(update={"rate_Hz": rate_Hz})


def _measure(plan: "MeasurementPlan", silent: bool) -> "Measured":
    from motord.loop.latency.measurement import measure

    with progress_bar(
        "{task.description}", "bar", silent=silent, stderr=True, transient=True
    ) as bars:
        task = bars.add_task("starting the loop", total=1.0)

        def progress(measured: "Measured") -> None:
            done = max(measured.took_s / max(plan.seconds, 1e-3), measured.clean / plan.enough)
            stolen = sum(len(kind.stolen) for kind in measured.kinds)
            text = f"{measured.clean} clean slices of each, {stolen} stolen from"
            bars.update(task, completed=min(done, 1.0), description=text)

        return measure(plan, progress)


def _print(found: "LatencyReport") -> None:
    policy = f"SCHED_FIFO {found.priority}" if found.priority else "normal priority"
    parts: list[str | TextTable] = [
        f"{found.rate_Hz:g} Hz on CPU {found.cpu}, {policy}, "
        f"{'spinning' if found.spin else 'without spinning'}, slices of {found.slice_s:g} s: "
        f"{found.slices['clean']} clean, {found.slices['stolen']} stolen from"
    ]
    parts += [f"not granted: {line}" for line in found.realtime if "wanted" in line]
    parts.append(_table("clean slices", found))
    if found.slices["stolen"]:
        parts.append(_table("slices from which the host stole time", found.stolen))
    print_text(parts)


def _table(title: str, figures: "Condition | LatencyReport") -> "TextTable":
    from motord.report.text import TextTable

    rows = [["loop, wake-up", *_cells(figures.loop)]]
    if figures.cyclictest is not None:
        rows.append(["cyclictest, wake-up", *_cells(figures.cyclictest)])
    ratio = getattr(figures, "ratio", None)
    if ratio is not None:
        rows.append(["ratio", number(ratio.p50), number(ratio.p99)])
    rows.append(["loop, work", *_cells(figures.work)[:4], "", str(figures.work.samples)])
    header = ("us", "p50", "p99", "p99.9", "max", "missed", "ticks")
    return TextTable(title, header, rows, left=(0,))


def _cells(figures: "Figures") -> list[str]:
    times = (figures.p50_us, figures.p99_us, figures.p999_us, figures.max_us)
    return [*(number(time_us) for time_us in times), str(figures.missed), str(figures.samples)]


def _draw(measured: "Measured", path: Path) -> None:
    from motord.loop.latency.picture import picture
    from motord.report.style import PAPER

    try:
        picture(measured).savefig(path, dpi=150, facecolor=PAPER)
    except (OSError, ValueError) as error:
        fail(f"{path}: cannot write the picture: {error}")
