"""`motord analyse learn`: a pass of learning, from its recording to a better calibration."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from motord.calibration import TorqueSpeed, load
from motord.experiments.analysis import Analysis
from motord.experiments.ilc.analysis import LearnPass, learn_from_runs
from motord.experiments.ilc.analysis import finish as finished
from motord.experiments.ilc.estimate import Learning
from motord.experiments.ilc.order_list import in_lines
from motord.experiments.subject import Recordings
from motord.identification.point_ripple import rms_errors
from motord.intervals import significant
from motord.report.text import TextTable, mean_and_worst, with_interval

Gain = Annotated[
    float, typer.Option(min=0.05, max=1.0, help="Share of the error to take out in a pass.")
]
HighestOrder = Annotated[
    int, typer.Option(min=1, help="Highest order to learn, as far as the loop's rate allows.")
]


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path, typer.Option(metavar="FILE", help="The calibration that was in force.")
    ],
    gain: Gain = 0.7,
    highest_order: HighestOrder = 256,
    finish: Annotated[
        bool, typer.Option("--finish", help="Settle at the best that was measured.")
    ] = False,
) -> LearnPass:
    """Return the pass. Raises AnalysisError, CalibrationError, IdentifyError."""
    now = datetime.now(UTC)
    learning = Learning(gain=gain, highest_order=highest_order)
    applied = load(calibration)
    done = learn_from_runs(recordings.runs, recordings.subject, applied, now, learning)
    return finished(done, now) if finish else done


def text(done: LearnPass) -> Iterator[str | TextTable]:
    """Yield what the passes so far left at each point, and whether to go on."""
    half_width_percent = done.half_width_percent
    yield TextTable(
        "RMS error, % of rated, pass by pass; this pass 95 % by noise",
        ("torque", "speed", "passes", "correction (mNm)", "next"),
        [
            (
                f"{torque_Nm:g} Nm",
                f"{speed_Hz:g} /s",
                _history(point.history_percent, half_width_percent, (torque_Nm, speed_Hz)),
                significant(1e3 * point.amplitude_Nm, 3),
                "settled" if point.gain == 0 else f"gain {point.gain:.2g}",
            )
            for (torque_Nm, speed_Hz), point in done.learned.by_place.items()
        ],
    )
    yield summary(done)
    yield f"learned orders: {', '.join(map(str, done.learned.orders))}"
    yield from (f"- {line}" for line in done.reach)
    yield from (f"- {line}" for line in in_lines(done.unreached))


def _history(
    errors: Sequence[float],
    half_width_percent: Mapping[TorqueSpeed, float | None],
    place: TorqueSpeed,
) -> str:
    """Return the RMS errors of a point pass by pass, of this pass with its interval."""
    texts = [f"{value:.2f}" for value in errors]
    if place in half_width_percent:
        texts[-1] = with_interval(errors[-1], half_width_percent[place])
    return " > ".join(texts)


def summary(done: LearnPass) -> str:
    """Return the newest pass in a line."""
    errors = rms_errors(done.ripples).after
    assert errors is not None  # all points are compensated
    still = sum(point.gain > 0 for point in done.learned.points)
    next_step = (
        f"{still} of {len(done.learned.points)} points go on" if still else "all have settled"
    )
    return f"RMS error (95 % by noise): {mean_and_worst(errors)}; {next_step}"


ANALYSIS = Analysis(
    estimate,
    json=lambda done, _: done.to_json(),
    text=lambda done, _: text(done),
    save=lambda done, path: done.calibration.save(path),
)
