"""`motord analyse learn`: a pass of learning, from its recording to a better calibration."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.analyse.inputs import (
    AsJson,
    BenchFile,
    Output,
    Report,
    Runs,
    explained,
    open_runs,
    say_files,
)
from motord.cli.console import plain_console, print_json

if TYPE_CHECKING:
    from motord.experiments.ilc.analysis import LearnPass

Gain = Annotated[
    float, typer.Option(min=0.05, max=1.0, help="Share of the error to take out in a pass.")
]
HighestOrder = Annotated[
    int, typer.Option(min=1, help="Highest order to learn, as far as the loop's rate allows.")
]


def learn(
    runs: Runs,
    calibration: Annotated[
        Path, typer.Option(metavar="FILE", help="The calibration that was in force.")
    ],
    output: Output = None,
    report: Report = None,
    gain: Gain = 0.7,
    highest_order: HighestOrder = 256,
    finish: Annotated[
        bool, typer.Option("--finish", help="Settle at the best that was measured.")
    ] = False,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Learn from a pass what is left in the torque; -o writes the calibration to apply next."""
    from datetime import UTC, datetime

    from motord.calibration import load
    from motord.experiments.ilc import analysis
    from motord.experiments.ilc.estimate import Learning
    from motord.experiments.ilc.report import write

    with explained():
        applied = load(calibration)
        opened, subject = open_runs(runs, config)
        now = datetime.now(UTC)
        learning = Learning(gain=gain, highest_order=highest_order)
        done = analysis.learn_from_runs(opened, subject, applied, now, learning)
        if finish:
            done = analysis.finish(done, now)
        if output:
            done.calibration.save(output)
        if report:
            write(report, analysis.learn_report(done))
    if as_json:
        print_json(done.to_json())
    else:
        print_pass(done)
        say_files(output, report)


def print_pass(done: "LearnPass") -> None:
    """Print what the passes so far left at each point, and whether to go on."""
    from rich.table import Table

    learned = done.calibration.learned
    assert learned is not None
    table = Table(title="RMS error of the measured torque, % of rated, pass by pass")
    for heading in ("torque", "speed", "passes", "correction (mNm)", "next"):
        table.add_column(heading, justify="right")
    for (torque_Nm, speed_Hz), point in zip(learned.places, learned.points, strict=True):
        table.add_row(
            f"{torque_Nm:g} Nm",
            f"{speed_Hz:g} /s",
            " > ".join(f"{value:.2f}" for value in point.history_percent),
            f"{1e3 * point.amplitude_Nm:.1f}",
            "settled" if point.gain == 0 else f"gain {point.gain:.2g}",
        )
    console = plain_console()
    console.print(table)
    console.print(summary(done), highlight=False)


def summary(done: "LearnPass") -> str:
    """Return the newest pass in a line."""
    errors = [left.rms_percent for left in done.left]
    still = sum(point.gain > 0 for point in done.points)
    next_words = f"{still} of {len(done.points)} points go on" if still else "all have settled"
    mean = sum(errors) / len(errors)
    return f"RMS error {mean:.2f} % mean, {max(errors):.2f} % worst; {next_words}"
