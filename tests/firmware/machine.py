"""A bridge board in QEMU, spoken to without a daemon."""

import random
import select
import time
from contextlib import contextmanager

from motord.emulate.bridge.feed import FeedDecoder, input_frame
from motord.emulate.bridge.qemu import Qemu, receive, send
from motord.wire.bridge import frames
from motord.wire.bridge.stream import StreamDecoder
from tests.support.patience import PATIENCE_S

FIRMWARE_TIME = ("-icount", "shift=4,sleep=off")
"""Lets the machine's time pass by instructions done, and jump while it sleeps: a computer that
stalls does not show, and seconds take milliseconds."""


class Machine:
    """A running machine: what the host and the rig would be to it."""

    def __init__(self, qemu):
        self.qemu = qemu
        self.frames = []
        self.reports = []
        self._decoder = StreamDecoder()
        self._feed = FeedDecoder()
        self._sequence = 0

    @property
    def errors(self):
        """Return the frames from the board that were lost or corrupt."""
        return self._decoder.errors

    def send(self, *sent):
        """Send frames, or bytes as they are, in one write.

        In FIRMWARE_TIME any time may pass on the board between two of them.
        """
        data = b""
        for frame in sent:
            if isinstance(frame, bytes):
                data += frame
                continue
            data += frames.encode(frame, self._sequence)
            self._sequence = (self._sequence + 1) % frames.SEQUENCE_MODULUS
        send(self.qemu.link, data)

    def feed(self, encoder_gray, torque_counts):
        """Set the board's inputs."""
        send(self.qemu.feed, input_frame(encoder_gray, torque_counts))

    def poll(self, wait_s=0.0):
        """Take in what the board has sent."""
        select.select([self.qemu.link, self.qemu.feed], (), (), wait_s)
        while data := receive(self.qemu.link):
            self.frames += self._decoder.feed(data)
        while data := receive(self.qemu.feed):
            self.reports += self._feed.feed(data)

    def wait_for(self, condition, what):
        """Take in what comes until `condition()` gives something; return that."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not (found := condition()):
            assert time.monotonic() < deadline_s, f"waited in vain for {what}: {self.frames[-3:]}"
            self.poll(0.05)
        return found

    def next(self, kind, condition=lambda frame: True):
        """Return the next frame of a kind that has come since the last call."""

        def search():
            while self.frames:
                numbered = self.frames.pop(0)
                if type(numbered.frame) is kind and condition(numbered.frame):
                    return numbered.frame
            return None

        return self.wait_for(search, kind.__name__)

    def configure(self, rate_Hz=1000, timeout_us=100_000):
        """Configure and start the board; return its Status."""
        self.next(frames.Hello)
        self.send(frames.Configure(rate_Hz, timeout_us))
        status = self.next(frames.Status)
        assert (status.rate_Hz, status.streaming) == (rate_Hz, 0)
        self.send(frames.Start())
        return self.next(frames.Status)

    def line(self, closed):
        """Wait until the enable line is closed or open; return the report that says so."""
        return self.wait_for(
            lambda: next((report for report in self.reports if report.line_closed is closed), None),
            f"the enable line to {'close' if closed else 'open'}",
        )


@contextmanager
def machine(image, *arguments):
    """Run an image for as long as the block runs."""
    qemu = Qemu(image, arguments)
    try:
        yield Machine(qemu)
    finally:
        qemu.close()


def mutated(frame, chance: random.Random):
    """Return the bytes of a frame with one to three bits turned over, or cut, or with one more.

    They are none any more: neither the same bit was turned over twice, nor does the CRC hold.
    """
    while True:
        data = bytearray(frame)
        kind = chance.randrange(3)
        if kind == 0:
            for _ in range(chance.randint(1, 3)):
                data[chance.randrange(len(data) - 1)] ^= 1 << chance.randrange(8)
        elif kind == 1:
            del data[chance.randrange(len(data) - 1)]
        else:
            data.insert(chance.randrange(len(data)), chance.randrange(1, 256))
        if not any(part and frames.decode(part) for part in bytes(data).split(b"\0")):
            return bytes(data)
