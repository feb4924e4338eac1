"""The content of a sensitivity report: results in the words of the page."""

import numpy as np

from motord.experiments.sensitivity.plots import Trace
from motord.experiments.sensitivity.plots_volume import Limit, Slices
from motord.experiments.sensitivity.report import BranchRow, Recalibration, SensitivityReport
from motord.experiments.sensitivity.result import LIMIT_PERCENT, Again, Sensitivity
from motord.experiments.sensitivity.slope_fit import Series
from motord.report.plots.gains import Gains

SYMBOL = {
    "alpha_a": "\u03b1a",
    "beta_a_A": "\u03b2a (A)",
    "cogging": "cogging factor",
    "delta_epsilon": "\u03b4\u03b5",
}

TITLE = {
    "alpha_a": "Gain of phase a",
    "beta_a_A": "Offset of phase a",
    "cogging": "Factor of the cogging torque",
    "delta_epsilon": "Common gain",
}

REPORT_INDUCED = np.array([0.8, 1.118, 1.118, 1.0, -0.5, -0.5])
REPORT_FOUND = np.array([0.7717, 1.1035, 1.0884, 0.9994, -0.5078, -0.6205])
"""Poels 2008, Table 4.2."""


def sensitivity_report(
    result: Sensitivity, title: str = "Sensitivity to errors of a calibration"
) -> SensitivityReport:
    """Return the content of a report."""
    theory, subject = result.theory, result.subject
    motor = subject.motor
    return SensitivityReport(
        title=title,
        lead=f"{motor.name} on bench {subject.bench}",
        facts=(
            ("bench", subject.bench),
            ("motor", f"{motor.name}, {motor.rated_torque_Nm:g} Nm rated, {motor.connection}"),
            ("recordings", ", ".join(result.runs) or "none"),
        ),
        torque_Nm=theory.torque_Nm,
        speed_Hz=result.speed_Hz,
        limit_percent=LIMIT_PERCENT,
        ends=tuple((SYMBOL[what], *end) for what, ends in theory.ends.items() for end in ends),
        within=tuple((SYMBOL[what], *pair) for what, pair in theory.within.items()),
        volume=Slices(
            (theory.volume.alpha_a, theory.volume.beta_a_A, theory.volume.cogging),
            theory.volume.rms_percent,
            LIMIT_PERCENT,
        ),
        surface=Limit((theory.surface.alpha_a, theory.surface.beta_a_A, theory.surface.cogging)),
        traces=tuple(_trace(one) for one in result.series),
        branches=tuple(row for one in result.series for row in _branches(one)),
        meetings=tuple(
            (SYMBOL[one.what], *one.meeting)
            for one in result.series
            if one.meeting is not None and one.what != "delta_epsilon"  # its branches are curved
        ),
        floor_percent=result.series[0].floor_percent if result.series else None,
        worst_difference_percent=max(
            (one.worst_difference_percent for one in result.series), default=None
        ),
        again=None if result.again is None else _again(result.again),
    )


def _trace(one: Series) -> Trace:
    lines = []
    for branch, outer in zip(one.branches, (one.value[0], one.value[-1]), strict=True):
        if branch is not None:
            ends = (float(outer), one.ideal)
            a, b = ((x, branch.at_ideal + branch.slope * (x - one.ideal)) for x in ends)
            lines.append((a, b))
    return Trace(
        title=TITLE[one.what],
        axis=SYMBOL[one.what],
        value=one.value,
        measured_percent=one.measured_percent,
        stderr_percent=one.stderr_percent,
        theory_percent=one.theory_percent,
        lines=tuple(lines),
    )


def _branches(one: Series) -> list[BranchRow]:
    return [
        BranchRow(
            f"{SYMBOL[one.what]}, {side}",
            int(branch.used.sum()),
            branch.slope,
            branch.slope_stderr,
            branch.theory_slope,
        )
        for side, branch in zip(("below", "above"), one.branches, strict=True)
        if branch is not None
    ]


def _again(again: Again) -> Recalibration:
    induced = np.concatenate([again.alpha, again.beta_A])
    same = bool(np.allclose(induced, REPORT_INDUCED, atol=1e-3))
    found = again.found
    return Recalibration(
        induced=Gains("induced", again.alpha, again.beta_A),
        found=Gains("found", found.alpha, found.beta_A, found.alpha_stderr, found.beta_stderr_A),
        cost_percent=again.cost_percent,
        report_found=REPORT_FOUND if same else None,
    )
