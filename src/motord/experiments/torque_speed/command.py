"""`motord analyse torque-speed`: losses and efficiency over torque and speed."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from motord.atomic_write import write_whole
from motord.experiments.analysis import Analysis, encode, json_of
from motord.experiments.subject import Recordings
from motord.experiments.torque_speed.recordings import efficiency_map
from motord.experiments.torque_speed.result import EfficiencyMap
from motord.recording.plan_columns import as_text
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    csv_file: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="Write the operating points as a table, too."),
    ] = None,
) -> EfficiencyMap:
    """Return the map. Raises AnalysisError, ConfigError, RecordError, OSError."""
    found = efficiency_map(recordings)
    if csv_file is not None:
        write_whole(csv_file, as_csv(found))
    return found


def as_csv(found: EfficiencyMap) -> str:
    """Return the operating points as CSV.

    Columns are those of the JSON, without the budgets, then the plan's and its settings.
    """
    from motord.recording.export.csv_text import csv_lines

    rows = [
        {**encode(one), **{name: as_text(value) for name, value in one.plan.items()}}
        for one in found.points
    ]
    names = dict.fromkeys(name for row in rows for name in row if name != "budget")
    return csv_lines([[*names], *([row.get(name) for name in names] for row in rows)])


def _text(found: EfficiencyMap, _: Recordings) -> Iterator[str | TextTable]:
    from motord.experiments.torque_speed.report import HEADER, row

    yield TextTable(
        "means over whole turns, 95 % intervals",
        HEADER,
        [row(one) for one in found.points],
        left=(0,),
    )
    for one in found.points:
        if one.efficiency_reason:
            yield f"- {one.label}: no efficiency: {one.efficiency_reason}"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.torque-speed/1", "name", "serial", "rated_torque_Nm"),
    text=_text,
    details="The DC power is a channel of the recording, named in [plans.torque-speed]; what is "
    "known of its accuracy and of the torque sensor's is in [accuracy].",
    outputs=("csv_file",),
)
