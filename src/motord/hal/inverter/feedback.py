"""What the drive last said, put together from its CAN messages."""

import math
from collections.abc import Collection

import numpy as np

from motord.wire.can.codec import DQ_FEEDBACK_SLOTS, FEEDBACK_SLOTS, InverterCodec, MessageCodec
from motord.wire.sequence import AliveCounter

_SLOT = {slot: index for index, slot in enumerate(FEEDBACK_SLOTS + DQ_FEEDBACK_SLOTS)}
_AXES = slice(len(FEEDBACK_SLOTS), len(_SLOT))
_STATUS = _SLOT["status"]
_LARGEST = float(np.finfo(np.float32).max)


class _Incoming:
    """One feedback message: codec, where its values go, its errors, when it last came."""

    def __init__(self, codec: MessageCodec) -> None:
        self.codec = codec
        self.slots = tuple(_SLOT[slot] for slot in codec.slots)
        self.fast = any(slot.startswith("i_") for slot in codec.slots)
        self.check = AliveCounter(codec.checks.counter_modulus)
        self.t_ns = 0


class CanFeedback:
    """The newest value of every mapped signal. Values that the map lacks are nan.

    What a drive sends as no number, or too large a one for the tick, is infinite: so it is beyond
    the limits that there are.

    A frame counts only if its length, CRC and alive counter are right.
    """

    def __init__(
        self, codec: InverterCodec, age_ns: int, slow_stale_ns: int, stale_ns: int = 0
    ) -> None:
        """Expect the feedback messages of `codec`, sampled `age_ns` before they arrive.

        slow_stale_ns: a message without currents that is so much older than the currents makes all
        feedback older than `stale_ns`, at which it is stale. Where the currents stayed away, too,
        the message has that time once more from when they come again.
        """
        self._codec = codec
        self._age_ns = age_ns
        self._slow_stale_ns = slow_stale_ns
        self._stale_ns = stale_ns
        self._incoming = {m.key: _Incoming(m) for m in codec.feedback}
        self._values = [math.nan] * len(_SLOT)
        self._values[_STATUS] = 0.0
        self._stating = next(
            (m for m in self._incoming.values() if "status" in m.codec.slots), None
        )
        self._resumed_ns = 0
        self._word = -1
        self._status = 0

    @property
    def keys(self) -> Collection[int]:
        """Return the keys of the messages that count; all others are ignored."""
        return self._incoming.keys()

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or old so far."""
        return sum(m.check.errors for m in self._incoming.values())

    def restart(self) -> None:
        """Take the next frame of each message as its first: none is missing before it."""
        for incoming in self._incoming.values():
            incoming.check.restart()

    def missing(self) -> list[MessageCodec]:
        """Return the messages of which no good frame has come yet."""
        return [m.codec for m in self._incoming.values() if not m.t_ns]

    def corrupt(self) -> list[MessageCodec]:
        """Return the messages of which frames came that were not good."""
        return [m.codec for m in self._incoming.values() if m.check.errors]

    def take(self, key: int, payload: bytes, t_ns: int) -> None:
        """Take a frame that arrived at `t_ns`; other nodes' frames, and our own, are ignored."""
        incoming = self._incoming.get(key)
        if incoming is None:
            return
        values = incoming.codec.decode(payload)
        if values is None:
            incoming.check.corrupt()
        elif incoming.check.accept(incoming.codec.counter(payload)):
            for index, value in zip(incoming.slots, values, strict=True):
                self._values[index] = value if abs(value) <= _LARGEST else math.inf
            if incoming.fast and t_ns - incoming.t_ns > self._slow_stale_ns // 2:
                self._resume(t_ns)
            incoming.t_ns = t_ns

    def fill(self, feedback: np.ndarray) -> None:
        """Fill i_A, u_V, u_bus_V, temperature_C, t_inverter_ns, inverter_status, t_status_ns."""
        values = self._values
        feedback["i_A"] = values[0:3]
        feedback["u_V"] = values[3:6]
        feedback["u_bus_V"] = values[6]
        feedback["temperature_C"] = values[7]
        feedback["t_inverter_ns"] = self._sampled_ns()
        feedback["inverter_status"] = self._understood()
        if self._stating is not None:
            feedback["t_status_ns"] = self._stating.t_ns - self._age_ns

    def along_axes(self) -> list[float]:
        """Return i_d, i_q (A), u_d, u_q (V) as the drive says them."""
        return self._values[_AXES]

    def _resume(self, t_ns: int) -> None:
        """Note that all was silent until `t_ns`, once until a slow message comes again."""
        if max(self._resumed_ns, 1) <= self._oldest_ns():
            self._resumed_ns = t_ns

    def _oldest_ns(self) -> int:
        return min(m.t_ns for m in self._incoming.values())

    def _sampled_ns(self) -> int:
        """Return when the currents were sampled, or when a message last came that stays away.

        That is stale then for a tick that began when the currents came, and for one that began
        before them: a loop that reads them at once sees no others.
        """
        t_ns = min(m.t_ns for m in self._incoming.values() if m.fast)
        oldest_ns = self._oldest_ns()
        if t_ns - max(oldest_ns, self._resumed_ns) >= self._slow_stale_ns:
            t_ns = min(oldest_ns, t_ns - 2 * self._stale_ns - 1)
        return t_ns - self._age_ns

    def _understood(self) -> int:
        word = int(self._values[_STATUS])
        if word != self._word:
            self._word = word
            self._status = int(self._codec.decode_status(word))
        return self._status
