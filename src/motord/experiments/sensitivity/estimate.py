"""What errors of a calibration cost in ripple: theory, and the `sensitivity` plan's recordings."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from motord.config import MotorConfig
from motord.config.plans import SensitivityConfig
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.captures_left_out import CapturesLeftOut, prepared
from motord.experiments.hold_timing import phase_hold
from motord.experiments.ripple_findings import asynchronous_line
from motord.experiments.sensitivity.applied import NEEDED, Applied, AppliedCompensation
from motord.experiments.sensitivity.curves import (
    ERRORS,
    INTERVALS,
    RippleModel,
    limit_surface,
    limits,
    single,
    volume,
)
from motord.experiments.sensitivity.result import LIMIT_PERCENT, Again, Sensitivity, Theory
from motord.experiments.sensitivity.slope_fit import series
from motord.experiments.shaft_ripple import shaft_ripple
from motord.experiments.signal_findings import current_scale, signal_findings
from motord.experiments.subject import AnalysisError, Subject, recorded_settings
from motord.identification import IdentifyError
from motord.identification.disturbances.lines_of_points import DetectedLines, with_asynchronous
from motord.identification.operating_points import (
    COMMANDS,
    CURRENTS,
    PointData,
    Samples,
    require_turns,
    stacked,
)
from motord.identification.point_ripple import PointRipple
from motord.identification.signal_condition import CurrentProducts
from motord.recording.captures import COLUMNS, captures
from motord.recording.reader import Run
from motord.sequencing import NOTHING_INDUCED, Induced

DEFAULT_TORQUE_Nm = 3.0
"""Set-point of the theory where no recording says which, Poels 2008, Figure 4.3."""

IDEALS = {"alpha_a": 1.0, "beta_a_A": 0.0, "cogging": 1.0, "delta_epsilon": 1.0}
"""Each kind of error: its value without any."""

Kinds = dict[str, float]
"""Kinds of error, of IDEALS, to which what was induced belongs, each with its value."""


def theory(motor: MotorConfig, tau_cog_Nm: np.ndarray, torque_Nm: float) -> Theory:
    """Return the theory for a motor with its cogging torque (counts,). Raises IdentifyError."""
    model = RippleModel.of(motor, tau_cog_Nm)
    ends = {
        what: tuple((end, float(single(model, torque_Nm, what, end))) for end in interval)
        for what, interval in INTERVALS.items()
    }
    return Theory(
        torque_Nm=torque_Nm,
        within={what: limits(model, torque_Nm, what, LIMIT_PERCENT) for what in ERRORS},
        ends=ends,
        volume=volume(model, torque_Nm),
        surface=limit_surface(model, torque_Nm, LIMIT_PERCENT),
    )


def theory_alone(subject: Subject, tau_cog_Nm: np.ndarray, torque_Nm: float) -> Sensitivity:
    """Return the theory without any recording. Raises IdentifyError."""
    return Sensitivity(subject, (), 0.0, theory(subject.motor, tau_cog_Nm, torque_Nm), (), None)


def _single(induced: Induced) -> Kinds:
    """Return to which kinds of error these belong, with the value; none if they are mixed."""
    offsets = any(induced.offset_A)
    wrong = (induced.gain != NOTHING_INDUCED.gain, offsets, induced.cogging != 1.0)
    if sum(wrong) > 1:
        return {}
    if not any(wrong):
        return IDEALS
    if offsets:
        return {"beta_a_A": induced.offset_A[0]}
    if induced.cogging != 1.0:
        return {"cogging": induced.cogging}
    common = max(induced.gain) == min(induced.gain)
    return {"delta_epsilon": 1 / induced.gain[0]} if common else {"alpha_a": induced.gain[0]}


def sensitivity(runs: Sequence[Run], subject: Subject) -> Sensitivity:
    """Return theory and practice from recordings of the `sensitivity` plan.

    Raises AnalysisError where no errors were induced, IdentifyError for what cannot be identified.
    """
    applied, places, current_ratios = _what_was_applied(runs, subject)
    share = tuple(applied.gain.tolist()) if subject.motor.connection == "star" else None
    model = RippleModel.of(subject.motor, applied.tau_cog_Nm, share)
    rows: dict[str, list[tuple[float, ...]]] = {what: [] for what in IDEALS}
    left_out = CapturesLeftOut()
    measured = measured_ripples(runs, subject, left_out)
    for ripple, induced, kinds in measured:
        assert ripple.stderr_percent is not None
        wrong = induced.gain, induced.offset_A, induced.cogging
        expected = float(model.rms_percent(ripple.torque_Nm, *wrong))
        for what, value in kinds.items():
            rows[what].append((value, ripple.rms_percent, ripple.stderr_percent, expected))
    scale = subject.accuracy.torque_scale
    torque_Nm, speed_Hz = places[0] if places else (DEFAULT_TORQUE_Nm, 0.0)
    with left_out.explaining():
        again = _again(runs, subject, applied, model, torque_Nm)
        if not measured and again is None:
            raise IdentifyError("no operating point can be used")
    return Sensitivity(
        subject=subject,
        runs=tuple(run.path.name for run in runs),
        speed_Hz=speed_Hz,
        theory=theory(subject.motor, applied.tau_cog_Nm, torque_Nm),
        series=tuple(
            series(what, IDEALS[what], *np.array(some).T, scale=scale)
            for what, some in rows.items()
            if len(some) > 1
        ),
        again=again,
        signal_findings=(
            *current_scale(current_ratios, "slopes of current errors are as wrong"),
            *asynchronous_line([ripple for ripple, *_ in measured]),
            *signal_findings((ripple.label, ripple.faults) for ripple, *_ in measured),
            *left_out.findings(runs),
        ),
    )


def measured_ripples(
    runs: Sequence[Run], subject: Subject, left_out: CapturesLeftOut
) -> list[tuple[PointRipple, Induced, Kinds]]:
    """Return the ripple of each point with a single error, or none, with what was induced.

    Lines that are not locked to the rotor are detected at all good points: those to calibrate from
    again, at other speeds, show a line that meets an order at the speed of these.
    """
    motor, sensor = subject.motor, subject.sensor
    found, errors = [], []
    for run in runs:
        hold = phase_hold(run)
        for samples, induced, kinds in _prepared([run], subject, left_out):
            detected = DetectedLines.of(samples, motor.counts)
            found.append((shaft_ripple(samples, motor, sensor, hold), detected))
            errors.append((induced, kinds))
    points = (samples for samples, *_ in _prepared(runs, subject, left_out))
    ripples = with_asynchronous(found, points, motor, sensor)
    return [(one, *wrong) for one, wrong in zip(ripples, errors, strict=True) if wrong[-1]]


def _prepared(
    runs: Sequence[Run], subject: Subject, left_out: CapturesLeftOut
) -> Iterator[tuple[Samples, Induced, Kinds]]:
    for point, induced, kinds in _points(runs):
        for samples in prepared([point], subject.motor.counts, left_out, _enough):
            yield samples, induced, kinds


_enough = partial(require_turns, least=2)
"""Noise is known by how turns differ."""


def _points(runs: Sequence[Run]) -> Iterator[tuple[PointData, Induced, Kinds]]:
    """Yield the good points with their ticks, what was induced there, and its kinds.

    Those to calibrate from again are of none, also where gains or offsets alone are induced there.
    """
    columns = tuple(dict.fromkeys((*COLUMNS, *NEEDED)))
    for run in runs:
        own = recorded_settings(run, SensitivityConfig)
        again = Induced(gain=own.again_alpha, offset_A=own.again_beta_A)
        for point in captures(run, columns):
            given: dict[str, Any] = {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in point.induced.items()
                if hasattr(NOTHING_INDUCED, name)
            }
            induced, place = Induced(**given), (point.torque_Nm, point.speed_Hz)
            of_mesh = induced == again and place != (own.torque_Nm, own.speed_Hz)
            yield point, induced, {} if of_mesh else _single(induced)


def _what_was_applied(
    runs: Sequence[Run], subject: Subject
) -> tuple[Applied, list[tuple[float, float]], np.ndarray]:
    """Return the compensation; torque and speed of the points with a single error; and sensed over
    commanded RMS current (3,) of all points."""
    compensation, places, wrong = AppliedCompensation(subject.motor), [], 0
    products = CurrentProducts.of(np.empty((0, 3)), np.empty((0, 3)))
    for point, induced, kinds in _points(runs):
        compensation.add(point.ticks, induced.gain, induced.offset_A, induced.cogging)
        products += CurrentProducts.of(
            stacked(point.ticks, CURRENTS), stacked(point.ticks, COMMANDS)
        )
        wrong += induced != NOTHING_INDUCED
        if kinds:
            places.append((point.torque_Nm, point.speed_Hz))
    if not wrong:
        names = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(
            f"{names}: no operating point with an induced error in there; record the plan "
            "`sensitivity`"
        )
    if len(set(places)) > 1:
        raise AnalysisError(
            "single errors were induced at several torques or speeds: analyse the recordings one "
            "by one"
        )
    return compensation.result(), places, products.ratios


def _again(
    runs: Sequence[Run], subject: Subject, applied: Applied, model: RippleModel, torque_Nm: float
) -> Again | None:
    """Calibrate from the points with gains and offsets induced; None if there are none.

    The compensation takes out what the sensors get wrong, so a sensor with the induced errors is
    put in its place: it would have read the wanted currents while the wrong ones flowed.
    """
    calibrator, induced = Calibrator(subject.motor, subject.sensor), None
    for point, mixed, kinds in _points(runs):
        if kinds:
            continue
        if induced not in (None, mixed):
            raise AnalysisError("errors induced in several mixtures: analyse them one by one")
        induced = mixed
        ticks = applied.with_sensors_in_error(point.ticks, mixed.gain, mixed.offset_A)
        calibrator.add(PointData(point.torque_Nm, point.speed_Hz, ticks, point.compensate))
    if induced is None:
        return None
    found = calibrator.joint()
    gain = np.array(induced.gain)
    alpha, beta_A = gain / np.cbrt(gain.prod()), np.array(induced.offset_A)
    gains = 1 + np.diag(found.alpha / alpha - 1)
    offsets_A = np.diag(found.beta_A - beta_A)
    cost = [model.rms_percent(torque_Nm, gains), model.rms_percent(torque_Nm, (1, 1, 1), offsets_A)]
    return Again(alpha, beta_A, found, np.concatenate(cost))
