"""`motord demo`: calibration of the simulated rig in virtual time: progress, table and report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.analysis_command import print_text
from motord.cli.common_options import ResultAsJson
from motord.cli.console import print_json
from motord.cli.reproduce import stage_progress
from motord.cli.viewers import open_page

if TYPE_CHECKING:
    import numpy as np

    from motord.report.text import TextTable
    from motord.reproduce.demo import Demo


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
    from motord.reproduce.demo import STAGES, run_demo, write_report

    with stage_progress(STAGES, out, silent=json) as progress:
        found = run_demo(out, seed, quick, progress)
        write_report(found)
    if json:
        print_json(found.summary)
        return
    _print(found)
    if not no_browser:
        open_page(found.files["report"].absolute().as_uri())


def _print(found: "Demo") -> None:
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
    return TextTable("identified parameters, 95 %, compared with the truth", header, rows)


def _figure(values: "np.ndarray", half_widths: "np.ndarray | None", phase: int) -> str:
    """Return a phase's value, with half of its interval unless it is true."""
    from motord.intervals import plus_minus

    value = values[phase]
    return f"{value:.4f}" if half_widths is None else plus_minus(value, half_widths[phase])
