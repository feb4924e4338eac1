"""What plans are about: operating points, and what is demanded of the bench."""

from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Induced:
    """Errors put on the currents and on the compensated cogging torque on purpose; neutral as is.

    A gain multiplies the current wanted of its phase, an offset is added to it, before the
    compensation of the true errors; cogging multiplies the cogging torque that is compensated.
    """

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset_A: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cogging: float = 1.0

    @property
    def torque_part(self) -> float:
        """By how much the mean torque is another than that asked for: the mean of the gains."""
        return sum(self.gain) / len(self.gain)


NOTHING_INDUCED = Induced()


@dataclass(frozen=True)
class OperatingPoint:
    """A torque and a speed to be held while `turns` turns are recorded.

    `aim`: what is done at the point, as text, if that is something else.
    """

    index: int
    torque_Nm: float
    speed_Hz: float
    turns: int
    induced: Induced = NOTHING_INDUCED
    aim: str = ""


@dataclass(frozen=True)
class Demand:
    """What the bench should do now. A rise of `enabled` enables, a fall ramps down, disables.

    plan_point: number that the ticks carry, -1 for none; label: what an operator reads meanwhile.
    """

    enabled: bool = False
    torque_Nm: float = 0.0
    speed_Hz: float = 0.0
    brake: float = 0.0
    drive_rad_s: float = 0.0
    compensate: int = 0
    plan_point: int = -1
    induced: Induced = NOTHING_INDUCED
    label: str = ""

    def at_rest(self, **changes: Any) -> "Demand":
        """Return this demand with `changes`, without torque, drive and operating point."""
        changes |= {"torque_Nm": 0.0, "drive_rad_s": 0.0}
        return replace(self, plan_point=-1, induced=NOTHING_INDUCED, **changes)

    def labelled(self, label: str, **changes: Any) -> "Demand":
        """Return this demand with `changes`, and `label` after its own."""
        return replace(self, label=f"{self.label}: {label}", **changes)
