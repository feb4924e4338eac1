"""What Modbus registers mean: numbers with a scale in one or two 16-bit registers.

Pure: the client (`hal.modbus`) and the emulated devices (`emulate.modbus`) share this layout,
which comes from `config.ModbusConfig`.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag

from motord.config import ModbusConfig
from motord.config.devices.slow_devices import RegisterKind, register_counts

_LAYOUTS = {"u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i"}


class DeviceStatus(IntFlag):
    """What motord understands of the status word of a brake or an external drive."""

    READY = 1 << 0
    FAULT = 1 << 1


@dataclass(frozen=True)
class Register:
    """A number in one or two registers: `address` of the first, `scale` in units per count."""

    address: int
    kind: RegisterKind
    scale: float
    word_order: str = "big"

    @property
    def words(self) -> int:
        """Return how many 16-bit registers it takes."""
        return struct.calcsize(_LAYOUTS[self.kind]) // 2

    @property
    def counts(self) -> tuple[int, int]:
        """Return the least and the greatest count that it can hold."""
        return register_counts(self.kind)

    def encode(self, value: float) -> list[int]:
        """Return the words for `value`, clamped to what fits; anything not finite is zero."""
        low, high = self.counts
        count = 0
        if math.isfinite(value):
            count = round(min(max(value / self.scale, low), high))
        words = list(struct.unpack(f">{self.words}H", struct.pack(_LAYOUTS[self.kind], count)))
        return words if self.word_order == "big" else words[::-1]

    def decode(self, words: Sequence[int]) -> float:
        """Return the value that `words` (as many as `words`) stand for."""
        ordered = words if self.word_order == "big" else words[::-1]
        packed = struct.pack(f">{self.words}H", *ordered)
        (count,) = struct.unpack(_LAYOUTS[self.kind], packed)
        return float(count * self.scale)


@dataclass(frozen=True)
class Layout:
    """The registers of one device, and what its status bits mean."""

    setpoint: Register
    status: Register
    value: Register
    ready_mask: int
    fault_mask: int

    def decode_status(self, word: int) -> DeviceStatus:
        """Return what a status word says; a device without a ready bit (mask 0) is ready."""
        status = DeviceStatus(0)
        if word & self.ready_mask == self.ready_mask:
            status |= DeviceStatus.READY
        if word & self.fault_mask:
            status |= DeviceStatus.FAULT
        return status

    def status_word(self, status: DeviceStatus) -> int:
        """Return the status word with which a device says `status`."""
        ready = self.ready_mask if status & DeviceStatus.READY else 0
        fault = self.fault_mask if status & DeviceStatus.FAULT else 0
        return ready | fault


def layout(config: ModbusConfig) -> Layout:
    """Return the registers that a bench file gives a device."""
    order = config.word_order
    return Layout(
        setpoint=Register(
            config.setpoint_register, config.setpoint_kind, config.setpoint_scale, order
        ),
        status=Register(config.status_register, "u16", 1.0, order),
        value=Register(config.value_register, config.value_kind, config.value_scale, order),
        ready_mask=config.status_ready_mask,
        fault_mask=config.status_fault_mask,
    )
