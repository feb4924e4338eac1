"""How fast the firmware streams over QEMU's serial link: `python -m tests.firmware.streaming`.

The machine is fed and sent heartbeats a thousand times a second, as in a run. A sample counts as
lost if the board had no room for it, if it was corrupt, or if the board's timer did not come to it:
the computer took the processor from QEMU for longer than a sample's period.
"""

import sys
import time
from typing import NamedTuple

from motord.wire.bridge import frames
from tests.firmware.images import emulated
from tests.firmware.machine import machine

RATES_HZ = (1000, 2000, 5000, 8000, 10_000, 15_000, 20_000)
HOST_HZ = 1000
HOLDS = 0.95


class Streamed(NamedTuple):
    """What came of the samples asked for."""

    rate_Hz: int
    span_s: float  # by the board's clock, from the first to the last sample
    samples: int
    corrupt: int
    dropped: int  # for want of room on the link

    @property
    def came_Hz(self):
        return (self.samples - 1) / self.span_s

    @property
    def lost(self):
        """The share of the samples asked for that did not come."""
        return max(1.0 - self.came_Hz / self.rate_Hz, 0.0)

    def __str__(self):
        return (
            f"{self.rate_Hz:6d} Hz asked, {self.came_Hz:8.1f} Hz came over {self.span_s:.1f} s, "
            f"{100 * self.lost:5.2f} % lost ({self.dropped} for want of room, "
            f"{self.corrupt} corrupt)"
        )


def stream(rate_Hz, duration_s):
    """Let the board stream for `duration_s`; return what came."""
    with machine(emulated()) as board:
        board.configure(rate_Hz, 1_000_000)
        board.send(frames.Heartbeat(0))  # without one the line does not close
        samples, dropped, corrupt = [], 0, 0
        begin_s = time.monotonic()
        fed = 0
        while (passed_s := time.monotonic() - begin_s) < duration_s:
            if fed < passed_s * HOST_HZ:
                fed = int(passed_s * HOST_HZ) + 1
                board.feed(fed // 2 % 4096 ^ fed // 2 % 4096 >> 1, 0)
                board.send(frames.Heartbeat(1))
            board.poll()
            for numbered in board.frames:
                if type(numbered.frame) is frames.Sample:
                    samples.append(numbered.frame.t_us)
                elif type(numbered.frame) is frames.Status:
                    dropped = numbered.frame.dropped
            board.frames.clear()
            time.sleep(0.0005)
        corrupt = board.errors
    span_us = (samples[-1] - samples[0]) % frames.CLOCK_MODULUS_US
    return Streamed(rate_Hz, span_us * 1e-6, len(samples), corrupt, dropped)


def main(duration_s):
    """Print what comes at each rate, and the highest that holds."""
    held = 0
    for rate_Hz in RATES_HZ:
        streamed = stream(rate_Hz, duration_s)
        print(streamed, flush=True)
        if streamed.lost < 1 - HOLDS and not streamed.corrupt:
            held = rate_Hz
    print(f"highest rate with less than {100 * (1 - HOLDS):.0f} % lost: {held} Hz")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
