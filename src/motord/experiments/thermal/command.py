"""`motord analyse thermal`: thermal constants from a heat-up and its cooling."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from motord.experiments.analysis import Analysis, json_of
from motord.experiments.subject import Recordings
from motord.experiments.thermal.constants import constants_of
from motord.experiments.thermal.course import CopperResistance, ThermalCourse
from motord.experiments.thermal.departures import less_lags, with_departures
from motord.experiments.thermal.estimate import fit
from motord.experiments.thermal.findings import findings, frozen_spans
from motord.experiments.thermal.recordings import thermal_course
from motord.experiments.thermal.result import ThermalConstants
from motord.report.text import TextTable


def estimate(recordings: Recordings) -> ThermalConstants:
    """Return the constants. Raises AnalysisError, ConfigError, IdentifyError, RecordError."""
    return measure(*thermal_course(recordings))


def measure(course: ThermalCourse, copper: CopperResistance) -> ThermalConstants:
    """Return the constants of a course with their findings. Raises IdentifyError.

    Readings of a channel that was frozen are left out, and the rest is fitted again.
    """
    found = fit(course, copper)
    frozen, readings = {}, dict(found.course.readings)
    for (node, each), fitted_C in zip(readings.items(), found.fitted_C, strict=True):
        if spans := frozen_spans(each, fitted_C):
            value_C = each.value_C.copy()
            for span in spans:
                value_C[span] = np.nan
            frozen[each.channel] = sum(
                float(each.t_s[span.stop - 1] - each.t_s[span.start]) for span in spans
            )
            readings[node] = replace(each, value_C=value_C)
    if frozen:
        found = fit(replace(found.course, readings=readings), copper)
    found, shown = less_lags(found)
    constants = constants_of(with_departures(found, shown))
    questionable = findings(constants, shown, frozen, course.readings.values())
    return replace(constants, findings=questionable)


def _text(found: ThermalConstants, _: Recordings) -> Iterator[str | TextTable]:
    from motord.experiments.thermal.report import HEADER, STEADY_HEADER, rows, steady_rows

    yield TextTable("thermal constants", HEADER, rows(found), left=(0, 3))
    yield TextTable("steady temperatures", STEADY_HEADER, steady_rows(found), left=(0, 4))
    for note in found.notes:
        yield f"- {note}"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.thermal/1", "name", "serial", "rated_torque_Nm"),
    text=_text,
    details="Channels and the winding's resistance are those of [plans.thermal]: of the bench file "
    "of -c, or as recorded. Without a resistance there are time constants only.",
)
