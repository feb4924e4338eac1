"""A pass of learning: from the residual ripple of the operating points to a better calibration."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np

from motord.calibration import Calibration, TorqueSpeed
from motord.experiments.captures_left_out import CapturesLeftOut, prepared
from motord.experiments.hold_timing import recorded_hold
from motord.experiments.ilc.estimate import (
    Learning,
    PassResidual,
    over_orders,
    pass_residual,
    refine,
    reopened,
    settled,
    unlearned_mesh,
)
from motord.experiments.ilc.order_list import (
    LEAST_TURNS,
    SeenRipple,
    Unreached,
    reach_text,
    seen_points,
    to_learn,
    unreached,
)
from motord.experiments.ripple_findings import asynchronous_line
from motord.experiments.signal_findings import require_reliable, signal_findings
from motord.experiments.subject import AnalysisError, Subject, check_applied
from motord.findings import Finding, listed
from motord.identification.operating_points import PointData, Samples, require_turns
from motord.identification.point_ripple import PointRipple, rms_errors
from motord.learned import LearnedPoint, LearnedTorque
from motord.recording.captures import captures
from motord.recording.reader import Run
from motord.sequencing.settings import COMPENSATE

AT_LIMIT = 0.999
"""Part of its limit from which on a correction is held by it."""

CONSEQUENCE = "it counts as noise of each order, which is not learned"
"""Of lines that are not locked to the rotor."""


@dataclass(frozen=True)
class LearnPass:
    """What a pass shows, and the calibration after it.

    calibration: with the corrections to apply from now on. unreached: what the torque shows and is
    not corrected; reach: how far that goes at each speed, as text. limit_Nm: that no correction
    exceeds. ripples: of the points, with the lines that are not locked to the rotor. left_out:
    findings of points that cannot be used.
    """

    calibration: Calibration
    unreached: tuple[Unreached, ...] = ()
    reach: tuple[str, ...] = ()
    limit_Nm: float = np.inf
    ripples: tuple[PointRipple, ...] = ()
    left_out: tuple[Finding, ...] = ()

    @property
    def learned(self) -> LearnedTorque:
        """The corrections."""
        assert self.calibration.learned is not None
        return self.calibration.learned

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of the calibration: where data depart from its model; and what corrections rest on."""
        lines = asynchronous_line(self.ripples, CONSEQUENCE)
        faults = signal_findings((one.label, one.faults) for one in self.ripples)
        own = *self.limited(), *lines, *faults, *self.left_out
        return (*(self.calibration.findings or ()), *own)

    def limited(self) -> Iterator[Finding]:
        """Yield a finding where a correction is at its limit, and is not what the torque needs."""
        at = [
            f"{torque_Nm:g} Nm, {speed_Hz:g} Hz"
            for (torque_Nm, speed_Hz), point in self.learned.by_place.items()
            if point.amplitude_Nm > AT_LIMIT * self.limit_Nm
        ]
        if at:
            yield Finding(
                "correction-limited", len(at), 0, "operating points", "serious",
                f"{listed(at)}: the residual exceeds the {1e3 * self.limit_Nm:.3g} mNm that "
                "learning may take out: the calibration is of another motor, or the torque has "
                "another unit or sign",
                "check the torque sensor's scale and sign, and calibrate again before learning",
            )  # fmt: skip

    @property
    def half_width_percent(self) -> dict[TorqueSpeed, float | None]:
        """Half of the 95 % interval of the RMS error that each point had in this pass."""
        points = rms_errors(self.ripples).points
        return {(one.torque_Nm, one.speed_Hz): one.after_half_width for one in points}

    @property
    def finished(self) -> bool:
        """True once no point gains any more."""
        return all(point.gain == 0 for point in self.learned.points)

    def to_json(self) -> dict[str, Any]:
        """Return the pass as `analyse learn --json` prints it.

        Calibration files have no intervals of earlier passes: they are null. A point of the mesh
        that no pass could use has none of either.
        """
        half_width_percent = self.half_width_percent
        return {
            "schema": "motord.learn/1",
            "calibration": self.calibration.id,
            "motor": self.calibration.motor.name,
            "serial": self.calibration.motor.serial,
            "runs": list(self.learned.runs),
            "finished": self.finished,
            "orders": list(self.learned.orders),
            "unreached": [asdict(one) for one in self.unreached],
            "reach": list(self.reach),
            "points": [
                {
                    "torque_Nm": torque_Nm,
                    "speed_Hz": speed_Hz,
                    "rms_percent": list(point.history_percent),
                    "rms_half_width_percent": [
                        *(None for _ in point.history_percent[1:]),
                        half_width_percent.get((torque_Nm, speed_Hz)),
                    ][: len(point.history_percent)],
                    "correction_mNm": 1e3 * point.amplitude_Nm,
                    "gain": point.gain,
                }
                for (torque_Nm, speed_Hz), point in self.learned.by_place.items()
            ],
        }


def learn_from_runs(
    runs: Sequence[Run],
    subject: Subject,
    calibration: Calibration,
    created: datetime,
    learning: Learning,
) -> LearnPass:
    """Return what to apply after the pass that `runs` hold, taken with `calibration` applied.

    Without `hold` in `learning`, the runs state it. Raises AnalysisError for runs that were
    taken with another calibration, or of which no point can be used.
    """
    for run in runs:
        check_applied(run, calibration.id)
    if learning.hold is None and runs:
        learning = replace(learning, hold=recorded_hold(runs[0]))
    points = (point for run in runs for point in captures(run))
    names, left_out = [run.path.name for run in runs], CapturesLeftOut()
    done = learn(points, subject, calibration, names, created, learning, left_out)
    return replace(done, left_out=left_out.findings(runs))


def learn(
    points: Iterable[PointData],
    subject: Subject,
    calibration: Calibration,
    runs: Sequence[str],
    created: datetime,
    learning: Learning,
    left_out: CapturesLeftOut,
) -> LearnPass:
    """Return what to apply after a pass with `calibration` applied; errors as above.

    The first pass chooses the mesh; later ones must be over the same. Each adds the orders that its
    torque shows. left_out: takes points that cannot be used, of which nothing is learned.
    """
    motor, places = subject.motor, set[TorqueSpeed]()
    seen = _seen(_compensated(points, places), subject, calibration, learning, left_out)
    known = calibration.learned.orders if calibration.learned else ()
    orders = to_learn(seen, motor.pole_pairs, known)
    before = calibration.learned or unlearned_mesh(places, orders, learning)
    residuals = tuple(pass_residual(each, orders, motor.rated_torque_Nm) for each in seen)
    widened = _over_orders(before, orders, seen, motor.rated_torque_Nm)
    learned = LearnedTorque(
        torques_Nm=before.torques_Nm,
        speeds_Hz=before.speeds_Hz,
        orders=orders,
        points=_refined(widened, residuals, motor.rated_torque_Nm, learning),
        runs=(*before.runs, *runs),
    )
    one_each = {each.speed_Hz: each for each in seen}
    return LearnPass(
        calibration.with_learned(learned, created),
        unreached=tuple(one for each in seen for one in unreached(each, orders)),
        reach=tuple(reach_text(one_each[speed], subject.sensor) for speed in sorted(one_each)),
        limit_Nm=learning.limit_share * motor.rated_torque_Nm,
        ripples=tuple(seen),
    )


def _seen(
    points: Iterable[PointData],
    subject: Subject,
    calibration: Calibration,
    learning: Learning,
    left_out: CapturesLeftOut,
) -> list[SeenRipple]:
    """Return the ripple of the points with `calibration` applied. Raises AnalysisError for none."""
    calibration.check_motor(subject.motor, recorded=True)
    gain, hold = np.array(calibration.alpha) * calibration.delta_epsilon, learning.hold
    samples = prepared(points, subject.motor.counts, left_out, _usable)
    seen = seen_points(samples, subject.motor, subject.sensor, gain, hold, learning.highest_order)
    if not seen:
        raise AnalysisError(
            f"nothing is learned: no operating point in there can be used{left_out.as_text}"
        )
    return seen


def _compensated(points: Iterable[PointData], places: set[TorqueSpeed]) -> Iterator[PointData]:
    """Yield the points, and add their places. Raises AnalysisError if one is not compensated."""
    for point in points:
        if point.compensate != COMPENSATE["on"]:
            raise AnalysisError(
                f"{point.label} was not taken with everything applied (compensate = on): use a "
                "run of the plan `learn`"
            )
        places.add((point.torque_Nm, point.speed_Hz))
        yield point


def _usable(samples: Samples) -> Samples:
    return require_turns(require_reliable(samples), LEAST_TURNS)


def _over_orders(
    learned: LearnedTorque,
    orders: tuple[int, ...],
    seen: Sequence[SeenRipple],
    rated_torque_Nm: float,
) -> dict[TorqueSpeed, LearnedPoint]:
    """Return the learned points over `orders`, which may be more than they were learned over."""
    by_place = {(each.torque_Nm, each.speed_Hz): each for each in seen}
    return {
        place: over_orders(point, learned.orders, orders, by_place.get(place), rated_torque_Nm)
        for place, point in learned.by_place.items()
    }


def _refined(
    points: Mapping[TorqueSpeed, LearnedPoint],
    residuals: Sequence[PassResidual],
    rated_torque_Nm: float,
    learning: Learning,
) -> tuple[LearnedPoint, ...]:
    """Return the points with their residuals learned.

    Raises AnalysisError for another mesh, and for two residuals of a point: the second would count
    for a correction that was not applied yet.
    """
    after, refined = dict(points), set[TorqueSpeed]()
    for residual in residuals:
        place = residual.torque_Nm, residual.speed_Hz
        if place not in after:
            raise AnalysisError(
                f"{residual.torque_Nm:g} Nm, {residual.speed_Hz:g} Hz is not a point of the mesh "
                "that was learned; take the pass over that mesh, or begin with a calibration "
                "without `learned`"
            )
        if place in refined:
            raise AnalysisError(
                f"{residual.torque_Nm:g} Nm, {residual.speed_Hz:g} Hz was taken twice with the "
                "same corrections: name one recording of it"
            )
        refined.add(place)
        after[place] = refine(after[place], residual, rated_torque_Nm, learning)
    return tuple(after.values())


def finish(done: LearnPass, created: datetime) -> LearnPass:
    """Return the pass with every point at its best: nothing that was not measured stays."""
    return replace(done, calibration=_each(done.calibration, settled, created))


def reopen(calibration: Calibration, created: datetime, learning: Learning) -> Calibration:
    """Return the calibration with every point open to learn on from what it is."""
    return _each(calibration, lambda point: reopened(point, learning), created)


def _each(
    calibration: Calibration, change: Callable[[LearnedPoint], LearnedPoint], created: datetime
) -> Calibration:
    learned = calibration.learned
    if learned is None:
        return calibration
    points = tuple(change(point) for point in learned.points)
    if points == learned.points:
        return calibration
    return calibration.with_learned(learned.model_copy(update={"points": points}), created)
