"""`motord analyse align`: phase order, encoder direction and encoder zero."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from motord.atomic_write import write_whole
from motord.config import read_toml
from motord.config.editing import with_values
from motord.experiments.alignment.analysis import align_json, align_report, found_alignment
from motord.experiments.alignment.estimate import Alignment
from motord.experiments.alignment.report import page
from motord.experiments.analysis import Analysis
from motord.experiments.subject import Recordings


@dataclass(frozen=True)
class _Result:
    found: Alignment
    written: Path | None


def estimate(
    recordings: Recordings,
    write: Annotated[
        Path | None,
        typer.Option(metavar="BENCH.toml", help="Write what was found into [motor] of this file."),
    ] = None,
) -> _Result:
    """Return the alignment, written into a bench file if one is named."""
    found = found_alignment(recordings.runs, recordings.subject)
    if write:
        fields = align_json(recordings.subject, recordings.names, found)["fields"]
        text, _ = read_toml(write)
        write_whole(write, with_values(text, "motor", fields, str(write)))
    return _Result(found, write)


def _json(result: _Result, recordings: Recordings) -> dict[str, Any]:
    return align_json(recordings.subject, recordings.names, result.found)


def _text(done: _Result, recordings: Recordings) -> Iterator[str]:
    result = _json(done, recordings)
    error = 1.96 * result["encoder_offset_stderr_rad"]
    points = 1.96 * result["encoder_offset_stderr_points"]
    fields = result["fields"]
    yield "[motor]"
    yield f'phase_order = "{fields["phase_order"]}"'
    yield f"encoder_direction = {fields['encoder_direction']}"
    yield (
        f"encoder_offset_rad = {fields['encoder_offset_rad']}  "
        f"# +- {error:.2g} (95 %), {points:.2f} encoder points"
    )
    yield f"- the rotor turns 1/{result['pole_pairs']:.3f} of a turn for each electrical turn"
    yield (
        f"- friction leaves {1e3 * result['friction_Nm']:.0f} mNm at rest: a single stop is "
        f"{result['friction_points']:.2f} encoder points off"
    )
    for note in result["notes"]:
        yield f"- {note}"
    if done.written:
        yield f"wrote {done.written}"


ANALYSIS = Analysis(
    estimate,
    json=_json,
    report=lambda result, recordings: page(
        align_report(recordings.subject, recordings.names, result.found)
    ),
    text=_text,
)
