"""The drive's CAN messages, compiled from a DBC to shifts and masks: no DBC library per frame.

Both directions of every message: the daemon encodes the command and decodes the feedback, the
emulated drive the other way round. A message may carry an alive counter, one more with each frame
up to the greatest value that width and DBC allow, then the least, and a CRC: CRC-8/SAE-J1850 over
every byte of the payload but its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from motord.config import CanSignalMap
from motord.schema import InverterStatus
from motord.wire.can.frame_format import EXTENDED, data_size
from motord.wire.can.signal import SignalCodec
from motord.wire.crc import crc8

COMMAND_SLOTS = ("i_a_A", "i_b_A", "i_c_A", "enable")
"""The values of a command of phase currents, in the order of its `MessageCodec`."""

DQ_COMMAND_SLOTS = ("i_d_A", "i_q_A", "enable")
"""The values of a command of currents along d and q; a drive need not take i_d."""

FEEDBACK_SLOTS = (
    "i_a_A",
    "i_b_A",
    "i_c_A",
    "u_a_V",
    "u_b_V",
    "u_c_V",
    "u_bus_V",
    "temperature_C",
    "status",
)
"""The values that the drive sends, over all its messages; a DBC need not have all."""

DQ_FEEDBACK_SLOTS = ("i_d_A", "i_q_A", "u_d_V", "u_q_V")
"""What a drive may send besides, or instead of phase currents and voltages."""

_STATUS_PARTS = {
    "ready": InverterStatus.READY,
    "enable_line": InverterStatus.ENABLE_LINE,
    "timeout": InverterStatus.COMMAND_TIMEOUT,
    "fault": InverterStatus.FAULT,
}


@dataclass(frozen=True, slots=True)
class Checks:
    """What guards a message: its counter signal, if any, and the byte of its CRC, or -1.

    A counter has `counter_modulus` values, from `counter_least` on.
    """

    counter: SignalCodec | None = None
    counter_least: int = 0
    counter_modulus: int = 0
    crc_byte: int = -1


class MessageCodec:
    """One message: `slots` names the values of `encode` and `decode`, in order.

    `key` is the identifier, with bit 31 set for an extended one; `size_bytes` the length on the
    bus, `checks.counter_modulus` 0 for a message without counter; `cycle_s` the time from one to
    the next as its DBC states it, 0 if it does not.
    """

    def __init__(
        self,
        name: str,
        key: int,
        length_bytes: int,
        signals: Mapping[str, SignalCodec],
        checks: Checks,
        constants: Sequence[tuple[SignalCodec, float]] = (),
        cycle_s: float = 0.0,
    ) -> None:
        """Join the signals of a message; `constants` are sent with these values every time."""
        self.name = name
        self.key = key
        self.size_bytes = data_size(length_bytes)
        self.slots = tuple(signals)
        self.checks = checks
        self.cycle_s = cycle_s
        self._length = length_bytes
        self._signals = tuple(signals.values())
        self._base = [0, 0]
        for signal, value in constants:
            self._base[signal.big_endian] |= signal.insert(value)

    @property
    def identifier(self) -> int:
        """Return the identifier without the mark of an extended one."""
        return self.key & ~EXTENDED

    def steps(self, slot: str) -> tuple[float, float, float]:
        """Return the least and greatest value of a slot, and the step between two."""
        return self._signals[self.slots.index(slot)].steps

    def encode(self, values: Sequence[float], counter: int = 0) -> bytes:
        """Return the payload, `size_bytes` long, of `values` in the order of `slots`.

        What does not fit a signal saturates; the counter wraps.
        """
        little, big = self._base
        for signal, value in zip(self._signals, values, strict=True):
            if signal.big_endian:
                big |= signal.insert(value)
            else:
                little |= signal.insert(value)
        checks = self.checks
        if checks.counter is not None:
            number = checks.counter_least + counter % checks.counter_modulus
            bits = checks.counter.insert(number)
            if checks.counter.big_endian:
                big |= bits
            else:
                little |= bits
        length = self._length
        if big:
            little |= int.from_bytes(big.to_bytes(length, "big"), "little")
        payload = bytearray(little.to_bytes(length, "little"))
        if checks.crc_byte >= 0:
            payload[checks.crc_byte] = self._crc(payload)
        return bytes(payload.ljust(self.size_bytes, b"\0"))

    def decode(self, payload: bytes | bytearray) -> tuple[float, ...] | None:
        """Return the values in the order of `slots`, or None if length or CRC are wrong."""
        length = self._length
        if len(payload) != self.size_bytes:
            return None
        if self.size_bytes != length:
            payload = payload[:length]
        crc_byte = self.checks.crc_byte
        if crc_byte >= 0 and payload[crc_byte] != self._crc(payload):
            return None
        little = int.from_bytes(payload, "little")
        big = int.from_bytes(payload, "big")
        return tuple([s.extract(big) if s.big_endian else s.extract(little) for s in self._signals])

    def counter(self, payload: bytes | bytearray) -> int:
        """Return the alive counter in a payload that `decode` took, its least value as 0.

        0 if the message has none.
        """
        signal = self.checks.counter
        if signal is None:
            return 0
        raw = int.from_bytes(payload[: self._length], "big" if signal.big_endian else "little")
        return int(signal.extract(raw)) - self.checks.counter_least

    def _crc(self, payload: bytes | bytearray) -> int:
        byte = self.checks.crc_byte
        return crc8(payload[:byte] + payload[byte + 1 :])


@dataclass(frozen=True)
class InverterCodec:
    """All messages of one drive, from `wire.can.dbc.load`."""

    command: MessageCodec
    feedback: tuple[MessageCodec, ...]
    signals: CanSignalMap

    def encode_command(self, currents_A: Sequence[float], enable: bool, counter: int) -> bytes:
        """Return the payload of `command` for current references and the enable bit.

        The currents are those of the three phases, or d and q; what the drive has no signal for
        is left out.
        """
        signals = self.signals
        if signals.q_only:
            currents_A = currents_A[1:]
        if not signals.command_enable:
            return self.command.encode(currents_A, counter)
        on = signals.command_enable_value if enable else signals.command_disable_value
        return self.command.encode((*currents_A, on), counter)

    def decode_command(self, payload: bytes) -> tuple[tuple[float, ...], bool] | None:
        """Return three currents and the enable bit, or None for a corrupt payload.

        The currents are those of the phases; or d, q and 0. A drive without an enable signal is
        commanded on by every command.
        """
        values = self.command.decode(payload)
        if values is None:
            return None
        signals = self.signals
        on = not signals.command_enable or round(values[-1]) == signals.command_enable_value
        if not signals.rotating:
            return values[:3], on
        i_d_A = 0.0 if signals.q_only else values[0]
        return (i_d_A, values[0 if signals.q_only else 1], 0.0), on

    def decode_status(self, word: int) -> InverterStatus:
        """Return what the drive's status word says, in motord's bits.

        A drive without a ready bit (mask 0) counts as ready unless commands were missing, one
        without a status word always.
        """
        if not self.signals.feedback_status:
            return InverterStatus.READY
        status = InverterStatus(0)
        for mask, value, meaning in self._meanings():
            if value is not None:
                holds = word & mask == value
            elif meaning is InverterStatus.READY:
                holds = word & mask == mask
            else:
                holds = word & mask != 0
            if holds:
                status |= meaning
        if not self.signals.status_ready_mask and status & InverterStatus.COMMAND_TIMEOUT:
            status &= ~InverterStatus.READY
        return status

    def status_word(self, status: InverterStatus) -> int:
        """Return the status word with which the drive says `status`.

        Of meanings that share bits, as values of a mode do, the last of ready, timeout, fault.
        """
        word = 0
        for mask, value, meaning in self._meanings():
            if status & meaning:
                word = word & ~mask | (mask if value is None else value)
        return word

    def _meanings(self) -> Iterator[tuple[int, int | None, InverterStatus]]:
        """Yield mask, value (None: any bit) and meaning of each part of the status word."""
        for name, meaning in _STATUS_PARTS.items():
            mask: int = getattr(self.signals, f"status_{name}_mask")
            value: int | None = getattr(self.signals, f"status_{name}_value")
            yield mask, value, meaning
