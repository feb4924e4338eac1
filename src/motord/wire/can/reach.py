"""Whether a drive's signals reach as far as the limits of the bench, and its frames are its own.

What goes beyond a signal's range saturates. A sensed current that saturates below the limit at
which it trips would never trip; a value that disables, saturated, could be the one that enables.
"""

import math
from collections.abc import Iterator

from motord.config import Config, ConfigError
from motord.config.bounds import is_below, rounded_up
from motord.config.timing import DELAY_MAX_S, INTERVALS_MIN, SILENCE_MAX_S, SLOW_FEEDBACK_MAX_S
from motord.wire.can.codec import InverterCodec
from motord.wire.can.frame_format import SYNC, heartbeat, nmt_start

STEP_MAX = 0.02
"""Of [limits] current_A, between two currents that can be commanded: they are rounded."""
_DQ_PER_PHASE = 2.0 / math.sqrt(3.0)
"""Largest length along d and q of currents in a star none of which is above 1."""


def check(codec: InverterCodec, config: Config) -> None:
    """Raise ConfigError for a drive whose signals do not reach the limits of its bench."""
    can = config.inverter.can
    assert can is not None  # a rule of the bench file
    for rule in (_commands, _feedback, _words, _cycles, _same_identifiers):
        for problem in rule(codec, config):
            raise ConfigError(f"{can.dbc}: [inverter.can.signals] {problem}")


def _commands(codec: InverterCodec, config: Config) -> Iterator[str]:
    command, signals, limit_A = codec.command, codec.signals, config.limits.current_A
    largest, of = limit_A, f"[limits] current_A = {limit_A:g}"
    if signals.rotating:
        largest *= _DQ_PER_PHASE * config.inverter.dq.scale
        of += f" with [inverter.dq] scale = {config.inverter.dq.scale:g}"
    for slot in command.slots:
        low, high, step = command.steps(slot)
        if slot == "enable":
            values = (signals.command_enable_value, signals.command_disable_value)
            if not all(low <= value <= high for value in values):
                yield (
                    f"command_enable_value and command_disable_value must be within {low:g} to "
                    f"{high:g}, which is what {signals.command_enable} can hold"
                )
        elif not low <= -largest <= largest <= high or step > STEP_MAX * largest:
            yield (
                f"command: the signal of {slot} holds {low:g} to {high:g} in steps of {step:g}; "
                f"{of} needs {-largest:g} to {largest:g} in steps of {STEP_MAX * largest:g} at "
                "most: take another DBC, or another current_A"
            )


def _feedback(codec: InverterCodec, config: Config) -> Iterator[str]:
    limits = config.limits
    current = ("trip_current_A", -limits.trip_current_A, limits.trip_current_A)
    scale = config.inverter.dq.scale
    along = (
        f"{current[0]} with [inverter.dq] scale = {scale:g}",
        -scale * current[2],
        scale * current[2],
    )
    bus = ("bus_V_min to bus_V_max", limits.bus_V_min or math.inf, limits.bus_V_max)
    hot = ("trip_temperature_C", math.inf, limits.trip_temperature_C)
    needs = {"u_bus_V": bus, "temperature_C": hot, "i_d_A": along, "i_q_A": along}
    needs |= dict.fromkeys(("i_a_A", "i_b_A", "i_c_A"), current)
    for message in codec.feedback:
        for slot in message.slots:
            if slot not in needs:
                continue
            (low, high, _), (name, below, above) = message.steps(slot), needs[slot]
            if not (low < below and above < high):
                yield (
                    f"feedback: {message.name} says {low:g} to {high:g} as {slot}, so that "
                    f"[limits] {name} could never trip: take another DBC, or limits within it"
                )


def _words(codec: InverterCodec, _config: Config) -> Iterator[str]:
    signals = codec.signals
    for message in codec.feedback:
        if "status" not in message.slots:
            continue
        low, high, _ = message.steps("status")
        bits = max(int(high), -int(low) - 1).bit_length() + (low < 0)
        for name in ("ready", "fault", "timeout", "enable_line"):
            mask: int = getattr(signals, f"status_{name}_mask")
            if mask >> bits:
                yield (
                    f"status_{name}_mask = {mask} has bits beyond the {bits} of "
                    f"{signals.feedback_status}, so that they are never set; 0: it does not say"
                )


def _cycles(codec: InverterCodec, config: Config) -> Iterator[str]:
    """Yield timeouts that are over although messages come as often as the DBC states."""
    can, inverter = config.inverter.can, config.inverter
    assert can is not None
    for message in codec.feedback:
        if not message.cycle_s:
            continue
        age_s, least_s = inverter.feedback_age_s, INTERVALS_MIN * message.cycle_s
        fast = any(slot.startswith("i_") for slot in message.slots)
        waits = [
            ("[inverter] stale_after_s", inverter.stale_after_s, least_s + age_s, SILENCE_MAX_S)
            if fast
            else (
                *("[inverter.can] slow_stale_after_s", can.slow_stale_after_s),
                *(least_s, SLOW_FEEDBACK_MAX_S),
            )
        ]
        if "status" in message.slots:
            enabled_s = config.loop.enable_timeout_s
            first_s = DELAY_MAX_S + age_s + least_s
            waits.append(("[loop] enable_timeout_s", enabled_s, first_s, math.inf))
        for name, given_s, needed_s, most_s in waits:
            if is_below(given_s, needed_s):
                remedy = "have the drive send it more often, and correct the DBC, which states that"
                if rounded_up(needed_s) <= most_s:
                    remedy += f"; or make it at least {rounded_up(needed_s):g}"
                yield (
                    f"feedback: {message.name} comes every {message.cycle_s:g} s "
                    f"(GenMsgCycleTime), and one may be lost, so that {name} = {given_s:g} is over "
                    f"although the drive is well: {remedy}"
                )


def _same_identifiers(codec: InverterCodec, config: Config) -> Iterator[str]:
    """Yield what the bridge has in common with a drive on the same bus."""
    can, bridge = config.inverter.can, config.bridge.can
    if can is None or config.bridge.driver != "can" or bridge is None or can.place != bridge.place:
        return
    canopen = can.canopen
    taken = {message.key: message.name for message in (codec.command, *codec.feedback)}
    if canopen.start_node is not None:
        taken[nmt_start(0)[0]] = "NMT"
    if canopen.sync:
        taken[SYNC[0]] = "SYNC"
    if canopen.heartbeat_node is not None:
        taken[heartbeat(canopen.heartbeat_node)[0]] = "the heartbeat"
    for name in ("host_id", "board_id"):
        if (identifier := getattr(bridge, name)) in taken:
            yield (
                f"are on the bus of the bridge, and its {name} = 0x{identifier:x} is that of "
                f"{taken[identifier]}: each would take the other's frames for its own"
            )
