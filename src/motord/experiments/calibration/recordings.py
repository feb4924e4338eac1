"""The operating points of recordings, handed to the estimators one by one."""

from collections.abc import Iterable

from motord.calibration import Calibration
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.ripple.reconstruct import Explained, explain
from motord.experiments.subject import Subject
from motord.identification.operating_points import prepare
from motord.identification.point_ripple import PointRipple, point_ripple
from motord.recording.captures import captures
from motord.recording.reader import Run


def calibrator(runs: Iterable[Run], subject: Subject) -> Calibrator:
    """Return a calibrator that has taken all good points of the runs. Raises IdentifyError."""
    taken = Calibrator(subject.motor, subject.sensor)
    for run in runs:
        for point in captures(run):
            taken.add(point)
    return taken


def explained(runs: Iterable[Run], subject: Subject, calibration: Calibration) -> list[Explained]:
    """Return the measured and the reconstructed ripple of each good point. Raises IdentifyError."""
    motor, sensor = subject.motor, subject.sensor
    return [
        explain(prepare(point, motor.counts), motor, sensor, calibration)
        for run in runs
        for point in captures(run)
        if not point.induced
    ]


def ripples(runs: Iterable[Run], subject: Subject) -> list[PointRipple]:
    """Return the measured ripple of each good point of the runs. Raises IdentifyError."""
    motor, sensor = subject.motor, subject.sensor
    return [
        point_ripple(prepare(point, motor.counts), motor, sensor)
        for run in runs
        for point in captures(run)
        if not point.induced
    ]
