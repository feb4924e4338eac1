"""`motord analyse soak`: which figures drift over the repetitions of a plan."""

from collections.abc import Iterator

from motord.experiments.analysis import Analysis, json_of
from motord.experiments.soak.estimate import soak_trends
from motord.experiments.soak.result import SoakResult
from motord.experiments.subject import Recordings
from motord.report.text import TextTable


def _text(found: SoakResult, _: Recordings) -> Iterator[str | TextTable]:
    from motord.experiments.soak.report import HEADER, rows

    yield TextTable("slopes with 95 % intervals", HEADER, rows(found), left=(0,))
    yield found.statement


ANALYSIS = Analysis(
    soak_trends,
    json=json_of("motord.soak/1", "name", "serial", "rated_torque_Nm"),
    text=_text,
    details="Name all files of the soak. Intervals hold for repetitions that resemble those next "
    "to them, and all figures are judged together.",
)
