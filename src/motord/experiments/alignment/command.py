"""`motord analyse align`: phase order, encoder direction and encoder zero."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from motord.atomic_write import write_whole
from motord.config import read_toml
from motord.config.editing import with_values
from motord.experiments.alignment.report import report
from motord.experiments.alignment.result import AlignmentResult, found_alignment
from motord.experiments.analysis import Analysis, encode, header
from motord.experiments.subject import Recordings


@dataclass(frozen=True)
class _Written:
    found: AlignmentResult
    bench_file: Path | None


def estimate(
    recordings: Recordings,
    write: Annotated[
        Path | None,
        typer.Option(metavar="BENCH.toml", help="Write what was found into [motor] of this file."),
    ] = None,
) -> _Written:
    """Return the alignment, written into a bench file if one is named."""
    found = found_alignment(recordings.runs, recordings.subject)
    if write:
        text, _ = read_toml(write)
        write_whole(write, with_values(text, "motor", found.fields, str(write)))
    return _Written(found, write)


def _text(written: _Written, _: Recordings) -> Iterator[str]:
    result, found = written.found, written.found.alignment
    yield "[motor]"
    yield f'phase_order = "{found.phase_order}"'
    yield f"encoder_direction = {found.direction}"
    yield (
        f"encoder_offset_rad = {result.fields['encoder_offset_rad']}  "
        f"# +- {1.96 * found.offset_stderr_rad:.2g} (95 %), "
        f"{1.96 * result.offset_stderr_points:.2f} encoder points"
    )
    yield f"- the rotor turns 1/{found.pole_pairs:.3f} of a turn for each electrical turn"
    yield (
        f"- friction leaves {1e3 * found.friction_Nm:.0f} mNm at rest: a single stop is "
        f"{result.friction_points:.2f} encoder points off"
    )
    for note in result.notes:
        yield f"- {note}"
    if written.bench_file:
        yield f"wrote {written.bench_file}"


ANALYSIS = Analysis(
    estimate,
    json=lambda written, recordings: {
        **header(recordings, "motord.align/1", "name", "serial", "pole_pairs", "counts"),
        **encode(written.found),
    },
    report=lambda written, recordings: report(written.found, recordings),
    text=_text,
)
