"""What of a bench file the emulator serves."""

from collections import defaultdict

from motord.config import ChannelConfig, Config, ModbusLinkConfig
from motord.config.channel_sources import ModbusSource
from motord.emulate import EmulatorError
from motord.emulate.bench import EmulatedBench, SensorReading
from motord.emulate.devices import ReadOnlyRegisters, RegisterDevice
from motord.wire.can.codec import DQ_FEEDBACK_SLOTS, FEEDBACK_SLOTS, MessageCodec

_SLOTS = FEEDBACK_SLOTS + DQ_FEEDBACK_SLOTS
_FAST = {*FEEDBACK_SLOTS[:6], *DQ_FEEDBACK_SLOTS}


def check_drivers(config: Config) -> None:
    """Raise EmulatorError unless the bench's devices are ones that can be emulated."""
    for table, driver, served, start in (
        ("inverter", config.inverter.driver, ("can", "can-dq"), "emulated.toml or config/dq.toml"),
        ("bridge", config.bridge.driver, ("serial", "can"), "emulated.toml"),
    ):
        if driver not in served:
            raise EmulatorError(
                f'[{table}] driver = "{driver}": the emulator serves driver = "{served[0]}" '
                f'and "{served[1]}" only; take config/{start} as a start'
            )


def is_fast(message: MessageCodec) -> bool:
    """Return whether a message carries currents or voltages: it is sent at the loop's rate."""
    return not _FAST.isdisjoint(message.slots)


def inverter_values(reading: SensorReading, status_word: int) -> dict[str, float]:
    """Return all values that messages of the inverter may carry."""
    values = (
        *reading.i_sensed_A.tolist(),
        *reading.u_V.tolist(),
        reading.u_bus_V,
        reading.temperature_C,
        status_word,
        reading.i_d_A,
        reading.i_q_A,
        reading.u_d_V,
        reading.u_q_V,
    )
    return dict(zip(_SLOTS, values, strict=True))


def register_devices(
    config: Config, bench: EmulatedBench
) -> dict[str, tuple[ModbusLinkConfig, RegisterDevice | ReadOnlyRegisters]]:
    """Return the devices that the bench file has on Modbus, by name.

    Channels of one unit are a device of the name of the first.
    """
    pairs = (
        ("brake", config.brake, bench.brake),
        ("drive", config.drive, bench.drive),
    )
    devices: dict[str, tuple[ModbusLinkConfig, RegisterDevice | ReadOnlyRegisters]] = {
        name: (section.modbus, device)
        for name, section, device in pairs
        if section.driver == "modbus" and section.modbus is not None
    }
    units: dict[tuple[str, int], list[ChannelConfig]] = defaultdict(list)
    for channel in config.channels:
        if isinstance(channel.source, ModbusSource) and channel.source.emulated:
            units[channel.source.place, channel.source.unit].append(channel)
    for channels in units.values():
        source = channels[0].source
        assert isinstance(source, ModbusSource)
        registers = ReadOnlyRegisters(channels, lambda: bench.quantities)
        devices[f"channel {channels[0].name}"] = (source, registers)
    return devices
