"""Ticks of a capture: whole turns, the work over each, and what power does within a turn."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.config import MotorConfig
from motord.identification import IdentifyError
from motord.identification.encoder_ticks import countable_ticks
from motord.identification.operating_points import PointData
from motord.identification.resample import rising
from motord.identification.signal_condition import SignalFault, recorded, require_sound
from motord.identification.turning import continuous_turns
from motord.schema import rows_of

REQUIRED = ("t_ns", "encoder_count", "torque_Nm")
COLUMNS = (*REQUIRED, "u_bus_V", "tick", "plan_point")
"""Columns of the tick that the analysis reads, where the recording has them."""

RIPPLE_ORDERS = (1, 2, 6)
"""Electrical orders of the ripple that offsets, gains and switching losses make."""

SHAFT_ORDERS = (1, 2)
"""Orders per turn of an encoder that is eccentric or oval, and of a misaligned coupling."""

SECTORS = 512
"""Parts of a turn in which the power is averaged over the turns."""


@dataclass(frozen=True)
class CapturedTurns:
    """Samples (n,) of a capture, in time order; edges: the first of each whole turn, and its end.

    t_s: since t0_ns; angle_rad: running on, positive forwards. faults: samples left out.
    """

    t0_ns: int
    t_s: np.ndarray
    angle_rad: np.ndarray
    torque_Nm: np.ndarray
    edges: np.ndarray
    faults: tuple[SignalFault, ...] = ()

    @classmethod
    def of(cls, point: PointData, motor: MotorConfig) -> "CapturedTurns":
        """Return the turns of an operating point. Raises IdentifyError."""
        label, names = point.label, point.ticks.dtype.names
        if missing := [name for name in REQUIRED if name not in (names or ())]:
            raise IdentifyError(f"{label}: the recording has no {', '.join(missing)}")
        good = rising(point.ticks["t_ns"]) & recorded(point.ticks["torque_Nm"], "torque_Nm", label)
        ticks, position, faults = countable_ticks(rows_of(point.ticks, good), motor.counts, label)
        count = ticks["encoder_count"].astype(np.int64)
        turns = continuous_turns(position, motor.counts, label, from_start=point.turns_from_start)
        t0_ns = int(ticks["t_ns"][0])
        t_s = (ticks["t_ns"].astype(np.int64) - t0_ns) * 1e-9
        angle_rad = 2 * np.pi / motor.counts * position
        torque_Nm = ticks["torque_Nm"].astype(float)
        require_sound({"torque_Nm": torque_Nm}, count, motor.counts, len(turns), label)
        edges = np.array([turns[0][0], *(end for _, end in turns)])
        edges = edges[edges < t_s.size]  # the last turn may end with the capture
        return cls(t0_ns, t_s, angle_rad, torque_Nm, edges, faults)

    @cached_property
    def tick_s(self) -> float:
        """Time between samples, the median (s)."""
        return float(np.median(np.diff(self.t_s)))

    @cached_property
    def work_J(self) -> np.ndarray:
        """Work of the torque since the first sample (n,): its integral over the angle."""
        mean_Nm = 0.5 * (self.torque_Nm[1:] + self.torque_Nm[:-1])
        return np.concatenate([[0.0], np.cumsum(mean_Nm * np.diff(self.angle_rad))])

    @cached_property
    def course_W(self) -> np.ndarray:
        """Torque times mean speed: what of it repeats every turn, and its trend (n,)."""
        turned_rad = self.angle_rad[-1] - self.angle_rad[0]
        power_W = self.torque_Nm * turned_rad / (self.t_s[-1] - self.t_s[0])
        first, end = self.edges[0], self.edges[-1]
        sector = np.floor(self.angle_rad / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
        inside = slice(first, end)
        trend = np.polynomial.Polynomial.fit(self.t_s[inside], power_W[inside], 1)(self.t_s)
        total = np.bincount(sector[inside], (power_W - trend)[inside], SECTORS)
        number = np.bincount(sector[inside], minlength=SECTORS)
        known = number > 0
        over_turn = np.interp(
            np.arange(SECTORS), np.flatnonzero(known), total[known] / number[known]
        )
        return np.asarray(trend + over_turn[sector])

    def shaft_ripple_W(self, edges: np.ndarray) -> float:
        """Return what torque and speed that ripple together at SHAFT_ORDERS make of the power.

        Over the whole turns whose first samples, and end, are edges (g,). Of an encoder that is
        off by e sin(m theta) the speed seems to ripple by m e w cos(m theta); of a misaligned
        coupling the sensor shows a torque that does no work.
        """
        inside = slice(int(edges[0]), int(edges[-1]))
        even_rad = np.interp(self.t_s[inside], self.t_s[edges], self.angle_rad[edges])
        speed_rad_s = np.ptp(even_rad) / np.ptp(self.t_s[inside])
        total_W = 0.0
        for order in SHAFT_ORDERS:
            wave = np.exp(-1j * order * even_rad)
            torque_Nm = 2 * np.mean(self.torque_Nm[inside] * wave)
            off_rad = 2 * np.mean((self.angle_rad[inside] - even_rad) * wave)
            ripple_rad_s = 1j * order * speed_rad_s * off_rad
            total_W += abs(float((torque_Nm * ripple_rad_s.conjugate()).real)) / 2
        return total_W

    def in_step(self, at_s: np.ndarray, pole_pairs: int) -> float:
        """Return how far instants (m,) fall on the same electrical angles: 0 evenly, 1 on one.

        The largest over the orders that errors of currents and losses have.
        """
        angle_rad = pole_pairs * np.interp(at_s, self.t_s, self.angle_rad)
        return max(float(abs(np.exp(1j * order * angle_rad).mean())) for order in RIPPLE_ORDERS)

    def between(self, begin_s: float, end_s: float) -> np.ndarray:
        """Return the first samples of the turns, and the last one's end, within a time (m,)."""
        at_s = self.t_s[self.edges]
        return np.asarray(self.edges[(at_s >= begin_s) & (at_s <= end_s)])
