"""Test of a calibration by fresh turns: what has changed beyond chance, and what would be seen.

A change is tested against the uncertainty of both, check and calibration, by Student's t with the
degrees of freedom of Welch and Satterthwaite; with m changes each at FALSE_ALARMS / m (Bonferroni).
Of the phases' gains, and of their offsets, the one that changed most counts; a second one only if
it differs from the third.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from math import hypot

import numpy as np

from motord.calibration import Calibration
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.check_calibration.quantities import Quantity, quantities
from motord.experiments.check_calibration.result import FALSE_ALARMS, CalibrationCheck, Change
from motord.experiments.check_calibration.shift import ParameterShift, parameter_shift
from motord.experiments.subject import Recordings, Subject, check_applied
from motord.identification.operating_points import PointData
from motord.intervals import t_quantile
from motord.recording.captures import captures

COMPARED = ("gain", "offset")
"""Families of three phases, each against the two others."""


def check_runs(
    recordings: Recordings, calibration: Calibration, needed_percent: float
) -> CalibrationCheck:
    """Return the test of a calibration by recordings that were taken with it.

    Raises AnalysisError, CalibrationError, IdentifyError.
    """
    for run in recordings.runs:
        check_applied(run, calibration.id)
    subject = recordings.subject
    points = (point for run in recordings.runs for point in captures(run))
    left_out = CapturesLeftOut()
    found = check(points, subject, calibration, needed_percent, left_out)
    more = (*found.more_findings, *left_out.findings(recordings.runs))
    return replace(found, more_findings=more)


def check(
    points: Iterable[PointData],
    subject: Subject,
    calibration: Calibration,
    needed_percent: float,
    left_out: CapturesLeftOut,
) -> CalibrationCheck:
    """Return the test of a calibration by operating points. Raises CalibrationError, IdentifyError.

    needed_percent: RMS ripple at rated torque, in percent of it, that no change may add unseen;
    left_out: takes the points that cannot be used.
    """
    calibration.check_motor(subject.motor, recorded=True)
    found = parameter_shift(points, calibration, subject.motor, subject.sensor, left_out)
    stated = list(quantities(calibration, found, subject.motor))
    seen = [one for one in stated if is_seen(one, found)]
    unseen = [one for one in stated if not is_seen(one, found)]
    change = partial(_change, found=found, tests=len(seen))
    changes = [change(one) for one in seen]
    not_sampled = [one for one in calibration.tau_cog_harmonics if one.order not in found.orders]
    return CalibrationCheck(
        calibration=calibration.id,
        changes=tuple(without_consequences(seen, changes, change)),
        misfit=found.misfit,
        turns=found.turns,
        needed_percent=needed_percent,
        unseen=(
            *(one.meaning for one in unseen),
            *(f"order {one.order} of the cogging torque" for one in not_sampled),
        ),
        ripple_unseen=any(one.ripple > 0 for one in unseen)
        or any(one.amplitude_Nm > 0 for one in not_sampled),
        more_findings=found.findings,
    )


def is_seen(quantity: Quantity, found: ParameterShift) -> bool:
    """Return whether the turns show a change of the quantity well enough to be tested."""
    measured = found.along(quantity.direction)
    return measured is not None and measured[1] <= quantity.seen


def _change(quantity: Quantity, found: ParameterShift, tests: int) -> Change:
    measured = found.along(quantity.direction)
    assert measured is not None
    value, of_check, freedom = measured
    stderr = max(hypot(of_check, quantity.stderr), 1e-300)
    doubt = of_check**4 / freedom + quantity.stderr**4 / (quantity.degrees_of_freedom or np.inf)
    freedom = stderr**4 / max(doubt, 1e-12 * stderr**4)
    limit = t_quantile(1 - FALSE_ALARMS / 2 / tests, freedom) * stderr
    return quantity.change(value, stderr, freedom, limit)


def without_consequences(
    stated: Sequence[Quantity], changes: Sequence[Change], change_of: Callable[[Quantity], Change]
) -> list[Change]:
    """Return the changes; of three phases those that only mirror another's count as none.

    change_of: tests a quantity, as it gave the changes of those `stated`.
    """
    kept = list(changes)
    for family in COMPARED:
        rows = [n for n, one in enumerate(stated) if one.family == family]
        if len(rows) < 3 or sum(changes[n].drifted for n in rows) < 2:
            continue
        _, second, third = sorted(rows, key=lambda n: -abs(changes[n].value) / changes[n].limit)
        pair = replace(
            stated[second],
            direction=(stated[second].direction - stated[third].direction) / 1.5,
            stderr=(stated[second].stderr + stated[third].stderr) / 1.5,
        )
        differ = change_of(pair).drifted
        kept[second] = replace(kept[second], drifted=kept[second].drifted and differ)
        kept[third] = replace(kept[third], drifted=False)
    return kept
