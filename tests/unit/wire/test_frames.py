import struct
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.schema import BridgeStatus
from motord.wire.bridge import cobs, frames
from motord.wire.bridge.stream import StreamDecoder
from motord.wire.crc import crc16

U8, U16, U32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))
I32 = st.integers(-(2**31), 2**31 - 1)
KINDS: list[st.SearchStrategy[Any]] = [
    st.builds(frames.Hello, U16, U32, st.binary(min_size=16, max_size=16), *5 * (U32,)),
    st.builds(frames.Sample, U32, U32, I32, U16),
    st.builds(frames.Status, U32, U16, U16, U32, U32, U32, U32, U32, U32, U8),
    st.builds(frames.HelloRequest, U16),
    st.builds(frames.Configure, U32, U32),
    st.just(frames.Start()),
    st.just(frames.Stop()),
    st.builds(frames.Heartbeat, U8),
]
FRAMES = st.one_of(*KINDS)


def numbered(contents: list[frames.Frame], first: int = 0) -> list[frames.Numbered]:
    return [frames.Numbered(number, frame) for number, frame in enumerate(contents, first)]


def stream(contents: list[frames.Numbered]) -> bytes:
    return b"".join(frames.encode(frame, number) for number, frame in contents)


def fed_in_pieces(decoder: StreamDecoder, data: bytes, cuts: list[int]) -> list[frames.Numbered]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    out = []
    for start, end in pairwise(edges):
        out += decoder.feed(data[start:end])
    return out


@given(FRAMES, U16)
def test_every_frame_there_and_back(frame: frames.Frame, number: int) -> None:
    data = frames.encode(frame, number)
    assert data.endswith(b"\0")
    assert data.count(b"\0") == 1
    assert len(data) <= frames.MAX_STUFFED_BYTES + 1
    decoded = frames.decode(data[:-1])
    assert decoded == (number, frame)
    assert type(decoded.frame) is type(frame)  # named tuples of equal content are equal


@given(st.lists(FRAMES, max_size=12), st.lists(st.integers(0, 10_000), max_size=12))
def test_pieces_make_no_difference(contents: list[frames.Frame], cuts: list[int]) -> None:
    sent = numbered(contents)
    decoder = StreamDecoder()
    assert fed_in_pieces(decoder, stream(sent), cuts) == sent
    assert decoder.errors == 0


@given(st.binary(max_size=400), st.lists(st.integers(0, 1000), max_size=12))
def test_noise_in_any_pieces_gives_the_same(noise: bytes, cuts: list[int]) -> None:
    whole, pieces = StreamDecoder(), StreamDecoder()
    assert whole.feed(noise + b"\0") == fed_in_pieces(pieces, noise + b"\0", cuts)
    assert whole.errors == pieces.errors


@given(
    st.lists(FRAMES, min_size=1, max_size=5),
    st.binary(max_size=120),
    st.lists(FRAMES, min_size=2, max_size=5),
    st.lists(st.integers(0, 1000), max_size=8),
)
def test_in_step_again_after_noise(
    before: list[frames.Frame], noise: bytes, after: list[frames.Frame], cuts: list[int]
) -> None:
    """Noise costs at most the frame that it runs into."""
    first, second = numbered(before), numbered(after, len(before))
    decoder = StreamDecoder()
    received = fed_in_pieces(decoder, stream(first) + noise + stream(second), cuts)
    assert received[: len(first)] == first
    assert received[1 - len(second) :] == second[1:]


@given(FRAMES, st.data())
def test_a_corrupt_frame_is_never_accepted(frame: frames.Frame, draw: st.DataObject) -> None:
    """Up to three wrong bits within the span of the CRC are always found, at any position."""
    data = bytearray(frames.encode(frame, 1)[:-1])
    bits = draw.draw(
        st.lists(st.integers(0, 8 * len(data) - 1), min_size=1, max_size=3, unique=True)
    )
    for bit in bits:
        data[bit // 8] ^= 1 << bit % 8
    decoder = StreamDecoder()
    received = decoder.feed(bytes(data) + b"\0")
    assert (1, frame) not in received
    for _, other in received:  # possible only where the stuffing was hit and the CRC collided
        assert other != frame


@given(st.lists(FRAMES, min_size=3, max_size=8), st.data())
def test_lost_bytes_cost_only_the_frames_they_belong_to(
    contents: list[frames.Frame], draw: st.DataObject
) -> None:
    contents = [frame for frame in contents if not isinstance(frame, frames.Hello)]
    sent = numbered([frames.Start(), *contents, frames.Heartbeat(1), frames.Stop()])
    pieces = [frames.encode(frame, number) for number, frame in sent]
    victim = draw.draw(st.integers(1, len(sent) - 2))
    lost = draw.draw(st.integers(0, len(pieces[victim]) - 2))  # not the delimiter
    pieces[victim] = pieces[victim][:lost] + pieces[victim][lost + 1 :]
    decoder = StreamDecoder()
    received = decoder.feed(b"".join(pieces))
    assert received == sent[:victim] + sent[victim + 1 :]
    assert decoder.errors == 1


def test_a_lost_delimiter_costs_two_frames() -> None:
    sent = numbered([frames.Heartbeat(n) for n in range(5)])
    pieces = [frames.encode(frame, number) for number, frame in sent]
    pieces[1] = pieces[1][:-1]
    decoder = StreamDecoder()
    assert decoder.feed(b"".join(pieces)) == [sent[0], sent[3], sent[4]]
    assert decoder.errors == 2


def test_endless_noise_is_not_kept() -> None:
    decoder = StreamDecoder()
    for _ in range(100):
        assert decoder.feed(b"\x55" * 1000) == []
    assert len(decoder._rest) <= frames.MAX_STUFFED_BYTES
    assert decoder.feed(b"\0" + frames.encode(frames.Start(), 3)) == [(3, frames.Start())]
    assert decoder.errors == 1


def test_hello_starts_a_new_count() -> None:
    decoder = StreamDecoder()
    hello = frames.Hello(1, 0, b"x" * 16, 0, 0, 0, 0)
    decoder.feed(frames.encode(frames.Start(), 5000))
    assert decoder.feed(frames.encode(hello, 0)) == [(0, hello)]
    assert decoder.errors == 0


def test_frames_that_came_before_are_none_until_a_hello() -> None:
    """A buffer on the way that sends the newest ones over and over is no living board."""
    decoder = StreamDecoder()
    old = b"".join(frames.encode(frames.Sample(n, n, n, 0), n) for n in range(5000, 5010))
    assert len(decoder.feed(old)) == 10
    assert decoder.feed(old + old) == []
    assert decoder.errors == 20
    hello = frames.Hello(1, 0, b"x" * 16, 0, 0, 0, 0)
    decoder.feed(frames.encode(hello, 4999))
    assert len(decoder.feed(old)) == 10


def test_unknown_type_and_wrong_length_are_refused() -> None:
    for body in (b"\x7f\0\0", b"\x13\0\0\0", b"\x02\0\0", b""):
        assert frames.decode(cobs.encode(body + crc16(body).to_bytes(2, "little"))) is None


def test_a_field_too_wide_is_an_error_of_the_sender() -> None:
    with pytest.raises(struct.error):
        frames.encode(frames.Sample(2**32, 0, 0, 0), 0)


def test_hello_text() -> None:
    hello = frames.Hello(1, frames.firmware(2, 10, 3), b"board-a", 5, 1000, 4096, 0)
    received = frames.decode(frames.encode(hello, 0)[:-1])
    assert received is not None
    assert isinstance(received.frame, frames.Hello)
    assert received.frame.board_name == "board-a"
    assert received.frame.firmware_version == "2.10.3"


def test_layout_as_documented() -> None:
    """A change here is a new PROTOCOL: boards in the field would no longer be understood."""
    assert frames.PROTOCOL == 2
    sample = frames.encode(frames.Sample(0x04030201, 0x08070605, -2, 0x0A09), 0x0C0B)
    body = bytes.fromhex("02 0b0c 01020304 05060708 feffffff 090a")
    assert cobs.decode(sample[:-1]) == body + crc16(body).to_bytes(2, "little")
    assert frames.LAYOUT_HASH == 267805873
    assert int(BridgeStatus.FAULT) < 1 << 16
