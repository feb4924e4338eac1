"""A plan carried out on a virtual bench: the executor of the real bench, in virtual time.

Slow channels have readings from the truth of its ticks.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pkgutil import resolve_name
from typing import Any

import numpy as np

from motord.config import ChannelConfig, Config
from motord.config.channel_sources import SimulatedSource
from motord.control.types import SETPOINT
from motord.schema import Request, joined
from motord.sequencing import Demand, Executor, Observation, Plan, PlanState, TickWatcher
from motord.sequencing.observation import ChannelValue, Precision
from motord.virtual.bench import VirtualBench

Reading = tuple[int, ChannelConfig, float]
"""Time (Unix ns), channel, value."""

LOOK_S = 0.05
"""Virtual time between two looks of the executor."""

LOOKS_PASSED_ON = 20
"""Looks whose ticks are passed on at once: large blocks are written and read fastest."""

BlockSink = Callable[[np.ndarray, np.ndarray], None]


def channel_readings(channels: Sequence[ChannelConfig], truth: np.ndarray) -> Iterator[Reading]:
    """Yield what simulated channels read over `truth` (TRUTH_DTYPE), each in order of time.

    They read at whole multiples of their period: a temperature of the rig, or the mean of its DC
    power since the reading before, of which what begins with the block has none.
    """
    for channel in channels:
        if isinstance(channel.source, SimulatedSource):
            readings = _powers if channel.source.quantity == "dc_power_W" else _temperatures
            for t_ns, raw in zip(*readings(channel, channel.source.quantity, truth), strict=True):
                yield int(t_ns), channel, float(raw) * channel.scale + channel.offset


def newest(
    channels: Sequence[ChannelConfig], truth: np.ndarray, *, at_once: bool = False
) -> dict[str, ChannelValue]:
    """Return the newest temperatures that were read over `truth`, by the channel's name.

    at_once: those of its first tick, as of a bench whose channels have been read before.
    """
    thermometers = [
        (one, one.source.quantity)
        for one in channels
        if isinstance(one.source, SimulatedSource) and one.source.quantity != "dc_power_W"
    ]
    first = [
        (int(truth["t_ns"][0]), one, one.scale * float(truth[quantity][0]) + one.offset)
        for one, quantity in thermometers
    ]
    readings = first if at_once else channel_readings([one for one, _ in thermometers], truth)
    return {
        channel.name: ChannelValue(t_ns * 1e-9, value, of_motor=channel.role is not None)
        for t_ns, channel, value in readings
    }


def _powers(channel: ChannelConfig, _: str, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t_ns, energy_J = truth["t_ns"], truth["energy_dc_J"]
    at_ns = _reading_times(channel, int(t_ns[0]), int(t_ns[-1]))
    at_J = np.interp((at_ns - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, energy_J)
    return at_ns[1:], np.diff(at_J) / (round(channel.period_s * 1e9) * 1e-9)


def _temperatures(
    channel: ChannelConfig, quantity: str, truth: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    t_ns = truth["t_ns"]
    tick_ns = int(t_ns[1] - t_ns[0]) if t_ns.size > 1 else 1
    at_ns = _reading_times(channel, int(t_ns[0]) - tick_ns + 1, int(t_ns[-1]))
    return at_ns, np.interp((at_ns - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, truth[quantity])


def _reading_times(channel: ChannelConfig, from_ns: int, to_ns: int) -> np.ndarray:
    """Return the times within both ends at which a channel is read (n,), Unix ns."""
    period_ns = round(channel.period_s * 1e9)
    return np.arange(-(-from_ns // period_ns) * period_ns, to_ns + 1, period_ns)


class PlanFailed(Exception):
    """A plan that did not end as it should; the message says why."""


def run_plan(bench: VirtualBench, plan: Plan, on_block: BlockSink) -> list[dict[str, Any]]:
    """Run `plan` to its end, passing on blocks (ticks, truth). Returns the points taken.

    Raises PlanFailed if the bench trips or the plan fails.
    """
    executor, watcher = Executor(plan), TickWatcher()
    estimation = InlineEstimation(plan, bench.config)
    setpoint = np.zeros(1, SETPOINT)
    setpoint["plan_point"] = -1
    demand = Demand()
    look = max(round(LOOK_S * bench.config.loop.rate_Hz), 1)
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    channels: dict[str, ChannelValue] = {}
    while not executor.finished:
        blocks.append(bench.run(setpoint, look))
        ticks, truth = blocks[-1]
        channels = channels or newest(bench.config.channels, blocks[0][1], at_once=True)
        channels = channels | newest(bench.config.channels, truth)
        seen = estimation.seen(watcher.take(ticks, channels), ticks, executor.points)
        before, demand = demand, executor.advance(seen)
        _put(setpoint, before, demand)
        if len(blocks) == LOOKS_PASSED_ON or executor.finished:
            on_block(*map(joined, zip(*blocks, strict=True)))
            blocks.clear()
    if executor.state is not PlanState.DONE:
        raise PlanFailed(f"{plan.name}: {executor.message}")
    return executor.points


class InlineEstimation:
    """The estimator of a plan, if it names one, with each look of the executor."""

    def __init__(self, plan: Plan, config: Config) -> None:
        self._estimator: Any = None
        if plan.estimator:
            self._estimator = resolve_name(plan.estimator)(config, plan.targets)
        self._taken = 0
        self._newest: Precision | None = None

    def seen(
        self, seen: Observation, ticks: np.ndarray, points: Sequence[Mapping[str, Any]]
    ) -> Observation:
        """Return the observation of `ticks` with the newest precision; points: taken so far."""
        if self._estimator is None:
            return seen
        for point in points[self._taken :]:
            self._newest = self._estimator.captured(point)
        self._taken = len(points)
        self._estimator.take(ticks)
        return seen._replace(precision=self._newest)


def _put(setpoint: np.ndarray, before: Demand, demand: Demand) -> None:
    """Write a demand into the set-point record, as the supervisor does into its mailbox.

    Field by field of the array: attributes of a numpy record take ten times as long.
    """
    setpoint["seq"] += 1
    if demand is before:
        return
    setpoint["torque_Nm"], setpoint["speed_rad_s"] = demand.torque_Nm, 2 * np.pi * demand.speed_Hz
    setpoint["brake"], setpoint["drive_rad_s"] = demand.brake, demand.drive_rad_s
    setpoint["plan_point"], setpoint["compensate"] = demand.plan_point, demand.compensate
    induced = demand.induced
    setpoint["induced_gain"] = np.subtract(induced.gain, 1.0)
    setpoint["induced_offset_A"] = induced.offset_A
    setpoint["induced_cogging"] = induced.cogging - 1.0
    if demand.enabled != before.enabled:
        setpoint["request"] = Request.ENABLE if demand.enabled else Request.DISABLE
        setpoint["request_seq"] += 1
