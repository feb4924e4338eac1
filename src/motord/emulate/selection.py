"""What of a bench file the emulator serves."""

from motord.config import Config, ModbusConfig
from motord.emulate import EmulatorError
from motord.emulate.bench import EmulatedBench
from motord.emulate.devices import RegisterDevice
from motord.wire.can_codec import FEEDBACK_SLOTS, MessageCodec


def check_drivers(config: Config) -> None:
    """Raise EmulatorError unless the bench's devices are ones that can be emulated."""
    if config.inverter.driver != "can" or config.inverter.can is None:
        raise EmulatorError(
            f'[inverter] driver = "{config.inverter.driver}": the emulator serves driver = "can" '
            "only; take config/emulated.toml as a start"
        )
    if config.bridge.driver != "serial":
        raise EmulatorError(
            f'[bridge] driver = "{config.bridge.driver}": the emulator serves driver = "serial" '
            "only; take config/emulated.toml as a start"
        )


def is_fast(message: MessageCodec) -> bool:
    """Return whether a message carries currents or voltages: it is sent at the loop's rate."""
    return not set(message.slots).isdisjoint(FEEDBACK_SLOTS[:6])


def register_devices(
    config: Config, bench: EmulatedBench
) -> dict[str, tuple[ModbusConfig, RegisterDevice]]:
    """Return the devices that the bench file has on Modbus, by name."""
    pairs = (
        ("brake", config.brake, bench.brake),
        ("drive", config.drive, bench.drive),
    )
    return {
        name: (section.modbus, device)
        for name, section, device in pairs
        if section.driver == "modbus" and section.modbus is not None
    }
