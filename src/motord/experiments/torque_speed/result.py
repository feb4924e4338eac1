"""Powers, losses and efficiency of operating points, as they were found."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from motord.findings import Finding
from motord.intervals import IntervalEstimate
from motord.recording.plan_columns import PlanValue

Mode = Literal["motoring", "generating", "braking"]
"""Which way the power goes; braking: motor and supply both give power, and all of it is lost."""


@dataclass(frozen=True)
class UncertaintyShare:
    """What a source contributes: standard uncertainties of losses and of efficiency."""

    JSON: ClassVar = ("source", "type", "loss_W", "efficiency_percent")

    source: str
    type: Literal["A", "B"]
    loss_W: float
    efficiency_percent: float | None


@dataclass(frozen=True)
class OperatingPower:
    """An operating point: means over whole turns, powers positive into motor and inverter.

    torque_Nm, speed_Hz: set-points. t_start_ns, t_end_ns: of these turns. readings: of the
    electrical power that count, read_every_s apart. blocks: of turns, whose scatter is the Type A
    uncertainty. sampling_W: standard uncertainty of the electrical power that slow readings cause.
    bus_ripple_W: limit of what it lacks where voltage and current of the bus ripple together.
    shaft_ripple_W: standard uncertainty of the mechanical power by torque and speed that ripple
    together once and twice a turn, as an eccentric encoder or a misaligned coupling makes them.
    loss_drift_W: change of the losses from the beginning to the end, with its standard error.
    in_step: how far readings that are instants fall on the same angles, from 0 to 1.
    tick_s: time between ticks.
    envelope_Nm: largest torque that the plan had for this speed, None if it is not recorded.
    plan: name and settings of its recording's plan, as `recording.plan_columns` has them.
    """

    JSON: ClassVar = (
        "torque_Nm", "speed_Hz", "torque_mean_Nm", "speed_mean_Hz", "mode",
        "mechanical_W=mechanical", "electrical_W=electrical", "loss_W=loss",
        "efficiency_percent=efficiency", "efficiency_reason", "t_start_ns", "t_end_ns",
        "turns", "blocks", "readings", "read_every_s", "sampling_W", "bus_ripple_W",
        "shaft_ripple_W", "loss_drift_W", "loss_drift_stderr_W", "in_step", "envelope_Nm", "budget",
    )  # fmt: skip

    torque_Nm: float
    speed_Hz: float
    torque_mean_Nm: float
    speed_mean_Hz: float
    mode: Mode
    mechanical: IntervalEstimate
    electrical: IntervalEstimate
    loss: IntervalEstimate
    efficiency: IntervalEstimate
    efficiency_reason: str
    t_start_ns: int
    t_end_ns: int
    turns: int
    blocks: int
    readings: int
    read_every_s: float
    sampling_W: float
    bus_ripple_W: float
    shaft_ripple_W: float
    loss_drift_W: float
    loss_drift_stderr_W: float
    in_step: float
    tick_s: float
    budget: tuple[UncertaintyShare, ...]
    envelope_Nm: float | None = None
    plan: Mapping[str, PlanValue] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Set-points as text."""
        return f"{self.torque_Nm:g} Nm, {self.speed_Hz:g} Hz"


@dataclass(frozen=True)
class EfficiencyMap:
    """Operating points with their powers; left_out: why points are not among them."""

    JSON: ClassVar = ("points", "left_out", "power_source")

    points: tuple[OperatingPower, ...]
    power_source: str
    left_out: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def best(self) -> OperatingPower | None:
        """The point of the highest efficiency, None if it is defined nowhere."""
        defined = [one for one in self.points if one.efficiency.value is not None]
        return max(defined, key=lambda one: one.efficiency.value or 0.0, default=None)
