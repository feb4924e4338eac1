"""A bench without physics: ticks as functions of their number, for tests of the page alone."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motord.schema import TICK_DTYPE, Flag, State

POLE_PAIRS = 8
RIPPLE_Nm = {2: 0.025, 6: 0.03, 16: 0.09, 24: 0.05, 48: 0.17, 96: 0.05}
"""Amplitude of the torque at orders of the turn; what compensation leaves is a tenth."""
CALIBRATED = 48, 96, 24
AMPERE_PER_Nm = 1 / (1.5 * 0.206)
RATE_Nm_per_s = 4.0
SPEED_TIME_CONSTANT_s = 0.5


@dataclass
class SyntheticBench:
    """Set-points follow their targets by ramps; `spike_Nm` is put on top of the next tick alone."""

    rate_Hz: float
    state: State = State.OFF
    torque_target_Nm: float = 0.0
    torque_Nm: float = 0.0
    speed_target_Hz: float = 0.0
    speed_Hz: float = 0.0
    ripple_share: float = 1.0
    spike_Nm: float = 0.0
    trip_bits: int = 0
    missed: int = 0
    tick: int = 0
    angle_rad: float = 1.0
    newest: dict[str, Any] = field(default_factory=dict)
    _rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(13))

    def ticks(self, count: int, t_ns: int) -> NDArray[Any]:
        """Return the next ticks (count,), the last one at `t_ns` (Unix)."""
        out = np.zeros(count, TICK_DTYPE)
        dt_s = 1 / self.rate_Hz
        back = np.arange(count - 1, -1, -1)
        out["t_ns"] = t_ns - (back * (dt_s * 1e9)).astype(np.int64)
        out["tick"] = self.tick + np.arange(count)
        self.tick += count
        torque_Nm, speed_Hz = self._ramps(count, dt_s)
        angle_rad = self.angle_rad + np.cumsum(2 * np.pi * speed_Hz * dt_s)
        self.angle_rad = float(angle_rad[-1]) % (2 * np.pi)
        out["angle_rad"] = angle_rad % (2 * np.pi)
        out["speed_rad_s"] = 2 * np.pi * speed_Hz * (1 + 0.003 * self._rng.standard_normal(count))
        out["speed_set_rad_s"] = 2 * np.pi * self.speed_target_Hz
        self._currents(out, torque_Nm, angle_rad)
        self._torque(out, torque_Nm, angle_rad, speed_Hz)
        self._rest(out)
        self.newest = {name: out[name][-1].item() for name in TICK_DTYPE.names}
        return out

    def _ramps(self, count: int, dt_s: float) -> tuple[NDArray[Any], NDArray[Any]]:
        step = np.arange(1, count + 1) * dt_s
        if self.state is not State.ENABLED:
            self.torque_Nm = self.torque_target_Nm = self.speed_target_Hz = 0.0
        off_Nm = self.torque_target_Nm - self.torque_Nm
        torque_Nm = self.torque_Nm + np.sign(off_Nm) * np.minimum(RATE_Nm_per_s * step, abs(off_Nm))
        decay = np.exp(-step / SPEED_TIME_CONSTANT_s)
        speed_Hz = self.speed_target_Hz + (self.speed_Hz - self.speed_target_Hz) * decay
        self.torque_Nm, self.speed_Hz = float(torque_Nm[-1]), float(speed_Hz[-1])
        return torque_Nm, speed_Hz

    def _currents(self, out: NDArray[Any], torque_Nm: Any, angle_rad: Any) -> None:
        for phase, name in enumerate("abc"):
            shape = np.sin(POLE_PAIRS * angle_rad - phase * 2 * np.pi / 3)
            command = AMPERE_PER_Nm * torque_Nm * shape
            out[f"i_cmd_{name}_A"] = command
            noise = 0.04 * self._rng.standard_normal(len(out))
            out[f"i_{name}_A"] = command * (1.04, 0.98, 0.99)[phase] + noise

    def _torque(self, out: NDArray[Any], torque_Nm: Any, angle_rad: Any, speed_Hz: Any) -> None:
        share = (0.3 + 0.14 * torque_Nm) * self.ripple_share * (np.abs(speed_Hz) > 0.02)
        ripple_Nm = sum(a * np.sin(n * angle_rad + n) for n, a in RIPPLE_Nm.items()) * share
        out["torque_Nm"] = torque_Nm + ripple_Nm + 0.004 * self._rng.standard_normal(len(out))
        out["torque_Nm"][-1] += self.spike_Nm
        self.spike_Nm = 0.0
        out["torque_set_Nm"] = torque_Nm

    def _rest(self, out: NDArray[Any]) -> None:
        out["state"] = self.state
        out["flags"] = Flag.NEW_ENCODER | Flag.NEW_INVERTER | Flag.SIMULATED
        out["trip_bits"] = out["first_trip"] = self.trip_bits
        out["missed"] = self.missed
        out["u_bus_V"] = 24.0
        out["temperature_C"] = 31.5
        out["brake_temperature_C"] = np.nan
        out["brake_set"] = 0.1 * self.torque_Nm
        out["plan_point"] = -1
        out["sample_age_ns"] = 120_000
        out["i_age_ns"] = 400_000
        out["wake_late_ns"] = self._rng.lognormal(9.6, 0.35, len(out))
        out["work_ns"] = self._rng.lognormal(10.4, 0.18, len(out))
