"""What a bench file may ask for without an interlock losing its stated time.

Each field has a range of its own; here are the ranges, and the rules between several fields. A
bench file that asks for more is refused with the reason.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motord.config.bench import Config

RATE_MIN_HZ, RATE_MAX_HZ = 100, 20_000
"""Of the loop and of the bridge's samples."""
SILENCE_MAX_S = 1.0
"""No link and no process may be silent for longer without the torque being taken away: the rotor
would be driven by what nobody commands any more."""
RAMP_DOWN_MAX_S = 1.0
"""From [limits] torque_Nm to zero, however gentle torque_rate_Nm_per_s is."""
DELAY_MAX_S = 0.02
"""Of the inverter: the angle where its current flows is predicted over this time."""
JUMP_MAX_RAD = math.pi / 2
"""No spacing of samples makes a larger jump of the encoder plausible: from half a turn on, the
direction is a guess."""
TURN_PER_SAMPLE_MAX_RAD = math.pi / 4
"""The rotor may turn so far from sample to sample at the speed limit: a speed well beyond it still
differs from a slower one in the other direction."""
INTERVALS_MIN = 2
"""Intervals that must pass before silence is a fault: one message may be lost."""


def sample_interval_s(config: "Config") -> float:
    """Return the time between two samples of the bridge as the loop sees them."""
    loop_Hz = config.loop.rate_Hz
    return 1.0 / min(loop_Hz, config.bridge.rate_Hz or loop_Hz)


def refused(config: "Config") -> Iterator[str]:
    """Yield for every rule that `config` breaks what is wrong and what would be right."""
    yield from _silence(config)
    yield from _position(config)


def _silence(config: "Config") -> Iterator[str]:
    loop_Hz, period_s, interval_s = (
        config.loop.rate_Hz,
        1.0 / config.loop.rate_Hz,
        sample_interval_s(config),
    )
    for name, limit_s, between_s, what in (
        ("[bridge] stale_after_s", config.bridge.stale_after_s, interval_s, "samples come"),
        ("[inverter] stale_after_s", config.inverter.stale_after_s, period_s, "feedback comes"),
        ("[inverter] timeout_s", config.inverter.timeout_s, period_s, "commands come"),
        ("[bridge] heartbeat_timeout_s", config.bridge.heartbeat_timeout_s, period_s,
         "heartbeats come"),
    ):  # fmt: skip
        if limit_s < (1.0 - 1e-9) * INTERVALS_MIN * between_s:
            yield (
                f"{name} = {limit_s:g} is too short: {what} every {between_s:g} s, and one may be "
                f"lost; make it at least {INTERVALS_MIN * between_s:g}, or raise the rates"
            )
    patience_s = config.bench.rig_patience_s
    if patience_s is not None and patience_s < (1.0 - 1e-9) * INTERVALS_MIN * period_s:
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


def _position(config: "Config") -> Iterator[str]:
    limits, counts, interval_s = config.limits, config.motor.counts, sample_interval_s(config)
    if limits.encoder_jump_rad <= 2 * math.pi / counts:
        yield (
            f"[limits] encoder_jump_rad = {limits.encoder_jump_rad:g} is not above one point of "
            f"an encoder with counts = {counts}, so every step would be implausible; make it more "
            f"than {2 * math.pi / counts:.3g}"
        )
    most_rad_s = TURN_PER_SAMPLE_MAX_RAD / interval_s
    if limits.trip_speed_rad_s > most_rad_s:
        yield (
            f"[limits] trip_speed_rad_s = {limits.trip_speed_rad_s:g} is too fast for "
            f"{1 / interval_s:g} encoder samples a second: the rotor would turn "
            f"{limits.trip_speed_rad_s * interval_s:.2g} rad from one to the next; make it at most "
            f"{most_rad_s:.3g}, or raise [bridge] rate_Hz and [loop] rate_Hz"
        )
