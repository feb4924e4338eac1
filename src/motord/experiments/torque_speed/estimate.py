"""Mechanical and electrical power over whole turns, losses and efficiency, with uncertainties.

    P_mech = 1/tau int T dtheta,   P_el = 1/tau int u_dc i_dc dt,   P_loss = P_el - P_mech
    motoring: eta = P_mech / P_el,   generating: eta = P_el / P_mech

over the same whole turns, in ticks and in the readings of the electrical power (direct efficiency
determination: IEC 60034-2-1, input-output; with the inverter IEC 60034-2-3).
"""

from dataclasses import dataclass
from math import ceil, pi
from typing import Literal

import numpy as np

from motord.config import AccuracyConfig
from motord.experiments.torque_speed.power_series import PowerSeries
from motord.experiments.torque_speed.result import Mode, OperatingPower, UncertaintyShare
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.experiments.torque_speed.uncertainty import (
    LEAST_BLOCKS,
    ErrorSum,
    sampling_error_W,
    scatter_of,
)
from motord.identification import IdentifyError
from motord.intervals import IntervalEstimate, plus_minus

READINGS_PER_BLOCK = 2
"""Readings of the power that a block of turns has at least."""

LEAST_INPUT = 5.0
"""Input power, in halves of its 95 % interval, below which efficiency is not stated."""

SOURCES = (
    "torque sensor, gain",
    "torque sensor, zero",
    "power reading, gain",
    "power, zero",
    "power reading, resolution",
    "ripple of the bus voltage",
)
"""Sources with limits, as `ErrorSum.rectangular` has them."""

EFFECTS = ("slow readings of the power", "ripple once and twice a turn")
"""Sources with a standard uncertainty, as `ErrorSum.normal` has them."""


@dataclass(frozen=True)
class PowerBlocks:
    """Mean powers (g,) of successive blocks of turns; torque and speed over all of them."""

    mechanical_W: np.ndarray
    electrical_W: np.ndarray
    electrical_mean_W: float
    edges_s: tuple[float, float]
    torque_Nm: float
    speed_rad_s: float
    turns: int
    readings: int
    sampling_W: float
    rounding_W: float
    ripple_W: float
    shaft_ripple_W: float
    in_step: float

    @classmethod
    def of(cls, turns: CapturedTurns, series: PowerSeries, pole_pairs: int) -> "PowerBlocks":
        """Return the blocks that ticks and readings of a capture have in common.

        Only readings that are of nothing but the capture count. Raises IdentifyError.
        """
        inside = series.within(turns.t_s[0], turns.t_s[-1])
        if inside.missing:
            raise IdentifyError(f"no reading of the power for {inside.longest_s:.3g} s")
        edges = turns.between(inside.t_s[0], inside.t_s[-1])
        if edges.size < 2:
            raise IdentifyError("no whole turn with readings of the power")
        turn_s = float(np.diff(turns.t_s[edges]).mean())
        each = ceil(READINGS_PER_BLOCK * inside.period_s / turn_s)
        edges = edges[::each]
        if edges.size <= LEAST_BLOCKS:
            raise IdentifyError(
                f"{edges.size - 1} blocks of turns with {READINGS_PER_BLOCK} readings of the power "
                f"in each, {LEAST_BLOCKS} needed; more turns, or a faster reading"
            )
        edges_s = turns.t_s[edges]
        work_J, angle_rad = turns.work_J[edges], turns.angle_rad[edges]
        turned_rad, seconds_s = angle_rad[-1] - angle_rad[0], edges_s[-1] - edges_s[0]
        return cls(
            mechanical_W=np.diff(work_J) / np.diff(edges_s),
            electrical_W=inside.means_W(edges_s),
            electrical_mean_W=float(inside.means_W(edges_s[[0, -1]])[0]),
            edges_s=(float(edges_s[0]), float(edges_s[-1])),
            torque_Nm=float((work_J[-1] - work_J[0]) / turned_rad),
            speed_rad_s=float(turned_rad / seconds_s),
            turns=each * (edges.size - 1),
            readings=int(np.count_nonzero((inside.t_s >= edges_s[0]) & (inside.t_s < edges_s[-1]))),
            sampling_W=sampling_error_W(turns, inside, edges_s),
            rounding_W=inside.rounding_W,
            ripple_W=inside.ripple_W,
            shaft_ripple_W=turns.shaft_ripple_W(edges),
            in_step=0.0 if series.means else turns.in_step(inside.t_s, pole_pairs),
        )


def operating_power(
    torque_Nm: float,
    speed_Hz: float,
    turns: CapturedTurns,
    series: PowerSeries,
    accuracy: AccuracyConfig,
    pole_pairs: int,
) -> OperatingPower:
    """Return the powers of an operating point with its set-points. Raises IdentifyError."""
    found = PowerBlocks.of(turns, series, pole_pairs)
    budget = _Budget.of(found, accuracy)
    mechanical_W, electrical_W = budget.mechanical_W, budget.electrical_W
    efficiency, reason = budget.efficiency()
    loss = budget.errors(-1.0, 1.0)
    return OperatingPower(
        torque_Nm=torque_Nm,
        speed_Hz=speed_Hz,
        torque_mean_Nm=found.torque_Nm,
        speed_mean_Hz=found.speed_rad_s / (2 * pi),
        mode=budget.mode,
        mechanical=budget.errors(1.0, 0.0).around(mechanical_W),
        electrical=budget.errors(0.0, 1.0).around(electrical_W),
        loss=loss.around(electrical_W - mechanical_W),
        efficiency=efficiency,
        efficiency_reason=reason,
        t_start_ns=turns.t0_ns + round(found.edges_s[0] * 1e9),
        t_end_ns=turns.t0_ns + round(found.edges_s[1] * 1e9),
        turns=found.turns,
        blocks=found.mechanical_W.size,
        readings=found.readings,
        read_every_s=series.period_s,
        sampling_W=found.sampling_W,
        bus_ripple_W=found.ripple_W,
        shaft_ripple_W=found.shaft_ripple_W,
        loss_drift_W=loss.scatter.drift,
        loss_drift_stderr_W=loss.scatter.drift_stderr,
        in_step=found.in_step,
        tick_s=turns.tick_s,
        budget=budget.shares(defined=efficiency.value is not None),
    )


@dataclass(frozen=True)
class _Budget:
    """Errors of linear combinations m P_mech + e P_el, all by the same sources."""

    found: PowerBlocks
    accuracy: AccuracyConfig
    mechanical_W: float
    electrical_W: float

    @classmethod
    def of(cls, found: PowerBlocks, accuracy: AccuracyConfig) -> "_Budget":
        mechanical_W = found.torque_Nm * found.speed_rad_s
        return cls(found, accuracy, mechanical_W, found.electrical_mean_W)

    @property
    def mode(self) -> Mode:
        if self.mechanical_W >= 0:
            return "motoring"
        return "generating" if self.electrical_W < 0 else "braking"

    def errors(self, of_mechanical: float, of_electrical: float) -> ErrorSum:
        """Return the errors of of_mechanical P_mech + of_electrical P_el."""
        a, found = self.accuracy, self.found
        return ErrorSum(
            rectangular=(
                a.torque_gain_percent / 100 * abs(of_mechanical * self.mechanical_W),
                a.torque_zero_Nm * abs(of_mechanical * found.speed_rad_s),
                a.power_gain_percent / 100 * abs(of_electrical * self.electrical_W),
                a.power_zero_W * abs(of_electrical),
                found.rounding_W * abs(of_electrical),
                found.ripple_W * abs(of_electrical),
            ),
            normal=(
                found.sampling_W * abs(of_electrical),
                found.shaft_ripple_W * abs(of_mechanical),
            ),
            scatter=scatter_of(
                of_mechanical * found.mechanical_W + of_electrical * found.electrical_W
            ),
        )

    def _slopes(self) -> tuple[float, float, float]:
        """Return efficiency and its derivatives by mechanical and electrical power."""
        out_W, in_W = self.mechanical_W, self.electrical_W
        if self.mode == "motoring":
            return out_W / in_W, 1 / in_W, -out_W / in_W**2
        return in_W / out_W, -in_W / out_W**2, 1 / out_W

    def efficiency(self) -> tuple[IntervalEstimate, str]:
        """Return the efficiency, or why it is not defined."""
        if self.mode == "braking":
            return (
                IntervalEstimate(),
                "mechanical and electrical power are both taken in: all of it is lost",
            )
        motoring = self.mode == "motoring"
        input_W = self.electrical_W if motoring else self.mechanical_W
        half_width_W = (self.errors(0.0, 1.0) if motoring else self.errors(1.0, 0.0)).half_width
        near_zero = abs(input_W) < LEAST_INPUT * half_width_W
        if near_zero or (motoring and input_W < 0):
            input_is = f"the input power, ({plus_minus(input_W, half_width_W)}) W, is"
            return IntervalEstimate(), f"{input_is} {'near' if near_zero else 'below'} zero"
        value, *slopes = self._slopes()
        return self.errors(*slopes).around(value, 100), ""

    def shares(self, *, defined: bool) -> tuple[UncertaintyShare, ...]:
        """Return what each source contributes to losses and efficiency; defined: it is."""
        loss = _by_source(self.errors(-1.0, 1.0))
        ratio = _by_source(self.errors(*self._slopes()[1:])) if defined else {}
        return tuple(
            UncertaintyShare(name, kind, value, 100 * ratio[name, kind] if defined else None)
            for (name, kind), value in loss.items()
        )


def _by_source(errors: ErrorSum) -> dict[tuple[str, Literal["A", "B"]], float]:
    stderrs = [width / 3**0.5 for width in errors.rectangular]
    return {
        ("scatter of the turns", "A"): errors.scatter.stderr,
        **{(name, "B"): value for name, value in zip(SOURCES, stderrs, strict=True)},
        **{(name, "B"): stderr for name, stderr in zip(EFFECTS, errors.normal, strict=True)},
    }
