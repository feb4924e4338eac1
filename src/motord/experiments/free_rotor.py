"""A rotor that nothing brakes: how fast it will be once its torque has ramped down."""

from math import copysign, pi, sqrt

from motord.config import LimitsConfig
from motord.sequencing.motions import Fault
from motord.sequencing.observation import Observation

MARGIN = 0.9
"""Part of the over-speed trip that a free rotor may reach."""


def runaway(limits: LimitsConfig, torque_Nm: float) -> Fault:
    """Return what says of each observation whether a rotor under `torque_Nm` will be too fast.

    That is, if the torque is ramped down from the next observation on. Inertia is taken from how
    the speed rose from one observation to the next, and the torque meanwhile.
    """
    before: Observation | None = None

    def too_fast(seen: Observation) -> str:
        nonlocal before
        last, before = before or seen, seen
        then = _speed_then(last, seen, limits.torque_rate_Nm_per_s, copysign(1.0, torque_Nm))
        most_rad_s = MARGIN * limits.trip_speed_rad_s
        if then is None or then[0] < most_rad_s:
            return ""
        then_rad_s, inertia_kg_m2 = then
        fits_Nm = sqrt(most_rad_s * limits.torque_rate_Nm_per_s * inertia_kg_m2)
        return (
            f"{seen.demand.label}: with {abs(torque_Nm):.3g} Nm the rotor would be at "
            f"{then_rad_s:.3g} rad/s before the torque is ramped down, and [limits] "
            f"trip_speed_rad_s = {limits.trip_speed_rad_s:g}; lower torque_Nm: about "
            f"{fits_Nm:.2g} Nm ramped up and down at once are the most"
        )

    return too_fast


def _speed_then(
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
