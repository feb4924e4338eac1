"""From recordings to results and to the content of a report.

`identify` knows no files and `report` no estimators; here the operating points of recordings are
handed to the one, and its results put into the words of the other.
"""

from motord.analysis.content import (
    calibration_report,
    estimate_of_calibration,
    estimate_of_result,
    estimate_of_truth,
    shares_of,
)
from motord.analysis.recordings import calibrator, explained, ripples
from motord.analysis.subject import AnalysisError, Subject
from motord.analysis.truth import recorded_truth

__all__ = [
    "AnalysisError",
    "Subject",
    "calibration_report",
    "calibrator",
    "estimate_of_calibration",
    "estimate_of_result",
    "estimate_of_truth",
    "explained",
    "recorded_truth",
    "ripples",
    "shares_of",
]
