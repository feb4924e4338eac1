"""A bridge board that lives in this process: the core, with a board of memory behind it."""

from collections.abc import Sequence
from typing import Any

from motord.wire.bridge import frames
from motord.wire.bridge.segmentation import PIECE_NUMBERS, PieceDecoder, split
from motord.wire.bridge.stream import StreamDecoder
from tests.firmware.library import Library

CLOCK = 1 << 32
MIDDLE = [2048] * 4


class Device:
    """The board: what the host sends goes in, what it answers comes out as motord decodes it.

    `now_us` is its clock. `link` is 0 (serial), 1 (CAN) or 2 (CAN FD).
    """

    def __init__(self, library: Library, link: int = 0, now_us: int = 0, **board: Any) -> None:
        self.ffi, self.lib = library.ffi, library.lib
        self.now_us = now_us
        self.lib.host_reset(link)
        self.host = self.lib.host
        self.board = self.lib.host_board
        for name, value in board.items():
            target = self.host if name in ("self_test_result", "tick_max_Hz") else self.board
            setattr(target, name, value)
        self.bridge = self.ffi.new("struct bridge *")
        self.ffi.buffer(self.bridge)[:] = b"\xa5" * self.ffi.sizeof("struct bridge")
        self.lib.bridge_init(self.bridge, self.ffi.addressof(self.board))
        self.sequence = 0
        self._piece_bytes = (0, 8, 64)[link]
        self._piece = 0
        self._ticked_us = float(now_us)
        self._stream = StreamDecoder()
        self._pieces = PieceDecoder()

    @property
    def closed(self) -> bool:
        return bool(self.host.line_closed)

    @property
    def link_errors(self) -> int:
        """Return what motord's decoder found wrong in what the board sent."""
        return self._pieces.errors if self._piece_bytes else self._stream.errors

    def wire(self, frame: frames.Frame, sequence: int | None = None) -> list[bytes]:
        """Return what a host sends: one piece of bytes (serial) or some (CAN)."""
        if sequence is None:
            sequence = self.sequence
            self.sequence = (sequence + 1) % frames.SEQUENCE_MODULUS
        if not self._piece_bytes:
            return [frames.encode(frame, sequence)]
        pieces = split(frames.pack(frame, sequence), self._piece, self._piece_bytes)
        self._piece = (self._piece + len(pieces)) % PIECE_NUMBERS
        return pieces

    def receive(self, data: bytes) -> None:
        """Let the receive interrupt come with `data`; a rate that it sets begins its period now."""
        starts = self.host.tick_starts
        self.lib.bridge_on_received(self.bridge, self.now_us % CLOCK, data, len(data))
        if self.host.tick_starts != starts:
            self._ticked_us = float(self.now_us)

    def send(self, frame: frames.Frame, sequence: int | None = None) -> None:
        for data in self.wire(frame, sequence):
            self.receive(data)

    def tick(self, lines: int = 0, adc: Sequence[int] = MIDDLE) -> None:
        """Let the tick interrupt come."""
        readings = self.ffi.new("uint16_t[]", adc)
        reading = self.ffi.new(
            "struct board_reading *", [self.now_us % CLOCK, lines, readings, len(adc)]
        )
        self.lib.bridge_on_tick(self.bridge, reading)

    def pass_us(self, time_us: int, lines: int = 0) -> None:
        """Let time pass: ticks come at the rate that the core asked for, from now on."""
        end_us = self.now_us + time_us
        self._ticked_us = self.lib.host_pass(
            self.bridge, self._ticked_us, self.now_us, end_us, lines
        )
        self.now_us = end_us

    def answers(self) -> list[frames.Frame]:
        """Let the main loop run; return the frames that it sent."""
        self.lib.bridge_poll(self.bridge)
        return self.taken()

    def taken(self) -> list[frames.Frame]:
        """Return the frames that were sent since the last time."""
        host = self.host
        data = bytes(self.ffi.buffer(host.sent, host.sent_bytes))
        sizes = [host.send_bytes[i] for i in range(host.sends)]
        host.sent_bytes = host.sends = 0
        if not self._piece_bytes:
            return [numbered.frame for numbered in self._stream.feed(data)]
        got, at = [], 0
        for size in sizes:
            numbered = self._pieces.feed(data[at : at + size])
            at += size
            if numbered is not None:
                got.append(numbered.frame)
        return got

    def ask(self, frame: frames.Frame) -> frames.Frame:
        """Send `frame`; return the one answer."""
        self.answers()
        self.send(frame)
        (answer,) = self.answers()
        return answer

    def beat(self, enable: int) -> None:
        self.send(frames.Heartbeat(enable))

    def close_line(self) -> None:
        """Ask for an open and then for a closed line, as a host does that starts."""
        self.beat(0)
        self.beat(1)
