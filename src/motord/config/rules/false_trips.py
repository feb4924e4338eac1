"""What legal operation may trip on legal limits: notes for `motord check`, no reason to refuse."""

from collections.abc import Iterator

from motord.config.bounds import rounded_down
from motord.config.rules.torque import reversal_shows_Nm
from motord.config.rules.tracks import stop_max_rad_s2
from motord.config.sections import Sections
from motord.config.timing import ACCELERATION_RAD_S2


def false_trips(bench: Sections) -> Iterator[str]:
    """Yield which operation would trip though nothing is wrong, and what would help."""
    loop, limits, counts = bench.loop, bench.limits, bench.motor.counts
    stop_rad_s2 = stop_max_rad_s2(bench)
    if stop_rad_s2 < ACCELERATION_RAD_S2:
        yield (
            f"a rotor that stops at more than {rounded_down(stop_rad_s2):g} rad/s^2 may trip "
            f"ENCODER_IMPLAUSIBLE: the observer of [loop] observer_bandwidth_Hz = "
            f"{loop.observer_bandwidth_Hz:g} turns on for more counts of {counts} than a track may "
            "stand still; raise it"
        )
    shown_Nm = reversal_shows_Nm(bench)
    if shown_Nm > limits.trip_torque_Nm:
        tau_s = bench.torque_sensor.highpass_time_constant_s
        yield (
            f"a change from -{limits.torque_Nm:g} to {limits.torque_Nm:g} Nm may trip OVER_TORQUE: "
            f"a torque sensor with a high-pass of {tau_s:g} s shows up to {shown_Nm:.3g} Nm of it "
            f"at [limits] torque_rate_Nm_per_s = {limits.torque_rate_Nm_per_s:g}, and "
            f"trip_torque_Nm is {limits.trip_torque_Nm:g}; lower that rate or torque_Nm"
        )
