"""Figures of each repetition, from recordings of a soak, and their trends."""

from collections.abc import Sequence
from dataclasses import replace

from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.soak import NAME
from motord.experiments.soak.figure_trends import (
    of_points,
    of_repetitions,
    repetitions_of,
    with_steps,
)
from motord.experiments.soak.point_figures import PointFigures, points_of, with_stated
from motord.experiments.soak.point_ripples import changed_behind_noise, ripple_findings
from motord.experiments.soak.result import SoakResult
from motord.experiments.subject import AnalysisError, Recordings, check_plan
from motord.identification import IdentifyError
from motord.intervals import LEVEL, beyond_chance
from motord.recording.reader import Run

OF_TORQUE = (
    "rms_error_percent",
    "noise_rms_percent",
    "torque_mean_Nm",
    "torque_zero_Nm",
    "torque_gain_percent",
)
"""Figures that have the scale of the torque, those of set-points with " of " after them."""


def soak_trends(recordings: Recordings) -> SoakResult:
    """Return the trends. Raises AnalysisError, IdentifyError, ConfigError, RecordError."""
    runs, subject = recordings.runs, recordings.subject
    plan = _plan_of(runs)
    taken: dict[tuple[int, int], PointFigures] = {}
    left_out = CapturesLeftOut()
    for run in sorted(runs, key=_began_ns):
        for one in points_of(run, subject, left_out):
            taken[one.repetition, one.place] = one
    if not taken:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{files}: no good operating point in there")
    if all(one.left_out for one in taken.values()):
        raise IdentifyError(f"no capture can be used{left_out.as_text}")
    points = with_stated(list(taken.values()))
    units = {name: one.unit for run in runs for name, one in run.channels().items()}
    repetitions = repetitions_of(points)
    scale = subject.accuracy.torque_scale
    plain = [*of_repetitions(repetitions, points, units), *of_points(repetitions, points)]
    trends = [
        one.with_scale(scale) if one.name.partition(" of ")[0] in OF_TORQUE else one
        for one in with_steps(plain)
    ]
    drifts = beyond_chance([one.slope.p_value for one in trends], 1 - LEVEL)
    judged = tuple(replace(one, drifts=its) for one, its in zip(trends, drifts, strict=True))
    ripples = [(one.label, one.repetition, one.ripple) for one in points if one.ripple is not None]
    questionable = (
        *ripple_findings(ripples),
        *changed_behind_noise(ripples),
        *left_out.findings(runs),
    )
    return SoakResult(plan, tuple(repetitions.values()), judged, questionable)


def _plan_of(runs: Sequence[Run]) -> str:
    """Return the plan that was repeated. Raises AnalysisError."""
    found = []
    for run in runs:
        check_plan(run, NAME)
        plan = run.plan_metadata
        settings = plan.get("settings", {})
        identity = (plan.get("run_id", ""), settings.get("plan"), settings.get("inner"))
        found.append((run, identity))
    for run, identity in found[1:]:
        if identity != found[0][1]:
            raise AnalysisError(
                f"{run.path}: is of another soak than {found[0][0].path}; analyse each by itself, "
                "with all files of it, also of its resumption"
            )
    return str(found[0][1][1] or "")


def _began_ns(run: Run) -> int:
    return min((int(point["t_start_ns"]) for point in run.operating_points()), default=0)
