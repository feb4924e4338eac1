"""A bench of first-order dynamics for plans: speed follows torque and brake, no kernel, no rig."""

import numpy as np

from motord.config import BrakeConfig
from motord.schema import TICK_DTYPE, State
from motord.sequencing import Demand
from motord.sequencing.brake_servo import brake_torque_Nm

PERIOD_NS = 10_000_000
LOOK_TICKS = 2
COLUMNS = ("tick", "t_ns", "angle_rad", "speed_rad_s", "state", "torque_set_Nm")


class FakeBench:
    """Torque ramps; the brake is slow and `brake_factor` times the configured one."""

    def __init__(self, brake: BrakeConfig, brake_factor: float = 1.0) -> None:
        self.brake, self.brake_factor = brake, brake_factor
        self.rate_Nm_per_s = 10.0
        self.state = State.OFF
        self.trip_bits = 0
        self.obeys = True
        self.torque_Nm = self.speed_rad_s = self.angle_rad = self.excitation = 0.0
        self.fastest_rad_s = 0.0
        self.number = 0
        self.t_ns = 1_700_000_000_000_000_000
        self._demand = Demand()

    def look(self, demand: Demand) -> np.ndarray:
        """Apply `demand` for two ticks and return them."""
        if self.obeys and demand.enabled and not self._demand.enabled:
            self.state = State.ENABLED
        self._demand = demand
        ticks = [self._advance(demand) for _ in range(LOOK_TICKS)]
        block = np.zeros(LOOK_TICKS, TICK_DTYPE)
        for name, column in zip(COLUMNS, zip(*ticks, strict=True), strict=True):
            block[name] = column
        block["trip_bits"], block["plan_point"] = self.trip_bits, demand.plan_point
        return block

    def _advance(self, demand: Demand) -> tuple[float, ...]:
        """Return the COLUMNS of the next tick."""
        dt_s = PERIOD_NS * 1e-9
        self.number += 1
        self.t_ns += PERIOD_NS
        target_Nm = demand.torque_Nm if demand.enabled and self.state is State.ENABLED else 0.0
        step_Nm = self.rate_Nm_per_s * dt_s
        self.torque_Nm += min(max(target_Nm - self.torque_Nm, -step_Nm), step_Nm)
        if self.state is State.ENABLED and not demand.enabled and self.torque_Nm == 0.0:
            self.state = State.READY
        self.excitation += (demand.brake - self.excitation) * dt_s / 0.2
        for _ in range(5):
            load_Nm = self.brake_factor * brake_torque_Nm(
                self.brake, self.excitation, self.speed_rad_s
            )
            net_Nm = self.torque_Nm - load_Nm - 0.01 * self.speed_rad_s
            self.speed_rad_s = max(self.speed_rad_s + net_Nm / 0.0105 * dt_s / 5, 0.0)
        self.fastest_rad_s = max(self.fastest_rad_s, self.speed_rad_s)
        self.angle_rad += self.speed_rad_s * dt_s
        angle_rad = self.angle_rad % (2 * np.pi)
        return self.number, self.t_ns, angle_rad, self.speed_rad_s, self.state, self.torque_Nm
