"""The other ends of a bench's wires, as cheap as can be: an inverter and a board that never change.

    python -m tests.benchmarks.wire_peer FILE CPU

Serves the bench of FILE at its loop rate from processor CPU, with real-time priority if that is to
be had. All frames of the inverter are made beforehand, so that what is measured is the loop, not
its peer. Prints `up` when all ports are open and, after SIGTERM, a line of JSON: `ticks`,
`skipped`, `cpu_s`.
"""

import json
import os
import signal
import socket
import sys
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import can
from can.interfaces.udp_multicast.utils import pack_message

from motord import config
from motord.config import CanConfig, LoopConfig
from motord.emulate.board import Board
from motord.emulate.bridge.link import BoardLink
from motord.emulate.selection import is_fast
from motord.loop import rt_setup
from motord.loop.hybrid_sleep import HybridSleep
from motord.loop.pacer import Pacer
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import FEEDBACK_SLOTS, MessageCodec
from motord.wire.can.frame_format import EXTENDED

PRIORITY = 70
LISTEN_HZ, SLOW_HZ, BOARD_STATUS_HZ = 250, 100, 20
COUNTERS = 16
VALUES = (1.0, -2.5, 1.5, 3.0, -6.0, 3.0, 24.0, 41.5)


class UdpWire:
    """python-can's udp_multicast, its datagrams made beforehand."""

    def __init__(self, bus: CanConfig) -> None:
        self._place = (bus.channel, int(bus.options["port"]))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)

    def pack(self, message: can.Message) -> bytes:
        """Return what goes over the wire for `message`."""
        return pack_message(message)

    def send(self, data: bytes) -> None:
        """Send what `pack` made."""
        self._socket.sendto(data, self._place)

    def receive(self) -> None:
        """Take what the loop has sent; it is not subscribed to."""


class SlcanWire:
    """The adapter's end of a pseudo-terminal that speaks slcan; the loop opens the channel."""

    def __init__(self, bus: CanConfig) -> None:
        self._fd, host_fd = os.openpty()
        tty.setraw(host_fd)
        os.set_blocking(self._fd, False)
        Path(bus.channel).symlink_to(os.ttyname(host_fd))

    def pack(self, message: can.Message) -> bytes:
        """Return the line for a CAN FD frame with an identifier of 11 bits."""
        code = can.util.len2dlc(message.dlc)
        return f"b{message.arbitration_id:03X}{code:X}{message.data.hex()}\r".encode()

    def send(self, data: bytes) -> None:
        """Send what `pack` made; what there is no room for is lost."""
        with suppress(BlockingIOError):
            os.write(self._fd, data)

    def receive(self) -> None:
        """Take what the loop has sent."""
        with suppress(BlockingIOError):
            os.read(self._fd, 65536)


WIRES: dict[str, Callable[[CanConfig], UdpWire | SlcanWire]] = {
    "udp_multicast": UdpWire,
    "slcan": SlcanWire,
}


class FixedPeer:
    """Inverter and board of the bench `bench`."""

    def __init__(self, bench: config.Config) -> None:
        can_config = bench.inverter.can
        assert can_config is not None
        codec = dbc.load(can_config)
        status = codec.status_word(InverterStatus.READY)
        values = dict(zip(FEEDBACK_SLOTS, (*VALUES, status), strict=True))
        self._wire = WIRES[can_config.interface](can_config)
        self._fast = [self._frames(m, values) for m in codec.feedback if is_fast(m)]
        self._slow = [self._frames(m, values) for m in codec.feedback if not is_fast(m)]
        self._board = Board(bench, time.monotonic_ns())
        self._link = BoardLink(Path(bench.bridge.port), self._board.check)
        rate_Hz = bench.loop.rate_Hz
        self._slow_every, self._listen_every, self._status_every = (
            max(1, rate_Hz // each_Hz) for each_Hz in (SLOW_HZ, LISTEN_HZ, BOARD_STATUS_HZ)
        )

    def tick(self, number: int) -> None:
        """Say what is due in tick `number`, and listen now and then."""
        wire, board, link, now_ns = self._wire, self._board, self._link, time.monotonic_ns()
        for frames in self._fast:
            wire.send(frames[number % COUNTERS])
        if number % self._slow_every == 0:
            for frames in self._slow:
                wire.send(frames[number // self._slow_every % COUNTERS])
        if board.streaming:
            link.send(board.sample(now_ns, 0x5A5, 1500, False))
        if number % self._listen_every == 0:
            wire.receive()
            for at_ns, numbered in link.receive(now_ns):
                for answer in board.receive(at_ns, numbered):
                    link.send(answer)
        if number % self._status_every == 0 and board.streaming:
            link.send(board.status(now_ns))

    def close(self) -> None:
        """Release the ports."""
        self._link.close()

    def _frames(self, message: MessageCodec, values: dict[str, float]) -> list[bytes]:
        payloads = [
            message.encode([values[slot] for slot in message.slots], counter)
            for counter in range(COUNTERS)
        ]
        return [
            self._wire.pack(
                can.Message(
                    arbitration_id=message.identifier,
                    is_extended_id=message.key >= EXTENDED,
                    is_fd=True,
                    bitrate_switch=True,
                    data=payload,
                )
            )
            for payload in payloads
        ]


def main() -> int:
    """Serve until SIGTERM; returns the exit code."""
    bench, cpu = config.load(Path(sys.argv[1])), int(sys.argv[2])
    stopped: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> Any:
        stopped.append(number)

    signal.signal(signal.SIGTERM, stop)
    peer = FixedPeer(bench)
    period_ns = round(1e9 / bench.loop.rate_Hz)
    pacer = Pacer(period_ns, HybridSleep(period_ns, spin=False))
    rt_setup.apply(LoopConfig(cpu=cpu, priority=PRIORITY))
    sys.stdout.write("up\n")
    sys.stdout.flush()
    begun_s, ticks = time.process_time(), 0
    pacer.start()
    while not stopped:
        pacer.wait()
        peer.tick(ticks)
        ticks += 1
    peer.close()
    result = {"ticks": ticks, "skipped": pacer.missed, "cpu_s": time.process_time() - begun_s}
    sys.stdout.write(json.dumps(result) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
