"""A rotor that nothing brakes: its inertia, and how fast it will be once its torque is down."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import copysign, inf, pi, sqrt

from motord.config import LimitsConfig
from motord.sequencing.demand import Demand
from motord.sequencing.motions import Fault, Motion, hold, wait
from motord.sequencing.observation import Observation

MARGIN = 0.9
"""Part of the over-speed trip that a free rotor may reach."""

SLOW_RISE_S = 4.0
"""Time over which a torque rises under which no rotor is fast before it is seen: one that comes
loose of friction and cogging torque has little to be accelerated by."""

PROBE_PART = 0.3
"""Part of the over-speed trip to which a rotor is accelerated to find out its inertia."""

MOVING_PART = 0.2
"""Part of that speed from which on it is clear of friction and cogging torque."""

COAST_S = 0.3
"""Time for which the rotor is followed without torque: friction made it seem heavier."""

LIGHTER = 1.4
"""How much lighter the rotor may be than it seemed, by cogging torque."""

FINER = 0.9
"""Between two rates of a torque that are tried."""

SEEN_AFTER_S = 0.09
"""Time after which a speed is noticed that was reached: an observation of 50 ms, half of one as its
speed is a mean, and what the bench is late."""


@dataclass(frozen=True)
class FreeRotor:
    """A rotor, by a torque that rose slowly; breakaway_Nm: under which it came loose."""

    inertia_kg_m2: float
    breakaway_Nm: float

    def rise_s(self, limits: LimitsConfig, torque_Nm: float, to_speed_Hz: float) -> float:
        """Return the shortest rise of a torque, ended at a speed, that keeps from the trip.

        0 for as fast as the bench allows; at most SLOW_RISE_S, which may not be enough.
        """
        rate_Nm_per_s, most_Nm = limits.torque_rate_Nm_per_s, abs(torque_Nm)
        most_rad_s = MARGIN * limits.trip_speed_rad_s
        while self._highest_rad_s(limits, most_Nm, to_speed_Hz, rate_Nm_per_s) > most_rad_s:
            rate_Nm_per_s *= FINER
            if rate_Nm_per_s < most_Nm / SLOW_RISE_S:
                return SLOW_RISE_S
        return most_Nm / rate_Nm_per_s if rate_Nm_per_s < limits.torque_rate_Nm_per_s else 0.0

    def _highest_rad_s(
        self, limits: LimitsConfig, most_Nm: float, to_speed_Hz: float, rate_Nm_per_s: float
    ) -> float:
        """Return the highest speed (rad/s) once a torque that rose at a rate is down again."""
        inertia_kg_m2, to_rad_s = self.inertia_kg_m2 / LIGHTER, 2 * pi * to_speed_Hz
        if inertia_kg_m2 <= 0.0:  # turned by something else than the torque
            return inf
        risen_Nm = sqrt(self.breakaway_Nm**2 + 2 * rate_Nm_per_s * inertia_kg_m2 * to_rad_s)
        end_Nm = min(most_Nm, risen_Nm + rate_Nm_per_s * SEEN_AFTER_S)
        down_s = end_Nm / limits.torque_rate_Nm_per_s
        return to_rad_s + end_Nm * (SEEN_AFTER_S + down_s / 2) / inertia_kg_m2


def raise_torque(
    demand: Demand, over_s: float, until: Callable[[Observation], bool]
) -> Motion[None]:
    """Raise the torque to that of a demand over some time, and hold it until `until`."""
    began = seen = yield None
    while not until(seen):
        part = min(seen.since_s(began) / over_s, 1.0) if over_s else 1.0
        seen = yield replace(demand, torque_Nm=part * demand.torque_Nm)


def probe(demand: Demand, limits: LimitsConfig, to_speed_Hz: float) -> Motion[FreeRotor]:
    """Raise the torque slowly until the rotor turns, let it coast, and return its properties.

    The inertia is of the impulse that accelerated it, to `to_speed_Hz` or PROBE_PART, less friction
    as it coasts.
    """
    to_rad_s = min(2 * pi * to_speed_Hz, PROBE_PART * limits.trip_speed_rad_s)
    began = seen = yield None
    impulse_Nm_s = gained_rad_s = turning_s = breakaway_Nm = 0.0
    while gained_rad_s <= 0.0 or 2 * pi * abs(seen.speed_Hz) < to_rad_s:
        last, part = seen, min(seen.since_s(began) / SLOW_RISE_S, 1.0)
        seen = yield replace(demand, torque_Nm=part * demand.torque_Nm)
        if 2 * pi * abs(last.speed_Hz) < MOVING_PART * to_rad_s:
            impulse_Nm_s = gained_rad_s = turning_s = 0.0
            breakaway_Nm = abs(last.torque_set_Nm)
        else:  # from the middle of a block to that of the next
            impulse_Nm_s += abs(last.torque_set_Nm) * seen.since_s(last)
            gained_rad_s += 2 * pi * (abs(seen.speed_Hz) - abs(last.speed_Hz))
            turning_s += seen.since_s(last)
    free = replace(demand, torque_Nm=0.0)
    yield from hold(free, lambda seen: seen.torque_set_Nm == 0.0)
    begins = yield free
    ends = yield from wait(free, COAST_S)
    lost_rad_s = 2 * pi * (abs(begins.speed_Hz) - abs(ends.speed_Hz))
    friction_rad_s2 = max(lost_rad_s / ends.since_s(begins), 0.0)
    return FreeRotor(impulse_Nm_s / (gained_rad_s + friction_rad_s2 * turning_s), breakaway_Nm)


def runaway(limits: LimitsConfig, torque_Nm: float) -> Fault:
    """Return the fault of each observation by which a rotor under `torque_Nm` will be too fast.

    That is, if the torque is ramped down from the next observation on. Inertia is taken from how
    the speed rose from one observation to the next, and the torque meanwhile.
    """
    before: Observation | None = None

    def too_fast(seen: Observation) -> str:
        nonlocal before
        last, before = before or seen, seen
        along = copysign(1.0, torque_Nm)
        ramped_down = _after_ramp_down(last, seen, limits.torque_rate_Nm_per_s, along)
        most_rad_s = MARGIN * limits.trip_speed_rad_s
        if ramped_down is None or ramped_down[0] < most_rad_s:
            return ""
        then_rad_s, inertia_kg_m2 = ramped_down
        fits_Nm = sqrt(most_rad_s * limits.torque_rate_Nm_per_s * inertia_kg_m2)
        return (
            f"{seen.demand.label}: with {abs(torque_Nm):.3g} Nm the rotor would be at "
            f"{then_rad_s:.3g} rad/s before the torque is ramped down, above {MARGIN:g} of "
            f"[limits] trip_speed_rad_s = {limits.trip_speed_rad_s:g}; lower torque_Nm (about "
            f"{fits_Nm:.2g} Nm ramped up and down at once are the most) or the speed to be reached"
        )

    return too_fast


def _after_ramp_down(
    last: Observation, seen: Observation, rate_Nm_per_s: float, along: float
) -> tuple[float, float] | None:
    """Return the speed after the ramp down (rad/s), and the inertia (kg m^2); None at rest.

    Speeds of observations are means over their steps, torques those at their ends.
    """
    step_s, set_Nm = seen.since_s(last), along * seen.torque_set_Nm
    risen_rad_s = along * 2 * pi * (seen.speed_Hz - last.speed_Hz)
    impulse_Nm_s = along * last.torque_set_Nm * step_s
    if risen_rad_s <= 0.0 or impulse_Nm_s <= 0.0:
        return None
    inertia_kg_m2 = impulse_Nm_s / risen_rad_s
    end_rad_s = along * 2 * pi * seen.speed_Hz + 0.5 * risen_rad_s
    change_Nm = along * seen.demand.torque_Nm - set_Nm
    most_Nm = rate_Nm_per_s * step_s
    next_Nm = set_Nm + min(max(change_Nm, -most_Nm), most_Nm)
    further_Nm_s = max(set_Nm, next_Nm) * step_s + next_Nm**2 / (2 * rate_Nm_per_s)
    return end_rad_s + further_Nm_s / inertia_kg_m2, inertia_kg_m2
