"""What must hold so that interlocks of the loop keep their stated times and trip for a reason."""

import math
from collections.abc import Iterator

from motord.config.rules.bounds import is_below, rounded_down
from motord.config.rules.encoder import (
    a_sound_encoder_never_jumps,
    position_is_unambiguous,
    speed_is_resolved,
)
from motord.config.sections import LimitsConfig, Sections
from motord.config.timing import (
    DELAY_MAX_S,
    INTERVALS_MIN,
    SETTLING_LAGS,
    SILENCE_MAX_S,
    TORQUE_SHARE,
)

DEAD_PHASE = math.sqrt(3.0) / 2.0


def timeouts_outlast_a_lost_message(config: Sections) -> Iterator[str]:
    """Every timeout spans INTERVALS_MIN intervals of what it watches, and none SILENCE_MAX_S."""
    loop_Hz, period_s = config.loop.rate_Hz, 1.0 / config.loop.rate_Hz
    for name, limit_s, interval_s, what in (
        ("[bridge] stale_after_s", config.bridge.stale_after_s, config.sample_interval_s,
         "samples come"),
        ("[inverter] stale_after_s", config.inverter.stale_after_s, period_s, "feedback comes"),
        ("[inverter] timeout_s", config.inverter.timeout_s, period_s, "commands come"),
        ("[bridge] heartbeat_timeout_s", config.bridge.heartbeat_timeout_s, period_s,
         "heartbeats come"),
    ):  # fmt: skip
        if is_below(limit_s, INTERVALS_MIN * interval_s):
            yield (
                f"{name} = {limit_s:g} is too short: {what} every {interval_s:g} s, and one may be "
                f"lost; make it at least {INTERVALS_MIN * interval_s:g}, or raise the rates"
            )
    inverter = config.inverter
    least_s = inverter.feedback_age_s + INTERVALS_MIN * period_s
    if inverter.feedback_age_s and is_below(inverter.stale_after_s, least_s):
        yield (
            f"[inverter] stale_after_s = {inverter.stale_after_s:g} is too short for feedback that "
            f"is feedback_age_s = {inverter.feedback_age_s:g} old when it comes: it would always "
            f"be stale; make it at least {least_s:g}"
        )
    patience_s = config.bench.rig_patience_s
    if patience_s is not None and is_below(patience_s, INTERVALS_MIN * period_s):
        yield (
            f"[bench] rig_patience_s = {patience_s:g} is too short: commands come every "
            f"{period_s:g} s, and the rig's time would stand still between them; make it at least "
            f"{INTERVALS_MIN * period_s:g}, or leave it out"
        )
    overrun_s = config.loop.overrun_ticks / loop_Hz
    if overrun_s > SILENCE_MAX_S:
        yield (
            f"[loop] overrun_ticks = {config.loop.overrun_ticks} at rate_Hz = {loop_Hz} lets the "
            f"loop stand still for {overrun_s:g} s before it is a fault; make it at most "
            f"{round(SILENCE_MAX_S * loop_Hz)} ({SILENCE_MAX_S:g} s)"
        )


def errors_last_longer_than_they_may(config: Sections) -> Iterator[str]:
    """What is normal for a while is no fault: a step on its way, one sample, one lost frame."""
    limits, inverter = config.limits, config.inverter
    period_s, sample_s = 1.0 / config.loop.rate_Hz, config.sample_interval_s
    for name, given_s, least_s, why in (
        ("[limits] current_error_s", limits.current_error_s, period_s,
         f"it would act as one period of {period_s:g} s does, in which feedback comes once"),
        ("[limits] torque_error_s", limits.torque_error_s,
         inverter.settling_s + period_s + sample_s,
         "a step of the torque would trip before it shows, after [inverter] actuation_delay_s, "
         f"{SETTLING_LAGS} lag_s, a tick and a sample"),
        ("[loop] enable_timeout_s", config.loop.enable_timeout_s,
         DELAY_MAX_S + INTERVALS_MIN * max(period_s, sample_s),
         "no drive and no enable line could be ready so soon, and say so in a message of "
         "which one may be lost"),
    ):  # fmt: skip
        if is_below(given_s, least_s):
            yield f"{name} = {given_s:g} is too short: {why}; make it at least {least_s:g}"
    frames_per_s = config.loop.rate_Hz + config.sample_rate_Hz
    if limits.link_errors_per_s > frames_per_s:
        yield (
            f"[limits] link_errors_per_s = {limits.link_errors_per_s:g} lets more frames be lost "
            f"than the loop needs, {frames_per_s:g} of feedback and samples in a second; make it "
            "less"
        )


def dead_sensor_error_Nm(limits: LimitsConfig, highpass_time_constant_s: float) -> float:
    """Return the torque_error_Nm below which a torque sensor that stays at zero trips for sure.

    At the set-point T up to torque_Nm that shows it best; a share of T is allowed anyway. A
    high-pass of the sensor with the time constant tau leaves r tau (1 - exp(-T / (r tau))) of it
    when it is reached at the rate r, and exp(-t / tau) of that after the time t that the error may
    last. Their difference is largest at T = r tau ln(exp(-t / tau) / share).
    """
    tau_s, most_Nm = highpass_time_constant_s, limits.torque_Nm
    if not tau_s:
        return (1.0 - TORQUE_SHARE) * most_Nm
    ramp_Nm, lasting = limits.torque_rate_Nm_per_s * tau_s, math.exp(-limits.torque_error_s / tau_s)
    if lasting <= TORQUE_SHARE:
        return 0.0
    best_Nm = min(ramp_Nm * math.log(lasting / TORQUE_SHARE), most_Nm)
    return -ramp_Nm * math.expm1(-best_Nm / ramp_Nm) * lasting - TORQUE_SHARE * best_Nm


def what_is_dead_is_beyond_its_limit(config: Sections) -> Iterator[str]:
    """A drive without any current trips at full current, and a sensor at zero at full torque.

    Of three currents 120 degrees apart the largest is at least DEAD_PHASE of their amplitude. What
    a high-pass hides of the torque, and limits below those, is for `motord check` to name.
    """
    limits = config.limits
    most_A = DEAD_PHASE * limits.current_A
    if not is_below(limits.greatest_current_error_A, most_A):
        yield (
            f"[limits] current_error_A = {limits.current_error_A:g} is too large: a drive without "
            f"any current would seem to follow current_A = {limits.current_A:g}; make it less than "
            f"{rounded_down(most_A):g}"
        )
    most_Nm = dead_sensor_error_Nm(limits, 0.0)
    if not is_below(limits.greatest_torque_error_Nm, most_Nm):
        yield (
            f"[limits] torque_error_Nm = {limits.torque_error_Nm:g} is too large: a torque sensor "
            f"that stays at zero would seem to show torque_Nm = {limits.torque_Nm:g}, of which a "
            f"fifth is allowed besides; make it less than {rounded_down(most_Nm):g}"
        )


def interlocks_keep_their_times(config: Sections) -> Iterator[str]:
    """No setting lets an interlock lose its stated time, or trip where nothing is wrong."""
    yield from timeouts_outlast_a_lost_message(config)
    yield from position_is_unambiguous(config)
    yield from speed_is_resolved(config)
    yield from a_sound_encoder_never_jumps(config)
    yield from errors_last_longer_than_they_may(config)
    yield from what_is_dead_is_beyond_its_limit(config)
