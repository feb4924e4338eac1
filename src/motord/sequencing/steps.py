"""What plans are made of: operating points, demands on the bench, and steps that make demands."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Protocol

from motord.schema import State
from motord.sequencing.observation import Observation


@dataclass(frozen=True)
class Induced:
    """Errors put on the currents and on the compensated cogging torque on purpose; neutral as is.

    A gain multiplies the current wanted of its phase, an offset is added to it, before the
    compensation of the true errors; cogging multiplies the cogging torque that is compensated.
    """

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset_A: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cogging: float = 1.0


NOTHING_INDUCED = Induced()


@dataclass(frozen=True)
class OperatingPoint:
    """A torque and a speed to be held while `turns` turns are recorded.

    `aim`: what is done at the point, in words, if that is something else.
    """

    index: int
    torque_Nm: float
    speed_Hz: float
    turns: int
    induced: Induced = NOTHING_INDUCED
    aim: str = ""


@dataclass(frozen=True)
class Demand:
    """What the bench should do now. A rise of `enabled` enables, a fall ramps down, disables."""

    enabled: bool = False
    torque_Nm: float = 0.0
    speed_Hz: float = 0.0
    brake: float = 0.0
    drive_rad_s: float = 0.0
    compensate: int = 0
    plan_point: int = -1
    induced: Induced = NOTHING_INDUCED


class Outcome(Enum):
    """Where a step stands."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class Advance:
    """A step's answer to an observation."""

    demand: Demand
    outcome: Outcome = Outcome.RUNNING
    message: str = ""
    point: dict[str, Any] | None = None  # an operating point that was just captured


class Step(Protocol):
    """One thing to do on the bench. May be begun again after a pause."""

    def begin(self, seen: Observation) -> None:
        """Start, or start over."""

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Go on from `demand`, the one in force."""

    def seconds(self) -> float:
        """Return an estimate of how long this takes (s)."""

    @property
    def label(self) -> str:
        """What an operator reads while it runs."""


Steps = Generator[Step, dict[str, Any] | None, None]


@dataclass(frozen=True)
class Plan:
    """An experiment: its points, and makers of the steps and the time (s) for some of them.

    needs: the device that it cannot do without, "brake", "drive" or "" for none.
    """

    name: str
    points: tuple[OperatingPoint, ...]
    make_steps: Callable[[tuple[OperatingPoint, ...]], Steps]
    estimate_s: Callable[[tuple[OperatingPoint, ...]], float]
    settings: dict[str, Any]
    needs: str = "brake"

    @property
    def seconds(self) -> float:
        """Return an estimate of the whole time (s)."""
        return self.estimate_s(self.points)

    def steps(self) -> Steps:
        """Return the steps, from the beginning."""
        return self.make_steps(self.points)

    def part(self, points: tuple[OperatingPoint, ...]) -> "Plan":
        """Return the same experiment for `points` alone; they keep their numbers."""
        return replace(self, points=points)


@dataclass
class Enable:
    """Enable the bench at zero torque and wait until it is."""

    compensate: int = 0
    timeout_s: float = 5.0
    label: str = "enabling"
    _began_ns: int = 0

    def begin(self, seen: Observation) -> None:
        """Start the clock."""
        self._began_ns = seen.t_ns

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Wait for ENABLED."""
        demand = replace(demand, enabled=True, torque_Nm=0.0, compensate=self.compensate)
        if seen.state == State.ENABLED:
            return Advance(demand, Outcome.DONE)
        if (seen.t_ns - self._began_ns) * 1e-9 > self.timeout_s:
            return Advance(demand, Outcome.FAILED, f"not enabled within {self.timeout_s:g} s")
        return Advance(demand)

    def seconds(self) -> float:
        """Enabling takes well under a second."""
        return 0.5


@dataclass
class Rest:
    """Ramp the torque to zero, disable, release the brake, stop the drive."""

    timeout_s: float = 10.0
    label: str = "ramping down"
    _began_ns: int = field(default=0)

    def begin(self, seen: Observation) -> None:
        """Start the clock."""
        self._began_ns = seen.t_ns

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Wait until the bench is no longer enabled; the brake holds until then."""
        demand = replace(
            demand,
            enabled=False,
            torque_Nm=0.0,
            drive_rad_s=0.0,
            plan_point=-1,
            induced=NOTHING_INDUCED,
        )
        if seen.state != State.ENABLED:
            return Advance(replace(demand, brake=0.0, speed_Hz=0.0), Outcome.DONE)
        if (seen.t_ns - self._began_ns) * 1e-9 > self.timeout_s:
            return Advance(demand, Outcome.FAILED, "still enabled: the bench did not ramp down")
        return Advance(demand)

    def seconds(self) -> float:
        """A ramp from full torque takes about a second."""
        return 1.0
