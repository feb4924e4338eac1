"""What errors of a calibration cost in ripple: theory, and the `sensitivity` plan's recordings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.sensitivity.applied import NEEDED, Applied, AppliedCompensation
from motord.experiments.sensitivity.curves import ERRORS, RippleModel, limits, single
from motord.experiments.sensitivity.result import LIMIT_PERCENT, Again, Sensitivity, Theory
from motord.experiments.sensitivity.slope_fit import Series, series
from motord.experiments.sensitivity.volume import Intervals, limit_surface, volume
from motord.experiments.subject import AnalysisError, Subject
from motord.identification.operating_points import PointData, good_points, prepare, split
from motord.identification.point_ripple import point_ripple
from motord.recording.captures import COLUMNS
from motord.recording.reader import Run, bounds_of

DEFAULT_TORQUE_Nm = 3.0
"""Set-point of the theory where no recording says which, Poels 2008, Figure 4.3."""

IDEALS = {"alpha_a": 1.0, "beta_a_A": 0.0, "cogging": 1.0, "delta_epsilon": 1.0}
"""Each kind of error: its value without any."""


def theory(motor: MotorConfig, tau_cog_Nm: np.ndarray, torque_Nm: float) -> Theory:
    """Return the theory for a motor with its cogging torque (counts,). Raises IdentifyError."""
    model, intervals = RippleModel.of(motor, tau_cog_Nm), Intervals()
    ends = {
        what: tuple(
            (end, float(single(model, torque_Nm, what, end))) for end in getattr(intervals, what)
        )
        for what in ERRORS
    }
    return Theory(
        torque_Nm=torque_Nm,
        within={what: limits(model, torque_Nm, what, LIMIT_PERCENT) for what in ERRORS},
        ends=ends,
        volume=volume(model, torque_Nm, intervals),
        surface=limit_surface(model, torque_Nm, LIMIT_PERCENT, intervals),
    )


def theory_alone(subject: Subject, tau_cog_Nm: np.ndarray, torque_Nm: float) -> Sensitivity:
    """Return the theory without any recording. Raises IdentifyError."""
    return Sensitivity(subject, (), 0.0, theory(subject.motor, tau_cog_Nm, torque_Nm), (), None)


@dataclass(frozen=True)
class _Induced:
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    offset_A: tuple[float, ...] = (0.0, 0.0, 0.0)
    cogging: float = 1.0

    @classmethod
    def of(cls, point: Mapping[str, Any]) -> "_Induced":
        given = point.get("induced", {})
        return cls(
            tuple(given.get("gain", cls.gain)),
            tuple(given.get("offset_A", cls.offset_A)),
            float(given.get("cogging", cls.cogging)),
        )

    @property
    def values(self) -> dict[str, float]:
        """To which kinds of error this belongs, with its value; none if it mixes them."""
        gains, offsets = self.gain != (1.0, 1.0, 1.0), any(self.offset_A)
        wrong = (gains, offsets, self.cogging != 1.0)
        if sum(wrong) > 1:
            return {}
        if not any(wrong):
            return IDEALS
        if offsets:
            return {"beta_a_A": self.offset_A[0]}
        if self.cogging != 1.0:
            return {"cogging": self.cogging}
        common = max(self.gain) == min(self.gain)
        return {"delta_epsilon": 1 / self.gain[0]} if common else {"alpha_a": self.gain[0]}


@dataclass
class _Measured:
    """Values, RMS errors, standard errors and theory of one kind of error, as they come."""

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)

    def series(self, what: str) -> Series:
        columns = np.array(self.rows).T
        return series(what, IDEALS[what], *columns)


def sensitivity(runs: Sequence[Run], subject: Subject) -> Sensitivity:
    """Return theory and practice from recordings of the `sensitivity` plan.

    Raises AnalysisError where no errors were induced, IdentifyError for what cannot be identified.
    """
    applied, places = _what_was_applied(runs, subject)
    share = tuple(applied.gain.tolist()) if subject.motor.connection == "star" else None
    model = RippleModel.of(subject.motor, applied.tau_cog_Nm, share)
    measured = {what: _Measured() for what in IDEALS}
    for point, induced in _points(runs):
        if not induced.values:
            continue
        ripple = point_ripple(prepare(point, subject.motor.counts), subject.motor, subject.sensor)
        expected = model.rms_percent(
            point.torque_Nm, induced.gain, induced.offset_A, induced.cogging
        )
        for what, value in induced.values.items():
            row = (value, ripple.rms_percent, ripple.stderr_percent, float(expected))
            measured[what].rows.append(row)
    torque_Nm, speed_Hz = places[0] if places else (DEFAULT_TORQUE_Nm, 0.0)
    return Sensitivity(
        subject=subject,
        runs=tuple(run.path.name for run in runs),
        speed_Hz=speed_Hz,
        theory=theory(subject.motor, applied.tau_cog_Nm, torque_Nm),
        series=tuple(m.series(what) for what, m in measured.items() if len(m.rows) > 1),
        again=_again(runs, subject, applied, model, torque_Nm),
    )


def _points(runs: Sequence[Run]) -> Iterator[tuple[PointData, _Induced]]:
    """Yield the good points with their ticks and what was induced there."""
    columns = tuple(dict.fromkeys((*COLUMNS, *NEEDED)))
    for run in runs:
        for point in good_points(run.operating_points()):
            for data in split(run.ticks(columns, **bounds_of(point)), [point]):
                yield data, _Induced.of(point)


def _what_was_applied(
    runs: Sequence[Run], subject: Subject
) -> tuple[Applied, list[tuple[float, float]]]:
    """Return the compensation, and torque and speed of the points with a single error."""
    compensation, places, wrong = AppliedCompensation(subject.motor), [], 0
    for point, induced in _points(runs):
        compensation.add(point.ticks, induced.gain, induced.offset_A, induced.cogging)
        wrong += induced.values is not IDEALS
        if induced.values:
            places.append((point.torque_Nm, point.speed_Hz))
    if not wrong:
        names = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(
            f"{names}: no operating point with an induced error in there; record the plan "
            "`sensitivity`"
        )
    return compensation.result(), places


def _again(
    runs: Sequence[Run],
    subject: Subject,
    applied: Applied,
    model: RippleModel,
    torque_Nm: float,
) -> Again | None:
    """Calibrate from the points with gains and offsets induced; None if there are none.

    The compensation takes out what the sensors get wrong, so a sensor with the induced errors is
    put in its place: it would have read the wanted currents while the wrong ones flowed.
    """
    calibrator, induced = Calibrator(subject.motor, subject.sensor), None
    for point, mixed in _points(runs):
        if mixed.values:
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
