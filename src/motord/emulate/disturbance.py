"""A wire that loses, changes, repeats or delays what is sent over it; without I/O."""

import random
from collections import deque
from collections.abc import Iterator
from typing import Any

from motord.emulate.devices import NEVER_NS


class Disturbance:
    """What happens to frames on a wire; nothing unless `active`.

    drop, corrupt, duplicate: fractions; delay_ns: of frames to the host; off: nothing passes.
    """

    def __init__(self, seed: int = 1) -> None:
        self._random = random.Random(seed)
        self._waiting: deque[tuple[int, Any, bytes]] = deque()
        self.clear()

    def clear(self) -> None:
        """Let everything pass; what is on its way still arrives late."""
        self.active = False
        self.off = False
        self.drop = self.corrupt = self.duplicate = 0.0
        self.delay_ns = 0

    def to_host(self, now_ns: int, key: Any, data: bytes) -> list[bytes]:
        """Return what of `data` to send now; `key` says later what was late."""
        if self.off or self._chance(self.drop):
            return []
        if self._chance(self.corrupt):
            data = self._changed(data)
        copies = [data, data] if self._chance(self.duplicate) else [data]
        if self.delay_ns or self._waiting:
            self._waiting += [(now_ns + self.delay_ns, key, copy) for copy in copies]
            return []
        return copies

    def to_device(self, data: bytes) -> bytes | None:
        """Return what of `data` arrives, perhaps changed; None if nothing does."""
        if self.off or self._chance(self.drop):
            return None
        return self._changed(data) if self._chance(self.corrupt) else data

    @property
    def next_ns(self) -> int:
        """When the next late frame is due."""
        return self._waiting[0][0] if self._waiting else NEVER_NS

    def due(self, now_ns: int) -> Iterator[tuple[Any, bytes]]:
        """Yield the late frames that are due, with their keys; none of a wire that is off."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            _, key, data = self._waiting.popleft()
            if not self.off:
                yield key, data

    def _chance(self, fraction: float) -> bool:
        return fraction > 0.0 and self._random.random() < fraction

    def _changed(self, data: bytes) -> bytes:
        """Return `data` with one bit turned over."""
        if not data:
            return data
        at = self._random.randrange(len(data))
        byte = data[at] ^ 1 << self._random.randrange(8)
        return data[:at] + bytes([byte]) + data[at + 1 :]
