"""What a plan sees of the bench: a summary of the ticks since the observation before."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from motord.schema import State
from motord.sequencing.demand import Demand

WINDOW_TURNS = 1.0
"""The speed that counts is the mean over the last whole turn: ripple must not move the brake.

Speeds are means of the ticks' own estimates, not angle over time: a loop that was kept from running
has no ticks, and the rotor's path meanwhile says nothing of the operating point.
"""

WINDOW_BLOCKS = 500
"""Blocks looked back on at most, for a rotor that hardly turns."""


@dataclass(frozen=True)
class Precision:
    """How precisely a plan knows by now what it is to find out: what it may end early by.

    Halves of the 95 % intervals that the captures so far give, by quantity with its unit.

    captures: how many operating points it is of; half_widths: such as {"beta_A": 0.03}, a quantity
    that these cannot give yet being left out; obstacle: why the plan must not end early by it (a
    model that does not fit), "" if it may; remark: what else the captures show, as text.
    """

    captures: int
    half_widths: Mapping[str, float] = field(default_factory=dict)
    obstacle: str = ""
    remark: str = ""

    def reaches(self, targets: Mapping[str, float]) -> bool:
        """Return whether every target is reached; False without targets."""
        return (
            bool(targets)
            and not self.obstacle
            and all(self.half_widths.get(name, float("inf")) <= targets[name] for name in targets)
        )

    def to_text(self, targets: Mapping[str, float]) -> str:
        """Return what is reached next to what is wanted, as "beta_A 0.03 of 0.02"."""
        known = ((name, self.half_widths.get(name)) for name in targets)
        parts = [
            f"{name} {'?' if half is None else format(half, '.2g')} of {targets[name]:g}"
            for name, half in known
        ]
        return ", ".join([*parts, *([self.obstacle] if self.obstacle else [])])


@dataclass(frozen=True)
class ChannelValue:
    """The newest reading of a slow channel: t_s, when it was read, by a clock of the channels.

    obstacle: why there is no valid value, "" if there is one; of_motor: a temperature of the motor.
    """

    t_s: float
    value: float
    obstacle: str = ""
    of_motor: bool = False


@dataclass(frozen=True)
class TemperatureSpan:
    """A temperature of the motor (degC) since an operating point began; nan where it is unknown.

    mean_C: of the values at the ends of `blocks` blocks of ticks.
    """

    mean_C: float = 0.0
    lowest_C: float = float("inf")
    highest_C: float = -float("inf")
    blocks: int = 0

    def with_reading(self, reading: ChannelValue) -> "TemperatureSpan":
        """Return the span with one more; nan once there was no valid value."""
        blocks, value_C = self.blocks + 1, float("nan") if reading.obstacle else reading.value
        return TemperatureSpan(
            self.mean_C + (value_C - self.mean_C) / blocks,
            float(np.minimum(self.lowest_C, value_C)),
            float(np.maximum(self.highest_C, value_C)),
            blocks,
        )

    @property
    def change_K(self) -> float:
        """By how much it moved."""
        return self.highest_C - self.lowest_C


class Observation(NamedTuple):
    """The bench at the end of a block of ticks."""

    t_ns: int
    tick: int
    state: State
    trip_bits: int
    speed_Hz: float  # over the block
    turn_speed_Hz: float  # over the last turn, or since the start
    torque_set_Nm: float
    plan_point: int
    point_first_tick: int  # first tick with this plan_point
    point_first_t_ns: int
    point_turns: float  # turned since then
    point_speed_Hz: float  # mean of the ticks since then
    turned_rad: float = 0.0  # since the first observation, backwards negative
    lowest_rad: float = 0.0  # of turned_rad within the block
    highest_rad: float = 0.0
    point_ticks: int = 0  # since the first tick with this plan_point
    point_missed: int = 0  # periods without a tick since then
    point_link_errors: int = 0
    point_slowest_Hz: float = 0.0  # of the means over whole turns since then
    point_fastest_Hz: float = 0.0
    temperature_C: float = float("nan")  # of the inverter
    point_temperatures_C: Mapping[str, TemperatureSpan] = MappingProxyType({})  # by channel
    demand: Demand = Demand()  # in force meanwhile
    precision: Precision | None = None  # the newest that the plan's estimator gave
    channels: Mapping[str, ChannelValue] = MappingProxyType({})  # slow ones, by name

    def since_s(self, earlier: "Observation") -> float:
        """Return the time since an earlier observation (s)."""
        return (self.t_ns - earlier.t_ns) * 1e-9


class TickWatcher:
    """Makes observations from successive blocks of ticks."""

    def __init__(self) -> None:
        self._angle_rad = 0.0
        self._turned_rad = 0.0
        self._started = False
        self._blocks: deque[tuple[np.ndarray, np.ndarray]] = deque()  # rad, rad/s
        self._block_sums_rad_s: deque[float] = deque()
        self._ticks_in_blocks = 0
        self._point = -1
        self._point_first = (0, 0)
        self._point_turned_rad = 0.0
        self._point_ticks = 0
        self._point_speed_rad_s = 0.0
        self._point_counts = (0, 0)  # missed, link_errors at its first tick
        self._point_turn_speeds_Hz: tuple[float, float] | None = None
        self._point_temperatures_C: dict[str, TemperatureSpan] = {}

    def take(
        self, ticks: np.ndarray, channels: Mapping[str, ChannelValue] = MappingProxyType({})
    ) -> Observation:
        """Return what the block `ticks` (TICK_DTYPE, at least one) and slow channels show."""
        angle_rad = ticks["angle_rad"].astype(float)
        if not self._started:
            self._angle_rad, self._started = float(angle_rad[0]), True
        steps_rad = np.empty_like(angle_rad)
        steps_rad[0] = angle_rad[0] - self._angle_rad
        np.subtract(angle_rad[1:], angle_rad[:-1], out=steps_rad[1:])
        steps_rad -= 2 * np.pi * np.rint(steps_rad / (2 * np.pi))
        turned_rad = self._turned_rad + steps_rad.cumsum()
        first = self._watch_point(ticks, turned_rad)
        self._point_temperatures_C = {
            name: self._point_temperatures_C.get(name, TemperatureSpan()).with_reading(one)
            for name, one in channels.items()
            if one.of_motor
        }
        self._angle_rad, self._turned_rad = float(angle_rad[-1]), float(turned_rad[-1])
        speed_rad_s = ticks["speed_rad_s"].astype(float)
        self._point_ticks += ticks.size - first
        sum_rad_s = float(speed_rad_s.sum())
        self._point_speed_rad_s += float(speed_rad_s[first:].sum())
        turn_speed_Hz = self._turn_speed_Hz(turned_rad, speed_rad_s, sum_rad_s)
        slowest_Hz, fastest_Hz = self._range_of_turn_speeds(turn_speed_Hz)
        return Observation(
            t_ns=int(ticks["t_ns"][-1]),
            tick=int(ticks["tick"][-1]),
            state=State(int(ticks["state"][-1])),
            trip_bits=int(ticks["trip_bits"][-1]),
            speed_Hz=sum_rad_s / ticks.size / (2 * np.pi),
            turn_speed_Hz=turn_speed_Hz,
            torque_set_Nm=float(ticks["torque_set_Nm"][-1]),
            plan_point=int(ticks["plan_point"][-1]),
            point_first_tick=self._point_first[0],
            point_first_t_ns=self._point_first[1],
            point_turns=(self._turned_rad - self._point_turned_rad) / (2 * np.pi),
            point_speed_Hz=self._point_speed_rad_s / self._point_ticks / (2 * np.pi),
            turned_rad=self._turned_rad,
            lowest_rad=float(turned_rad.min()),
            highest_rad=float(turned_rad.max()),
            point_ticks=self._point_ticks,
            point_missed=int(ticks["missed"][-1]) - self._point_counts[0],
            point_link_errors=int(ticks["link_errors"][-1]) - self._point_counts[1],
            point_slowest_Hz=slowest_Hz,
            point_fastest_Hz=fastest_Hz,
            temperature_C=float(ticks["temperature_C"][-1]),
            point_temperatures_C=self._point_temperatures_C,
            channels=channels,
        )

    def _watch_point(self, ticks: np.ndarray, turned_rad: np.ndarray) -> int:
        """Return at which of the ticks this plan_point begins, 0 if before them."""
        point = int(ticks["plan_point"][-1])
        if point == self._point:
            return 0
        first = int(np.argmax(ticks["plan_point"] == point))
        self._point = point
        self._point_first = (int(ticks["tick"][first]), int(ticks["t_ns"][first]))
        self._point_turned_rad = float(turned_rad[first])
        self._point_ticks, self._point_speed_rad_s = 0, 0.0
        self._point_turn_speeds_Hz = None
        self._point_temperatures_C = {}
        self._point_counts = (int(ticks["missed"][first]), int(ticks["link_errors"][first]))
        return first

    def _range_of_turn_speeds(self, speed_Hz: float) -> tuple[float, float]:
        """Return the range of the means over turns that were all turned with this plan_point."""
        if abs(self._turned_rad - self._point_turned_rad) >= WINDOW_TURNS * 2 * np.pi:
            slowest_Hz, fastest_Hz = self._point_turn_speeds_Hz or (speed_Hz, speed_Hz)
            self._point_turn_speeds_Hz = min(slowest_Hz, speed_Hz), max(fastest_Hz, speed_Hz)
        return self._point_turn_speeds_Hz or (speed_Hz, speed_Hz)

    def _turn_speed_Hz(
        self, turned_rad: np.ndarray, speed_rad_s: np.ndarray, sum_rad_s: float
    ) -> float:
        """Return the mean of the ticks' speeds over the last turn.

        Of the block in which that turn begins only the ticks within it count: with all of them, the
        mean of a rotor that is jerky at low speed moves with each block that comes and goes.
        """
        turn_rad = WINDOW_TURNS * 2 * np.pi
        self._blocks.append((turned_rad, speed_rad_s))
        self._block_sums_rad_s.append(sum_rad_s)
        self._ticks_in_blocks += speed_rad_s.size
        while (
            len(self._blocks) > 2 and abs(self._turned_rad - self._blocks[0][0][-1]) >= turn_rad
        ) or len(self._blocks) > WINDOW_BLOCKS:
            self._ticks_in_blocks -= self._blocks.popleft()[1].size
            self._block_sums_rad_s.popleft()
        oldest_rad, within_rad_s = self._blocks[0]
        ticks = self._ticks_in_blocks
        if len(self._blocks) > 1:
            ticks -= within_rad_s.size
            within_rad_s = within_rad_s[np.abs(self._turned_rad - oldest_rad) < turn_rad]
            ticks += within_rad_s.size
        later_rad_s = sum(islice(self._block_sums_rad_s, 1, None))
        return float(within_rad_s.sum() + later_rad_s) / ticks / (2 * np.pi)
