"""Frames that were changed on the way: what the checks catch for certain, and how rarely they err.

The CRC's polynomial, x^16 + x^12 + x^5 + 1, is a multiple of x + 1 and of order 32767. So it
catches every one, two and three wrong bits of a body, and every burst of up to 16 bits before the
CRC, in the order in which the CRC takes them. Whether an error is caught depends on the error and
the length only, not on what the frame says: one frame of each length is all frames. A wrong bit on
a serial wire can hit a code of the stuffing and make several wrong bits of the body; of these, and
of longer errors, one in 65536 passes the CRC, and then length and type must be right, too.
"""

import pytest

from motord.wire.bridge import frames
from tests.firmware.library import Library

EXAMPLES = [
    frames.Stop(),
    frames.Heartbeat(1),
    frames.HelloRequest(frames.PROTOCOL),
    frames.Configure(5000, 20_000),
    frames.Sample(123_456_789, 0x5A3, -1234, 1),
    frames.Status(1, 2, 3, 4, 5, 6, 7, 8, 9, 1),
]
MUTATIONS = ["FLIP_BITS", "BURST", "BYTES", "DROP", "INSERT", "SWAP", "SPLICE"]
MUTATED = 100_000
BY_NAME = {"ids": lambda value: type(value).__name__ if isinstance(value, tuple) else str(value)}


@pytest.mark.parametrize("frame", EXAMPLES, **BY_NAME)
def test_up_to_three_wrong_bits_of_a_body_are_caught(library: Library, frame: frames.Frame) -> None:
    body = frames.pack(frame, 77)
    tried = library.ffi.new("uint32_t *")
    bits = 8 * len(body)
    every = {1: bits, 2: bits * (bits - 1) // 2, 3: bits * (bits - 1) * (bits - 2) // 6}
    for wrong, count in every.items():
        assert library.lib.host_flipped_body(body, len(body), wrong, tried) == 0
        assert tried[0] == count


@pytest.mark.parametrize("frame", EXAMPLES[:5], **BY_NAME)
def test_bursts_of_up_to_16_bits_of_a_body_are_caught(
    library: Library, frame: frames.Frame
) -> None:
    body = frames.pack(frame, 77)
    tried = library.ffi.new("uint32_t *")
    assert library.lib.host_burst_body(body, len(body), len(body) - 2, tried) == 0
    assert tried[0] == (8 * (len(body) - 2) - 15) * 32768
    across = library.lib.host_burst_body(body, len(body), len(body), tried)
    assert across <= 12  # into the CRC, which goes lowest byte first: of 800,000 and more


@pytest.mark.parametrize("sequence", [0, 1, 256, 0x1234, 0xFFFF])
@pytest.mark.parametrize("enable", [0, 1])
def test_no_heartbeat_with_up_to_three_wrong_bits_on_the_wire_is_taken(
    library: Library, enable: int, sequence: int
) -> None:
    wire = frames.encode(frames.Heartbeat(enable), sequence)[:-1]
    tried = library.ffi.new("uint32_t *")
    for wrong in (1, 2, 3):
        assert library.lib.host_flipped(wire, len(wire), wrong, tried) == 0


def test_of_100_000_mutated_frames_no_more_is_taken_than_the_crc_lets_pass(
    library: Library,
) -> None:
    """Random errors of more bits than it catches for certain pass it once in 65536."""
    each = MUTATED // len(MUTATIONS) + 1
    taken = {
        name: library.lib.host_mutated(2026, each, getattr(library.lib, name)) for name in MUTATIONS
    }
    assert sum(taken.values()) <= MUTATED / 65536, taken


@pytest.mark.parametrize("name", MUTATIONS)
def test_of_many_more_hardly_any_is_taken(library: Library, name: str) -> None:
    """The CRC alone lets one in 65536 of the random ones pass: no mutation may be worse."""
    count = 3 * MUTATED
    taken = library.lib.host_mutated(1, count, getattr(library.lib, name))
    assert taken <= count / 65536


def test_undetected_errors_are_counted(library: Library) -> None:
    """The polynomial itself is an error of four bits that the CRC cannot see."""
    body = frames.pack(frames.Heartbeat(1), 77)
    tried = library.ffi.new("uint32_t *")
    assert library.lib.host_flipped_body(body, len(body), 4, tried) > 0
    wire = frames.encode(frames.Heartbeat(1), 77)[:-1]
    assert library.lib.host_flipped(wire, len(wire), 4, tried) > 0
