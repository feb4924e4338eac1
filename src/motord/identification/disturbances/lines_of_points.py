"""Lines that are not locked to the rotor, of all operating points of an experiment together.

A line that is as near to an order as a point resolves is known of it from other speeds alone.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, Self

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.disturbances.asynchronous_line import asynchronous_lines
from motord.identification.disturbances.leakage import Ripple, lines_in_average, with_leakage
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import AsynchronousLine


class DetectedLines(NamedTuple):
    """Lines not locked to the rotor that are detected at a point, of which torque and speed."""

    torque_Nm: float
    speed_Hz: float
    lines: tuple[AsynchronousLine, ...]

    @classmethod
    def of(cls, samples: Samples, counts: int) -> Self:
        """Return the lines that are detected in samples of a point; counts: of the encoder."""
        lines = asynchronous_lines(samples, counts)
        return cls(samples.torque_set_Nm, samples.speed_Hz, lines)


def with_asynchronous(
    found: Sequence[tuple[Ripple, DetectedLines]],
    points: Iterable[Samples],
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
) -> list[Ripple]:
    """Return the ripples of points with the lines that are not locked to the rotor.

    found: of each point the ripple and the lines that are detected there; points: their samples,
    which are read only where there are lines.
    """
    detected = [lines for _, lines in found]
    if not any(one.lines for one in detected):
        return [ripple for ripple, _ in found]
    return [
        with_leakage(
            ripple,
            lines_in_average(own.lines, _others(detected, place, samples), samples, ripple),
            samples,
            motor,
            sensor,
        )
        for place, ((ripple, own), samples) in enumerate(zip(found, points, strict=True))
    ]


def _others(
    detected: Sequence[DetectedLines], place: int, samples: Samples
) -> list[AsynchronousLine]:
    """Return the lines of other points than that of a place.

    Of other torques only those that are seen at its own torque, too. Not those that are of the same
    order here: they turn with the rotor (a belt), and are seen here at another frequency.
    """
    here = detected[place]
    resolution_Hz = samples.speed_Hz / len(samples.turns)
    same_torque = [point for point in detected if point.torque_Nm == here.torque_Nm]
    at_torque = [line for point in same_torque for line in point.lines]
    found = []
    for other, point in enumerate(detected):
        for line in point.lines if other != place else ():
            scaled = replace(line, frequency_Hz=line.frequency_Hz * here.speed_Hz / point.speed_Hz)
            turns = _any_at(scaled, here.lines, resolution_Hz)
            if _any_at(line, here.lines if turns else at_torque, resolution_Hz):
                found.append(line)
    return found


def _any_at(
    line: AsynchronousLine, lines: Iterable[AsynchronousLine], resolution_Hz: float
) -> bool:
    """Return whether any of the lines is at the frequency of one."""
    return any(abs(line.frequency_Hz - one.frequency_Hz) < resolution_Hz for one in lines)
