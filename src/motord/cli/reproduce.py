"""`motord reproduce` and `demo`: the report's experiments on the simulated rig, on one page."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.analysis_command import print_text
from motord.cli.common_options import ResultAsJson
from motord.cli.console import (
    explain_first_run,
    fail,
    print_json,
    print_line,
    print_table,
    progress_bar,
)
from motord.cli.viewers import open_page

if TYPE_CHECKING:
    import numpy as np

    from motord.report.text import TextTable
    from motord.reproduce.bench import StageProgress
    from motord.reproduce.demo import Demo
    from motord.reproduce.run import Results


def reproduce(
    out: Annotated[Path, typer.Option(help="New or empty folder for page and results.")] = Path(
        "reproduce-out"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rigs' noise and drift.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Small meshes, to see the page.")] = False,
    keep_recordings: Annotated[
        bool, typer.Option("--keep-recordings", help="Leave the runs, 1 GB, next to the page.")
    ] = False,
    as_json: ResultAsJson = False,
) -> None:
    """Run every experiment of Poels 2008 in virtual time; write one page next to its numbers."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        fail(f"{out}: is not empty; name another folder with --out, nothing is overwritten")
    explain_first_run(silent=as_json)  # before the imports, which make the folder of the kernels
    from motord.reproduce.page import write_page
    from motord.reproduce.poels2008 import as_json as rows
    from motord.reproduce.run import STAGES
    from motord.reproduce.run import reproduce as run

    with stage_progress(STAGES, out, silent=as_json) as progress:
        found = run(out, seed, quick, keep_recordings, progress)
        page = write_page(out, found, keep_recordings)
    if as_json:
        print_json({"page": str(page), "wall_s": round(found.wall_s, 2), **rows(found)})
    else:
        _print(found, page)


@contextmanager
def stage_progress(stages: Sequence[str], out: Path, silent: bool) -> "Iterator[StageProgress]":
    """Show a bar for each stage; what is yielded moves it. A file of `out` that fails ends it."""
    width = max(map(len, stages)) + 1
    columns = f"{{task.description:<{width}}}", "bar", "elapsed"
    try:
        with progress_bar(*columns, silent=silent) as bars:
            tasks = {stage: bars.add_task(stage, total=1.0, start=False) for stage in stages}

            def progress(stage: str, fraction: float) -> None:
                bars.start_task(tasks[stage])
                bars.update(tasks[stage], completed=fraction)

            yield progress
    except OSError as error:
        fail(f"{error.filename or out}: {error.strerror}; choose another folder with --out")


def _print(found: "Results", page: Path) -> None:
    from rich.table import Table

    from motord.reproduce.poels2008 import chapters

    for name, rows in chapters(found).items():
        table = Table(title=name, title_justify="left", show_lines=True)
        for heading in ("section", "quantity", "report", "here"):
            table.add_column(heading)
        for row in rows:
            table.add_row(row.where, row.what, row.report, row.here)
        print_table(table)
    print_line(f"{found.bench_s:.0f} s on the bench took {found.wall_s:.0f} s; page: {page}")


def demo(
    out: Annotated[Path, typer.Option(help="Folder for runs, calibration and report.")] = Path(
        "demo-out"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rig's noise and drift.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Four operating points, 8 turns.")] = False,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Do not open the report.")
    ] = False,
    json: ResultAsJson = False,
) -> None:
    """Calibrate the simulated rig in virtual time; show the torque ripple before and after.

    On a computer with a display the report is opened in the browser at the end.
    """
    explain_first_run(silent=json)  # before the imports, which make the folder of the kernels
    from motord.reproduce.demo import FILES, STAGES, run_demo, write_report

    taken = [name for name in FILES.values() if (out / name).exists()]
    if taken and FILES["before"] not in taken:  # which a demo writes first
        fail(f"{out / taken[0]}: is of no demo and would be lost; name another folder with --out")
    with stage_progress(STAGES, out, silent=json) as progress:
        found = run_demo(out, seed, quick, progress)
        write_report(found)
    if json:
        print_json(found.summary)
        return
    _print_demo(found)
    if not no_browser:
        open_page(found.files["report"].absolute().as_uri())


def _print_demo(found: "Demo") -> None:
    from motord.report.text import TextTable

    summary = found.summary
    speeds_Hz = sorted({point["speed_Hz"] for point in summary["points"]})
    rows = []
    for torque_Nm in sorted({point["torque_Nm"] for point in summary["points"]}):
        cells = {p["speed_Hz"]: p for p in summary["points"] if p["torque_Nm"] == torque_Nm}
        row = [f"{cells[s]['before']:.1f}→{cells[s]['after']:.2f}" for s in speeds_Hz]
        rows.append([f"{torque_Nm:g} Nm", *row])
    title = "RMS error of the true torque, % of rated: before→after"
    before, after = summary["before"], summary["after"]
    print_text(
        [
            TextTable(title, ["", *(f"{speed_Hz:g} Hz" for speed_Hz in speeds_Hz)], rows),
            f"mean {before['mean']:.2f} % before, {after['mean']:.2f} % after "
            f"(worst point {after['max']:.2f} %)",
            _gain_table(found),
            f"{summary['bench_s']:.0f} s on the bench took {summary['wall_s']:.0f} s; "
            f"report: {found.files['report']}, calibration: {found.files['calibration']}",
        ]
    )


def _gain_table(found: "Demo") -> "TextTable":
    from motord.report.text import TextTable
    from motord.reproduce.bench import true_estimate

    truth = true_estimate(found.truth, found.config.motor.counts)
    columns = (truth, found.calibrated.joint, found.calibrated.residual)
    alpha = [(one.alpha, one.alpha_half_width) for one in columns]
    beta_A = [(one.beta_A, one.beta_half_width_A) for one in columns]
    rows = [
        [f"{name} {'abc'[phase]}", *(_figure(*column, phase) for column in estimates)]
        for name, estimates in (("alpha", alpha), ("beta (A)", beta_A))
        for phase in range(3)
    ]
    header = ("", "truth", "joint estimator", "residual estimator (2008)")
    return TextTable("identified parameters, 95 % (Type A), compared with the truth", header, rows)


def _figure(values: "np.ndarray", half_widths: "np.ndarray | None", phase: int) -> str:
    """Return a phase's value, with half of its interval unless it is true."""
    from motord.intervals import plus_minus

    value = values[phase]
    return f"{value:.4f}" if half_widths is None else plus_minus(value, half_widths[phase])
