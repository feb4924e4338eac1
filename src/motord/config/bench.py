"""A whole bench, and what must hold between its tables: rules that yield what is wrong, the remedy.

`RULES` in the order in which they are checked: the first one that is broken refuses the file.
"""

from collections.abc import Callable, Iterator

from pydantic import model_validator

from motord.config.bounds import SettingBound
from motord.config.channel_sources import CanSource, SimulatedSource
from motord.config.channels import line_problems
from motord.config.rules.interlocks import interlocks_keep_their_times
from motord.config.rules.slow_devices import (
    a_lost_answer_is_no_silence,
    drive_stops_without_the_daemon,
    registers_reach_the_limits,
)
from motord.config.sections import Sections
from motord.config.timing import RENEWAL_S

BUS_LOAD_MAX = 0.9
"""Most of a CAN bus that the bridge may take at worst; the rest is for Status, at 20 Hz, and for
frames sent again."""


def simulated_together(config: Sections) -> Iterator[str]:
    """Inverter and bridge are simulated both or neither."""
    drivers = {"inverter": config.inverter.driver, "bridge": config.bridge.driver}
    if len({driver == "sim" for driver in drivers.values()}) > 1:
        yield "inverter and bridge are simulated together or not at all; got " + ", ".join(
            f'[{k}] driver = "{v}"' for k, v in drivers.items()
        )


def bus_voltage_is_measured(config: Sections) -> Iterator[str]:
    """A drive on CAN sends its DC bus voltage."""
    can = config.inverter.can
    if config.inverter.driver in ("can", "can-dq") and can and not can.signals.feedback_u_bus_V:
        yield (
            "[inverter.can.signals] has no feedback_u_bus_V: the interlock of the bus voltage "
            "needs it"
        )


def bridge_fits_its_bus(config: Sections) -> Iterator[str]:
    """Samples and heartbeats take at most BUS_LOAD_MAX of the bridge's CAN bus."""
    can, loop_Hz = config.bridge.can, config.loop.rate_Hz
    if config.bridge.driver != "can" or can is None:
        return
    sample_Hz = config.sample_rate_Hz
    load = can.load(sample_Hz, loop_Hz)
    if load > BUS_LOAD_MAX:
        yield (
            f"[bridge.can] samples at {sample_Hz} Hz and heartbeats at {loop_Hz} Hz "
            f"take up to {load:.0%} of the bus; lower [bridge] rate_Hz or [loop] rate_Hz, or "
            "raise bitrate, or take CAN FD with a data_bitrate"
        )


def lease_outlasts_the_ramp(config: Sections) -> Iterator[str]:
    """No torque remains when a lease expires without renewal."""
    limits = config.limits
    yield from SettingBound(
        "[zenoh] lease_s", config.zenoh.lease_s, "at least",
        config.longest_wind_down_s + RENEWAL_S, "too short",
        "no torque may be left when it ends, and the ramp from [limits] torque_Nm = "
        f"{limits.torque_Nm:g} takes {limits.torque_Nm / limits.ramp_down_Nm_per_s:g} s, besides "
        f"[loop] supervisor_timeout_s = {config.loop.supervisor_timeout_s:g} and a renewal",
    ).refusal()  # fmt: skip


def dq_needs_a_star(config: Sections) -> Iterator[str]:
    """A drive that takes d and q feeds windings in a star."""
    if config.inverter.driver == "can-dq" and config.motor.connection != "star":
        yield (
            f'[inverter] driver = "can-dq" with [motor] connection = "{config.motor.connection}"'
            ": currents along d and q say nothing of the part that is common to all phases, "
            "which independent windings can carry; it takes a star"
        )


def channels_fit_the_bench(config: Sections) -> Iterator[str]:
    """What a channel needs is there, and no other process has its serial port."""
    yield from line_problems(config.channels)
    taken = {config.bridge.port: "bridge"} if config.bridge.driver == "serial" else {}
    for name, section in (("brake", config.brake), ("drive", config.drive)):
        if section.driver == "modbus" and section.modbus and section.modbus.transport == "rtu":
            taken[section.modbus.serial_port] = name
    for number, channel in enumerate(config.channels):
        source, place = channel.source, channel.place(number)
        if isinstance(source, SimulatedSource) and not config.simulated:
            yield (
                f'{place}: driver = "simulated" needs a rig that is simulated in the loop; '
                'with the emulator take driver = "modbus" with emulated = "winding_C"'
            )
        if isinstance(source, CanSource) and source.bus is None and config.inverter.can is None:
            yield f"{place}: there is no [inverter.can] whose bus it could use; give it a bus"
        if source.line and (device := taken.get(source.line[-1])):
            yield (
                f"{place}: {source.line[-1]} is the port of the {device}, which another process "
                "has open; take another port"
            )


def derating_has_its_channel(config: Sections) -> Iterator[str]:
    """A winding's temperature is there that I2t goes by, and its sensor's fault trips."""
    if config.limits.i2t_derating_from_C is None:
        return
    windings = [
        (number, channel)
        for number, channel in enumerate(config.channels)
        if channel.role == "winding"
    ]
    if not windings:
        yield (
            "[limits] i2t_derating_from_C: no channel measures the winding's temperature; give "
            'one of [[channels]] role = "winding"'
        )
    for number, channel in windings:
        if channel.trip_above is None:
            yield (
                f"{channel.place(number)} has no trip_above: [limits] i2t_derating_from_C goes by "
                "it, and with a trip limit a broken sensor ends the current; set one"
            )


RULES: tuple[Callable[[Sections], Iterator[str]], ...] = (
    simulated_together,
    interlocks_keep_their_times,
    bus_voltage_is_measured,
    bridge_fits_its_bus,
    lease_outlasts_the_ramp,
    drive_stops_without_the_daemon,
    a_lost_answer_is_no_silence,
    registers_reach_the_limits,
    dq_needs_a_star,
    channels_fit_the_bench,
    derating_has_its_channel,
)


class Config(Sections):
    """A whole bench, whose tables go together."""

    @model_validator(mode="after")
    def _rules_hold(self) -> "Config":
        for rule in RULES:
            if reasons := list(rule(self)):
                raise ValueError("; ".join(reasons))
        return self
