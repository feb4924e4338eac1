"""`motord analyse align`: phase order, encoder direction and encoder zero."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from motord.atomic_write import write_whole
from motord.config import read_toml
from motord.config.text.editing import with_table, with_values
from motord.experiments.alignment.estimate import align
from motord.experiments.alignment.rests import REQUIRED
from motord.experiments.alignment.result import Alignment
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.signal_findings import signal_findings
from motord.experiments.subject import (
    AnalysisError,
    Recordings,
    Subject,
    captured_ticks,
    check_plan,
)
from motord.identification.encoder_ticks import countable_ticks
from motord.identification.signal_condition import require_change
from motord.intervals import NOT_KNOWN, two_digits
from motord.recording.reader import Run

PLAN = "align"


def found_alignment(runs: Sequence[Run], subject: Subject) -> Alignment:
    """Return the alignment over all sweeps of the runs. Raises AnalysisError, IdentifyError."""
    for run in runs:
        check_plan(run, PLAN)
    sweeps, faults, left_out = [], [], CapturesLeftOut()
    for run in runs:
        for number, ticks in enumerate(captured_ticks(run, REQUIRED), start=1):
            label = f"{run.path.name}: sweep {number}"
            with left_out.noted(label, (run.path, number)):
                good, _, of_encoder = countable_ticks(ticks, subject.motor.counts, label)
                require_change({"encoder_count": good["encoder_count"]}, label)
                sweeps.append(good)
                faults.append((label, of_encoder))
    if not (sweeps or left_out.reasons):
        names = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{names}: the plan was ended before a sweep was over: start it anew")
    with left_out.explaining():
        found = align(sweeps, subject.motor)
    findings = (*signal_findings(faults), *left_out.findings())
    return replace(found, accuracy=subject.accuracy, more_findings=findings)


def estimate(
    recordings: Recordings,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="BENCH.toml",
            help="Write what was found into [motor] of this file, and how well the zero is known "
            "into [accuracy] encoder_zero_rad: the limit +-a of a rectangular distribution, "
            "a / sqrt(3) being the combined standard uncertainty.",
        ),
    ] = None,
) -> Alignment:
    """Return the alignment, written into a bench file if one is named."""
    found = found_alignment(recordings.runs, recordings.subject)
    if write:
        text, _ = read_toml(write)
        text = with_values(text, "motor", found.fields, str(write))
        text = with_table(text, "accuracy")
        write_whole(write, with_values(text, "accuracy", found.accuracy_fields, str(write)))
    return replace(found, bench_file=write)


def _text(result: Alignment, _: Recordings) -> Iterator[str]:
    yield "[motor]"
    yield f'phase_order = "{result.phase_order}"'
    yield f"encoder_direction = {result.direction}"
    yield (
        f"encoder_offset_rad = {result.fields['encoder_offset_rad']}  "
        f"# +- {result.offset_half_width_rad:.2g} (95 %), "
        f"{result.offset_half_width_points:.2g} encoder points"
    )
    yield "[accuracy]"
    yield (
        f"encoder_zero_rad = {result.accuracy_fields['encoder_zero_rad']}  # limit +-a, "
        "a / sqrt(3) is the zero's combined standard uncertainty"
    )
    yield (
        f"- the rotor turns 1/{result.pole_pairs:.3f} of a turn for each electrical turn "
        f"({NOT_KNOWN})"
    )
    yield (
        f"- friction leaves {two_digits(1e3 * result.friction_Nm)} mNm at rest ({NOT_KNOWN}): "
        f"a single stop is {result.friction_points:.2f} encoder points off"
    )
    yield f"- {result.agreement}"
    if result.bench_file:
        yield f"wrote {result.bench_file}: [motor] and [accuracy] encoder_zero_rad"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.align/1", "name", "serial", "pole_pairs", "counts"),
    text=_text,
    outputs=("write",),
    edited=("write",),
)
