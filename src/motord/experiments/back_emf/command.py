"""`motord analyse back-emf`: back-EMF of a rotor driven from outside without current."""

from collections.abc import Iterator
from typing import Any

from motord.experiments.analysis import Analysis
from motord.experiments.back_emf.analysis import back_emf_json, back_emf_report, measured_back_emf
from motord.experiments.back_emf.estimate import MeasuredBackEmf
from motord.experiments.back_emf.report import page
from motord.experiments.subject import Recordings
from motord.report.text import Table


def estimate(recordings: Recordings) -> MeasuredBackEmf:
    """Return the back-EMF over all driven points. Raises AnalysisError, IdentifyError."""
    return measured_back_emf(recordings.runs, recordings.subject)


def _json(found: MeasuredBackEmf, recordings: Recordings) -> dict[str, Any]:
    return back_emf_json(recordings.subject, recordings.names, found)


def _text(found: MeasuredBackEmf, recordings: Recordings) -> Iterator[str | Table]:
    result = _json(found, recordings)
    yield Table(
        f"back-EMF, {found.motor.name}, mean of the phases",
        ("order", "amplitude (mV s/rad)", "% of fundamental", "phase (rad)"),
        [
            (
                str(row["order"]),
                f"{1e3 * row['amplitude_V_s_per_rad']:.3f} +- "
                f"{1.96e3 * row['stderr_V_s_per_rad']:.3f}",
                f"{100 * row['amplitude_V_s_per_rad'] / found.fundamental:.3f}",
                f"{row['phase_rad']:.4f} +- {1.96 * row['phase_stderr_rad']:.4f}",
            )
            for row in result["harmonics"]
            if row["in_table"]
        ],
    )
    if found.delay_s is not None:
        yield (
            f"- voltages: {1e6 * found.delay_s[0]:.0f} +- {1.96e6 * found.delay_s[1]:.0f} us older "
            "than the recording says (accounted for)"
        )
    for note in result["notes"]:
        yield f"- {note}"


ANALYSIS = Analysis(
    estimate,
    json=_json,
    report=lambda found, recordings: page(
        back_emf_report(recordings.subject, recordings.names, found)
    ),
    text=_text,
    indent=None,
)
