"""`cogging` and `back-emf`: the external drive turns the rotor, no current flows.

The power stage is off: the bench is READY, after a short ENABLED at zero torque that shows it to be
in order and arms the interlocks. Enabled at zero torque the offsets of the currents would flow.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from motord.config import Config, DrivenConfig
from motord.sequencing.driven_point import DrivePoint
from motord.sequencing.limits import SPEED_MARGIN, check_drive
from motord.sequencing.observation import Observation
from motord.sequencing.settings import chosen
from motord.sequencing.steps import (
    Advance,
    Demand,
    Enable,
    OperatingPoint,
    Outcome,
    Plan,
    Rest,
    Steps,
)

TURN_rad = 6.283185307179586
"""Radians a turn."""

STANDSTILL_Hz = 0.05
"""Speed below which the rotor counts as standing."""


def make(name: str, config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.NAME]` with `settings`. Raises PlanError."""
    own: DrivenConfig = getattr(config.plans, name.replace("-", "_"))
    driven = chosen(name, own, settings)
    for speed_Hz in driven.speeds_Hz:
        check_drive(config, speed_Hz)
    return Plan(
        name=name,
        points=points(driven),
        make_steps=partial(steps, driven, _fastest_Hz(config)),
        estimate_s=partial(seconds, driven, _fastest_Hz(config)),
        settings=driven.model_dump(mode="json"),
        needs="drive",
    )


def points(driven: DrivenConfig) -> tuple[OperatingPoint, ...]:
    """Return the points, in the order of the speeds."""
    return tuple(
        OperatingPoint(index, 0.0, speed_Hz, driven.turns)
        for index, speed_Hz in enumerate(driven.speeds_Hz)
    )


def steps(driven: DrivenConfig, fastest_Hz: float, points: tuple[OperatingPoint, ...]) -> Steps:
    """Yield the steps: on and off again, every speed, standstill."""
    yield Enable()
    yield Rest()
    for point in points:
        yield _drive(point, driven, fastest_Hz)
    yield Standstill()


def seconds(driven: DrivenConfig, fastest_Hz: float, points: tuple[OperatingPoint, ...]) -> float:
    """Return an estimate of the whole time (s)."""
    ends_s = Enable().seconds() + Rest().seconds() + Standstill().seconds()
    return ends_s + sum(_drive(point, driven, fastest_Hz).seconds() for point in points)


def _drive(point: OperatingPoint, driven: DrivenConfig, fastest_Hz: float) -> DrivePoint:
    return DrivePoint(point, driven, min(driven.spin_up * point.speed_Hz, fastest_Hz))


def _fastest_Hz(config: Config) -> float:
    """Return the speed that neither the drive's limit nor the over-speed trip forbids."""
    trip_rad_s = SPEED_MARGIN * config.limits.trip_speed_rad_s
    return min(config.drive.speed_max_rad_s, trip_rad_s) / TURN_rad


@dataclass
class Standstill:
    """Stop the drive and wait until the rotor stands."""

    timeout_s: float = 30.0
    label: str = "coming to rest"
    _began_ns: int = 0

    def begin(self, seen: Observation) -> None:
        """Start the clock."""
        self._began_ns = seen.t_ns

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Wait for standstill."""
        demand = replace(demand, drive_rad_s=0.0, speed_Hz=0.0, plan_point=-1)
        if abs(seen.speed_Hz) < STANDSTILL_Hz:
            return Advance(demand, Outcome.DONE)
        if (seen.t_ns - self._began_ns) * 1e-9 > self.timeout_s:
            return Advance(demand, Outcome.FAILED, "the rotor still turns: the drive did not stop")
        return Advance(demand)

    def seconds(self) -> float:
        """A drive stops within a few seconds."""
        return 1.5
