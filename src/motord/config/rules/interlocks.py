"""What must hold so that interlocks of the loop keep their stated times and trip for a reason."""

import math
from collections.abc import Iterator

from motord.config.bounds import SettingBound
from motord.config.rules.encoder import (
    a_sound_encoder_never_jumps,
    the_encoder_shows_the_greatest_speed,
)
from motord.config.rules.torque import (
    counts_resolve_the_limits,
    dead_sensor_error_Nm,
    no_set_point_is_an_error,
)
from motord.config.sections import Sections
from motord.config.timing import DELAY_MAX_S, INTERVALS_MIN, SILENCE_MAX_S

DEAD_PHASE = math.sqrt(3.0) / 2.0


def timeouts_outlast_a_lost_message(config: Sections) -> Iterator[str]:
    """Every timeout spans INTERVALS_MIN intervals of what it watches, and none SILENCE_MAX_S."""
    bridge, inverter, patience_s = config.bridge, config.inverter, config.bench.rig_patience_s
    period_s, sample_s = 1.0 / config.loop.rate_Hz, config.sample_interval_s
    overrun_ticks, age_s = config.loop.overrun_ticks, inverter.feedback_age_s
    raised, lost, aged = (
        "raise the rates",
        "and one may be lost",
        f"{age_s:g} s old (feedback_age_s)",
    )
    feedback = f"feedback comes every {period_s:g} s, {aged + ', ' if age_s else ''}{lost}"
    feedback_raised = raised
    if inverter.stale_after_s <= age_s:
        feedback, feedback_raised = f"feedback comes {aged}: always stale", ""
    for name, given_s, least_s, why, remedy in (
        ("[bridge] stale_after_s", bridge.stale_after_s, INTERVALS_MIN * sample_s,
         f"samples come every {sample_s:g} s, {lost}", raised),
        ("[inverter] stale_after_s", inverter.stale_after_s, age_s + INTERVALS_MIN * period_s,
         feedback, feedback_raised),
        ("[inverter] timeout_s", inverter.timeout_s, INTERVALS_MIN * period_s,
         f"commands come every {period_s:g} s, {lost}", raised),
        ("[bridge] heartbeat_timeout_s", bridge.heartbeat_timeout_s, INTERVALS_MIN * period_s,
         f"heartbeats come every {period_s:g} s, {lost}", raised),
    ):  # fmt: skip
        yield from SettingBound(
            name, given_s, "at least", least_s, "too short", why, remedy, SILENCE_MAX_S
        ).refusal()
    yield from SettingBound(
        "[bench] rig_patience_s", math.inf if patience_s is None else patience_s, "at least",
        INTERVALS_MIN * period_s, "too short", f"commands come every {period_s:g} s, and the "
        "rig's time would stand still between them", "leave it out",
    ).refusal()  # fmt: skip
    yield from SettingBound(
        "[loop] overrun_ticks", overrun_ticks, "at most",
        math.floor(SILENCE_MAX_S * config.loop.rate_Hz), "too large",
        f"at rate_Hz = {config.loop.rate_Hz:g} the loop could stand still for "
        f"{overrun_ticks * period_s:g} s before it is a fault, and {SILENCE_MAX_S:g} s is the most",
    ).refusal()  # fmt: skip


def errors_last_longer_than_they_may(config: Sections) -> Iterator[str]:
    """What is normal for a while is no fault: one sample, one lost frame."""
    limits, age_s = config.limits, config.inverter.feedback_age_s
    period_s, sample_s = 1.0 / config.loop.rate_Hz, config.sample_interval_s
    for name, given_s, least_s, why in (
        ("[limits] current_error_s", limits.current_error_s, period_s,
         f"it would act as one period of {period_s:g} s does, in which feedback comes once"),
        ("[loop] enable_timeout_s", config.loop.enable_timeout_s,
         DELAY_MAX_S + max(age_s + INTERVALS_MIN * period_s,
                           INTERVALS_MIN * sample_s),
         "no drive and no enable line could be ready so soon, and say so in a message of "
         "which one may be lost" + (", as old as [inverter] feedback_age_s" * (age_s > 0))),
    ):  # fmt: skip
        yield from SettingBound(name, given_s, "at least", least_s, "too short", why).refusal()
    yield from SettingBound(
        "[limits] link_errors_per_s", limits.link_errors_per_s, "at most",
        config.loop.rate_Hz + config.sample_rate_Hz, "too large",
        f"it lets more frames be lost than the loop needs in a second, {config.loop.rate_Hz:g} of "
        f"feedback and {config.sample_rate_Hz:g} samples",
    ).refusal()  # fmt: skip


def what_is_dead_is_beyond_its_limit(config: Sections) -> Iterator[str]:
    """A drive without any current trips at full current, and a sensor at zero at full torque.

    Of three currents 120 degrees apart the largest is at least DEAD_PHASE of their amplitude. What
    a high-pass hides of the torque, and limits below those, is for `motord check` to name.
    """
    limits = config.limits
    yield from SettingBound(
        "[limits] current_error_A", limits.greatest_current_error_A, "less than",
        DEAD_PHASE * limits.current_A, "too large",
        f"a drive without any current would seem to follow current_A = {limits.current_A:g}",
    ).refusal()  # fmt: skip
    yield from SettingBound(
        "[limits] torque_error_Nm", limits.greatest_torque_error_Nm, "less than",
        dead_sensor_error_Nm(limits, 0.0, 0.0), "too large",
        "a torque sensor that stays at zero would seem to show torque_Nm = "
        f"{limits.torque_Nm:g}, of which a fifth is allowed besides",
    ).refusal()  # fmt: skip


def interlocks_keep_their_times(config: Sections) -> Iterator[str]:
    """No setting lets an interlock lose its stated time, or trip where nothing is wrong."""
    yield from timeouts_outlast_a_lost_message(config)
    yield from the_encoder_shows_the_greatest_speed(config)
    yield from a_sound_encoder_never_jumps(config)
    yield from errors_last_longer_than_they_may(config)
    yield from no_set_point_is_an_error(config)
    yield from what_is_dead_is_beyond_its_limit(config)
    yield from counts_resolve_the_limits(config)
