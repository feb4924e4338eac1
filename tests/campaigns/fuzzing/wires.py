"""Bytes from devices: the bridge's serial stream, the drive's CAN frames."""

import math
import random

import numpy as np

from motord.config import load, packaged
from motord.control.types import FEEDBACK
from motord.hal.inverter.feedback import CanFeedback
from motord.wire.bridge import frames
from motord.wire.bridge.stream import StreamDecoder
from motord.wire.can import dbc
from motord.wire.can.frame_format import EXTENDED
from tests.campaigns.fuzzing.mutate import mutate_bytes, some_bytes

HELLO = frames.Hello(1, 65536, b"board".ljust(16, b"\0"), 1, 1000, 4096, frames.LAYOUT_HASH)
LAST = frames.Sample(1, 2, -3, 4)


def _frame(rng: random.Random) -> bytes:
    frame: frames.Frame = rng.choice(
        (
            frames.Sample(rng.randrange(2**32), rng.randrange(2**32), rng.randrange(-9, 9), 0),
            frames.Status(1, 0, 2, 3, 4, 5, 6, 1000, 50_000, 1),
            HELLO,
            frames.Heartbeat(1),
            frames.Stop(),
        )
    )
    return frames.encode(frame, rng.randrange(1 << 16))


class Stream:
    """The decoder of the bridge's bytes: it comes back in step, and keeps no more than a frame."""

    def __init__(self) -> None:
        self._decoder = StreamDecoder()

    def close(self) -> None:
        """Nothing is held."""

    def __call__(self, rng: random.Random) -> bool:
        stream = b"".join(_frame(rng) for _ in range(rng.randrange(4)))
        data = mutate_bytes(rng, stream) if stream else some_bytes(rng)
        errors, found = self._decoder.errors, 0
        cut = rng.randrange(len(data) + 1)
        for piece in (data[:cut], data[cut:]):
            for numbered in self._decoder.feed(piece):
                assert frames.decode(frames.encode(*reversed(numbered))[:-1]) == numbered
                found += 1
        assert self._decoder.errors >= errors
        assert len(self._decoder._rest) <= frames.MAX_STUFFED_BYTES
        sequence = rng.randrange(1 << 16)
        self._decoder.feed(frames.DELIMITER)
        again = [
            numbered
            for n, frame in enumerate((HELLO, LAST))  # a Hello, as no number steps back without
            for numbered in self._decoder.feed(frames.encode(frame, (sequence + n) % (1 << 16)))
        ]
        assert again, "the decoder did not come back in step"
        assert again[-1].frame == LAST
        return found > 0


class Can:
    """What is made of CAN frames: never an exception, numbers within the signals' ranges or nan."""

    def __init__(self) -> None:
        bench = load(packaged("../../../config/emulated.toml"))
        assert bench.inverter.can is not None
        self._codec = dbc.load(bench.inverter.can)
        self._feedback = CanFeedback(self._codec, 0, 500_000_000)
        self._row = np.zeros(1, FEEDBACK)

    def close(self) -> None:
        """Nothing is held."""

    def __call__(self, rng: random.Random) -> bool:
        known = rng.choice((*self._codec.feedback, self._codec.command))
        identifier = rng.choice((known.identifier, rng.randrange(1 << 11)))
        right = known.encode([rng.uniform(-2, 2) for _ in known.slots], rng.randrange(16))
        data = rng.choice((right, mutate_bytes(rng, right), some_bytes(rng, 65)))[:64]
        extended = EXTENDED if rng.random() < 0.1 else 0
        self._feedback.take(identifier | extended, data, rng.randrange(1 << 60))
        self._feedback.fill(self._row)
        assert all(math.isnan(x) or math.isfinite(x) for x in self._row["i_A"][0])
        return known.decode(data) is not None
