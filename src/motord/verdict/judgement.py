"""From results of analyses to the verdict of a motor."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from motord.verdict.decision import Figure, FigureVerdict, MotorVerdict, decide
from motord.verdict.figures import figures_of
from motord.verdict.motor_type import MotorType


def judge(motor_type: MotorType, results: Mapping[str, Mapping[str, Any]]) -> MotorVerdict:
    """Return the verdict of a motor; results: JSON results by analysis."""
    return MotorVerdict(tuple(_decisions(motor_type, results)))


def _decisions(
    motor_type: MotorType, results: Mapping[str, Mapping[str, Any]]
) -> Iterator[FigureVerdict]:
    for limit in motor_type.limit:
        kind, result = limit.kind, results.get(limit.analysis)
        if result is None:
            why = f"there is no recording for {limit.analysis}"
            figures: tuple[Figure, ...] = (Figure(kind.name, kind.unit, None, None, None, why),)
        else:
            figures = figures_of(kind, result, limit.at)
        for figure in figures:
            named = replace(figure, analysis=limit.analysis)
            yield decide(named, limit.tolerance, motor_type.risk)
