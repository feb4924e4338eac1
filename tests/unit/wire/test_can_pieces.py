import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.wire.bridge import frames
from motord.wire.bridge.segmentation import (
    FIRST,
    LAST,
    PIECE_NUMBERS,
    PieceDecoder,
    PieceJoiner,
    split,
)
from motord.wire.can.frame_format import CLASSIC_BYTES, FD_BYTES
from tests.unit.wire.test_frames import FRAMES

SIZES = st.sampled_from([CLASSIC_BYTES, FD_BYTES])
FD_LENGTHS = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64}
STATUS = frames.Status(1, 2, 3, 4, 5, 6, 7, 8, 9, 1)
HEARTBEAT = frames.Heartbeat(1)


def pieces_of(contents: list[frames.Frame], size: int, number: int = 0) -> list[list[bytes]]:
    out = []
    for sequence, frame in enumerate(contents):
        out.append(split(frames.pack(frame, sequence), number, size))
        number = (number + len(out[-1])) % PIECE_NUMBERS
    return out


def flat(bodies: list[list[bytes]]) -> list[bytes]:
    return [piece for body in bodies for piece in body]


def decoded(decoder: PieceDecoder, pieces: list[bytes]) -> list[frames.Numbered]:
    return [frame for frame in map(decoder.feed, pieces) if frame is not None]


@given(FRAMES, st.integers(0, 63), SIZES)
def test_pieces_fit_can_and_join(frame: frames.Frame, number: int, size: int) -> None:
    body = frames.pack(frame, 7)
    pieces = split(body, number, size)
    assert all(2 <= len(piece) <= size and len(piece) in FD_LENGTHS for piece in pieces)
    assert [piece[0] % 64 for piece in pieces] == [(number + i) % 64 for i in range(len(pieces))]
    assert [bool(piece[0] & FIRST) for piece in pieces] == [True] + [False] * (len(pieces) - 1)
    assert [bool(piece[0] & LAST) for piece in pieces] == [False] * (len(pieces) - 1) + [True]
    joiner = PieceJoiner()
    assert [joiner.feed(piece) for piece in pieces] == [None] * (len(pieces) - 1) + [body]
    assert joiner.errors == 0


def test_classic_pieces_are_exact() -> None:
    pieces = split(frames.pack(HEARTBEAT, 1), 5)
    assert [len(piece) for piece in pieces] == [7]
    assert pieces[0][0] == FIRST | LAST | 5
    assert [len(piece) for piece in split(frames.pack(STATUS, 1), 0)] == [8, 8, 8, 8, 8, 4]


def test_fd_pieces_are_filled_with_zeros() -> None:
    (piece,) = split(frames.pack(STATUS, 1), 0, FD_BYTES)
    assert len(piece) == 48
    assert piece[39:] == bytes(9)


@given(st.lists(FRAMES, min_size=1, max_size=8), SIZES)
def test_frames_there_and_back(contents: list[frames.Frame], size: int) -> None:
    decoder = PieceDecoder()
    sent = [frames.Numbered(number, frame) for number, frame in enumerate(contents)]
    assert decoded(decoder, flat(pieces_of(contents, size))) == sent
    assert decoder.errors == 0


@given(st.lists(st.sampled_from([STATUS, HEARTBEAT]), min_size=3, max_size=8), st.data())
def test_lost_pieces_cost_their_frames_and_count_once_each(
    contents: list[frames.Frame], data: st.DataObject
) -> None:
    """The first and the last frame come whole, so that the numbers show what is missing."""
    bodies = pieces_of(contents, CLASSIC_BYTES)
    hit = set()
    kept = []
    for index, body in enumerate(bodies):
        inner = 0 < index < len(bodies) - 1
        lost = data.draw(st.sets(st.integers(0, len(body) - 1))) if inner else set()
        if lost:
            hit.add(index)
        kept += [piece for number, piece in enumerate(body) if number not in lost]
    decoder = PieceDecoder()
    got = [frame.sequence for frame in decoded(decoder, kept)]
    assert got == [index for index in range(len(bodies)) if index not in hit]
    assert decoder.errors == len(hit)


def test_head_and_tail_of_two_bodies_do_not_join() -> None:
    first, second = pieces_of([STATUS, STATUS], CLASSIC_BYTES)
    joiner = PieceJoiner()
    assert [joiner.feed(piece) for piece in first[:2] + second[2:]] == [None] * 6
    assert joiner.errors == 1


def test_a_receiver_that_comes_late_starts_with_the_next_frame() -> None:
    first, second = pieces_of([STATUS, STATUS], CLASSIC_BYTES)
    decoder = PieceDecoder()
    assert [f.sequence for f in decoded(decoder, first[2:] + second)] == [1]
    assert decoder.errors == 1


def test_a_repeated_frame_is_left_out() -> None:
    (one,) = pieces_of([HEARTBEAT], CLASSIC_BYTES)
    decoder = PieceDecoder()
    assert len(decoded(decoder, one + one)) == 1
    assert decoder.errors == 1


def test_a_hello_starts_a_new_count() -> None:
    hello = frames.Hello(1, 1, bytes(16), 1, 1, 1, 1)
    decoder = PieceDecoder()
    decoded(decoder, split(frames.pack(HEARTBEAT, 900), 0) + split(frames.pack(hello, 3), 0))
    assert decoder.errors == 0


@pytest.mark.parametrize(
    "piece",
    [
        b"",
        b"\xc0",
        bytes((0xC0, 0x99, 1)),  # no such type
        bytes((0xC0, 0x15, 1)),  # too short
        split(frames.pack(HEARTBEAT, 0), 0)[0] + b"\0",  # classic: exact
        split(frames.pack(STATUS, 0), 0, FD_BYTES)[0][:-1] + b"\1",  # filled with something
        split(frames.pack(STATUS, 0), 0, FD_BYTES)[0] + bytes(17),  # longer than CAN FD
        split(frames.pack(HEARTBEAT, 0), 0)[0].replace(b"\xc0", b"\x80") + b"\0\0",  # goes on
    ],
)
def test_what_is_no_piece_is_one_error(piece: bytes) -> None:
    decoder = PieceDecoder()
    assert decoder.feed(piece) is None
    assert decoder.errors == 1


def test_a_body_that_does_not_end_is_given_up() -> None:
    whole = split(frames.pack(HEARTBEAT, 0), 0)[0]
    joiner = PieceJoiner()
    assert joiner.feed(bytes((FIRST,)) + whole[1:]) is None  # complete, but not the last piece
    assert joiner.errors == 0
    assert joiner.feed(bytes((LAST | 1, 0))) is None
    assert joiner.errors == 1


def test_a_corrupt_body_is_not_taken() -> None:
    (piece,) = split(frames.pack(HEARTBEAT, 0), 0)
    decoder = PieceDecoder()
    assert decoder.feed(piece[:-1] + bytes((piece[-1] ^ 1,))) is None
    assert decoder.errors == 1


@given(st.lists(st.binary(max_size=12), max_size=20), st.integers(0, 50))
def test_in_step_again_after_noise(noise: list[bytes], number: int) -> None:
    decoder = PieceDecoder()
    decoded(decoder, noise)
    frame = frames.Numbered(number, STATUS)
    assert decoded(decoder, split(frames.pack(STATUS, number), 9)) == [frame]
