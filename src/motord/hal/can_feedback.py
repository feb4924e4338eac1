"""What the drive last said, put together from its CAN messages."""

import math

import can
import numpy as np

from motord.schema import InverterStatus
from motord.wire.can_codec import EXTENDED, FEEDBACK_SLOTS, InverterCodec, MessageCodec
from motord.wire.sequence import SequenceCheck

SILENT_AFTER_NS = 500_000_000
"""A slow message (status, temperature) missing for so long makes all feedback stale."""

_ERROR_BUS_OFF = 0x40  # linux/can/error.h
_ERROR_RESTARTED = 0x100
_SLOT = {slot: index for index, slot in enumerate(FEEDBACK_SLOTS)}
_STATUS = _SLOT["status"]


class _Incoming:
    """One feedback message: codec, where its values go, its errors, when it last came."""

    __slots__ = ("check", "codec", "fast", "slots", "t_ns")

    def __init__(self, codec: MessageCodec) -> None:
        self.codec = codec
        self.slots = tuple(_SLOT[slot] for slot in codec.slots)
        self.fast = any(slot.startswith("i_") for slot in codec.slots)
        self.check = SequenceCheck(codec.checks.counter_modulus)
        self.t_ns = 0


class CanFeedback:
    """The newest value of every mapped signal. Values that the map lacks are nan.

    A frame counts only if its length, CRC and alive counter are right. `bus_off` follows the
    controller's error frames; any good frame clears it.
    """

    def __init__(self, codec: InverterCodec, age_ns: int) -> None:
        """Expect the feedback messages of `codec`, sampled `age_ns` before they arrive."""
        self.bus_off = False
        self._codec = codec
        self._age_ns = age_ns
        self._incoming = {m.key: _Incoming(m) for m in codec.feedback}
        self._values = [math.nan] * len(FEEDBACK_SLOTS)
        self._values[_STATUS] = 0.0
        self._error_frames = 0
        self._word = -1
        self._status = 0

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or repeated so far, and error frames."""
        return self._error_frames + sum(m.check.errors for m in self._incoming.values())

    def missing(self) -> list[MessageCodec]:
        """Return the messages of which no good frame has come yet."""
        return [m.codec for m in self._incoming.values() if not m.t_ns]

    def corrupt(self) -> list[MessageCodec]:
        """Return the messages of which frames came that were not good."""
        return [m.codec for m in self._incoming.values() if m.check.errors]

    def take(self, message: can.Message, t_ns: int) -> None:
        """Take a frame that arrived at `t_ns`; other nodes' frames, and our own, are ignored."""
        if message.is_error_frame:
            self._error_frame(message.arbitration_id)
            return
        identifier = message.arbitration_id
        incoming = self._incoming.get(
            identifier | EXTENDED if message.is_extended_id else identifier
        )
        if incoming is None:
            return
        payload = message.data
        values = incoming.codec.decode(payload)
        if values is None:
            incoming.check.corrupt()
        elif incoming.check.accept(incoming.codec.counter(payload)):
            for index, value in zip(incoming.slots, values, strict=True):
                self._values[index] = value
            incoming.t_ns = t_ns
            self.bus_off = False

    def fill(self, feedback: np.ndarray) -> None:
        """Fill i_A, u_V, u_bus_V, temperature_C, t_inverter_ns and inverter_status."""
        values = self._values
        feedback["i_A"] = values[0:3]
        feedback["u_V"] = values[3:6]
        feedback["u_bus_V"] = values[6]
        feedback["temperature_C"] = values[7]
        feedback["t_inverter_ns"] = self._sampled_ns()
        feedback["inverter_status"] = self._understood()

    def _sampled_ns(self) -> int:
        """Return when the currents were sampled, or when a message last came that stays away."""
        messages = self._incoming.values()
        t_ns = min(m.t_ns for m in messages if m.fast)
        oldest_ns = min(m.t_ns for m in messages)
        return (t_ns if t_ns - oldest_ns < SILENT_AFTER_NS else oldest_ns) - self._age_ns

    def _understood(self) -> int:
        word = int(self._values[_STATUS])
        if word != self._word:
            self._word = word
            self._status = int(self._codec.understand(word))
        return self._status | (int(InverterStatus.BUS_OFF) if self.bus_off else 0)

    def _error_frame(self, error_class: int) -> None:
        self._error_frames += 1
        if error_class & _ERROR_BUS_OFF:
            self.bus_off = True
        elif error_class & _ERROR_RESTARTED:
            self.bus_off = False
