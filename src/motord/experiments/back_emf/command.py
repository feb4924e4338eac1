"""`motord analyse back-emf`: back-EMF of a rotor driven from outside without current."""

from collections.abc import Iterator
from dataclasses import replace

from motord.experiments.analysis import Analysis, json_of
from motord.experiments.back_emf.estimate import VOLTAGES, measure
from motord.experiments.back_emf.report import report
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.driven_findings import left_out_lines
from motord.experiments.driven_recordings import driven_points
from motord.experiments.points_left_out import points_left_out
from motord.experiments.subject import Recordings
from motord.report.text import TextTable


def estimate(recordings: Recordings) -> MeasuredBackEmf:
    """Return the back-EMF over all driven points. Raises AnalysisError, IdentifyError."""
    found = measure(driven_points(recordings.runs, VOLTAGES), recordings.subject.motor)
    return replace(found, findings=(*found.findings, *points_left_out(recordings.runs)))


def _text(found: MeasuredBackEmf, _: Recordings) -> Iterator[str | TextTable]:
    yield TextTable(
        f"back-EMF, {found.motor.name}, mean of the phases",
        ("order", "amplitude (mV s/rad)", "% of fundamental", "phase (rad)"),
        [
            (
                str(h.order),
                f"{1e3 * h.amplitude_V_s_per_rad:.3f} +- {1.96e3 * h.stderr_V_s_per_rad:.3f}",
                f"{100 * h.amplitude_V_s_per_rad / found.fundamental:.3f}",
                f"{h.phase_rad:.4f} +- {1.96 * h.phase_stderr_rad:.4f}",
            )
            for h in found.harmonics
            if h.in_table
        ],
    )
    if found.delay_s is not None:
        yield (
            f"- voltages: {1e6 * found.delay_s[0]:.0f} +- {1.96e6 * found.delay_s[1]:.0f} us older "
            "than the recording says (accounted for)"
        )
    for line in left_out_lines(found.left_out):
        yield f"- {line}"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.back-emf/1", "name", "serial", "pole_pairs", "counts"),
    report=report,
    text=_text,
    indent=None,
)
