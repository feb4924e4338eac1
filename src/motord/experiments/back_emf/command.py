"""`motord analyse back-emf`: back-EMF of a rotor driven from outside without current."""

from collections.abc import Iterator
from dataclasses import replace

from motord.experiments.analysis import Analysis, json_of
from motord.experiments.back_emf.estimate import measure
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.back_emf.voltages import VOLTAGES
from motord.experiments.driven_rotor import driven_points, left_out_lines
from motord.experiments.magnet_temperature import referred
from motord.experiments.recording_checks import points_left_out
from motord.experiments.subject import Recordings
from motord.report.text import TextTable


def estimate(recordings: Recordings) -> MeasuredBackEmf:
    """Return the back-EMF over all driven points. Raises AnalysisError, IdentifyError."""
    subject = recordings.subject
    points = (
        point
        for run in recordings.runs
        for point in referred(driven_points([run], VOLTAGES), run, subject)
    )
    found = measure(points, subject.motor)
    notes = [found.referred.finding(subject.accuracy)] if found.referred else []
    return replace(found, findings=(*found.findings, *notes, *points_left_out(recordings.runs)))


def _text(found: MeasuredBackEmf, _: Recordings) -> Iterator[str | TextTable]:
    from motord.experiments.back_emf.report import HEADER, rows

    yield TextTable(f"back-EMF, {found.motor.name}, mean of the phases", HEADER, rows(found))
    if age_us := found.delay_us:
        yield f"- voltages: {age_us} us older than the recording says (accounted for)"
    for line in left_out_lines(found.left_out):
        yield f"- {line}"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.back-emf/1", "name", "serial", "pole_pairs", "counts"),
    text=_text,
    indent=None,
)
