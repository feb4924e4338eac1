"""Frames, stuffing, checksums and pieces: the firmware and motord agree byte for byte."""

from binascii import crc32
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tools import bridge_layout

from motord.wire.bridge import cobs, frames
from motord.wire.bridge.layout import LAYOUTS, PROTOCOL
from motord.wire.bridge.segmentation import PieceDecoder, split
from motord.wire.bridge.stream import StreamDecoder
from motord.wire.crc import crc16
from motord.wire.sequence import SequenceCheck
from tests.firmware.library import Library
from tests.support.properties import examples
from tests.unit.wire.test_frames import FRAMES, KINDS, U16

BODIES = st.builds(frames.pack, FRAMES, U16)


def c_frame(library: Library, frame: frames.Frame, sequence: int) -> Any:
    out = library.ffi.new("union bridge_frame *")
    name = type(frame).__name__
    out.type, out.sequence = LAYOUTS[name][0], sequence
    for field, value in zip(frame._fields, frame, strict=True):
        setattr(getattr(out, name), field, value)
    return out


def python_frame(frame: Any) -> frames.Numbered:
    name = next(name for name, (code, _) in LAYOUTS.items() if code == frame.type)
    kind = getattr(frames, name)
    fields = (getattr(getattr(frame, name), field) for field in kind._fields)
    values = (bytes(v) if not isinstance(v, int) else v for v in fields)
    return frames.Numbered(frame.sequence, kind._make(values))


def unpacked(library: Library, body: bytes) -> frames.Numbered | None:
    out = library.ffi.new("union bridge_frame *")
    return python_frame(out) if library.lib.frame_unpack(body, len(body), out) else None


def test_the_layout_module_is_up_to_date() -> None:
    assert bridge_layout.main(["--check"]) == 0


def test_both_sides_have_one_layout_hash(library: Library) -> None:
    assert library.lib.frame_layout_hash() == frames.LAYOUT_HASH
    assert max(frames.BODY_BYTES.values()) == library.lib.BRIDGE_BODY_MAX
    assert min(frames.BODY_BYTES.values()) == library.lib.BRIDGE_BODY_MIN
    assert library.lib.STREAM_STUFFED_MAX == frames.MAX_STUFFED_BYTES
    assert PROTOCOL == frames.PROTOCOL


def test_status_bits_are_motords(library: Library) -> None:
    from motord.schema import BridgeStatus

    for bit in BridgeStatus:
        assert getattr(library.lib, f"BRIDGE_STATUS_{bit.name}") == bit


@pytest.mark.parametrize("kind", KINDS)
def test_every_frame_both_ways(library: Library, kind: st.SearchStrategy[Any]) -> None:
    @given(kind, U16)
    def there_and_back(frame: frames.Frame, sequence: int) -> None:
        out = library.ffi.new("uint8_t[64]")
        size = library.lib.frame_pack(c_frame(library, frame, sequence), out)
        body = frames.pack(frame, sequence)
        assert bytes(out)[:size] == body
        assert library.lib.frame_body_bytes(body[0]) == size
        assert unpacked(library, body) == (sequence, frame)
        size = library.lib.stream_write(body, len(body), out)
        assert bytes(out)[:size] == frames.encode(frame, sequence)

    there_and_back()


def test_only_the_protocols_types_are_packed(library: Library) -> None:
    frame = library.ffi.new("union bridge_frame *")
    codes = {code for code, _ in LAYOUTS.values()}
    out = library.ffi.new("uint8_t[64]")
    for code in set(range(256)) - codes:
        frame.type = code
        assert library.lib.frame_pack(frame, out) == 0
        assert library.lib.frame_body_bytes(code) == 0


@given(
    st.sampled_from([*sorted(frames.BODY_BYTES), 0, 4, 16, 22, 255]),
    st.integers(0, 50),
    st.randoms(use_true_random=False),
)
@settings(max_examples=examples(300))
def test_a_right_checksum_with_a_wrong_length_is_refused(
    library: Library, code: int, size: int, random: Any
) -> None:
    body = bytes((code,)) + random.randbytes(size)
    body += crc16(body).to_bytes(2, "little")
    assert unpacked(library, body) == frames.unpack(body)


def test_every_short_and_long_body_of_every_type_is_refused(library: Library) -> None:
    for code, right in frames.BODY_BYTES.items():
        for size in set(range(3, 64)) - {right}:
            body = bytes((code,)) + bytes(size - 3)
            body += crc16(body).to_bytes(2, "little")
            assert unpacked(library, body) is None
    assert not library.lib.frame_unpack(b"", 0, library.ffi.new("union bridge_frame *"))


@given(st.binary(max_size=300))
def test_checksums(library: Library, data: bytes) -> None:
    lib = library.lib
    assert lib.crc16(data, len(data)) == crc16(data)
    half = len(data) // 2
    before = lib.crc32(0, data[:half], half)
    assert lib.crc32(before, data[half:], len(data) - half) == crc32(data)


@given(st.binary(max_size=43) | st.lists(st.sampled_from([0, 1, 255]), max_size=253).map(bytes))
def test_stuffing(library: Library, data: bytes) -> None:
    out = library.ffi.new("uint8_t[]", 260)
    size = library.lib.cobs_encode(data, len(data), out)
    stuffed = bytes(out)[:size]
    assert stuffed == cobs.encode(data)
    size = library.lib.cobs_decode(out, size)
    assert bytes(out)[:size] == data


@given(st.lists(st.integers(0, 9) | st.integers(0, 255), max_size=44).map(bytes))
def test_unstuffing_anything(library: Library, data: bytes) -> None:
    out = library.ffi.new("uint8_t[]", data + b"\0")
    size = library.lib.cobs_decode(out, len(data))
    assert bytes(out)[:size] == (cobs.decode(data) or b"")


class StreamTwins:
    """Both sides' decoders of a stream, fed the same."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._python = StreamDecoder()
        self._c = library.ffi.new("struct link_receiver *")
        library.lib.link_receiver_init(self._c, 0)
        self._frame = library.ffi.new("union bridge_frame *")
        self._what = library.ffi.new("enum received *")

    def feed(self, data: bytes) -> None:
        lib, got = self._library.lib, []
        at = 0
        while at < len(data):
            rest = data[at:]
            at += lib.link_receive(self._c, rest, len(rest), self._what, self._frame)
            if self._what[0] == lib.RECEIVED_FRAME:
                numbered = python_frame(self._frame)
                if type(numbered.frame) is frames.Hello:
                    lib.sequence_restart(lib_check(self))
                if lib.sequence_accept(lib_check(self), numbered.sequence, False):
                    got.append(numbered)
        assert got == self._python.feed(data)
        assert lib.sequence_errors(lib_check(self)) == self._python.errors


def lib_check(twins: StreamTwins) -> Any:
    return twins._library.ffi.addressof(twins._c.check)


PIECES_OF_STREAM = st.lists(
    st.builds(frames.encode, FRAMES, st.integers(0, 5))
    | st.builds(lambda data, cut: data[cut:], st.builds(frames.encode, FRAMES, U16), U16)
    | st.binary(max_size=60)
    | st.just(b"\0\0"),
    max_size=12,
)


@given(PIECES_OF_STREAM, st.lists(st.integers(0, 400), max_size=8))
@settings(max_examples=examples(300))
def test_both_decoders_take_the_same_from_any_stream(
    library: Library, parts: list[bytes], cuts: list[int]
) -> None:
    data = b"".join(parts) + b"\0"
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    twins = StreamTwins(library)
    for start, end in pairwise(edges):
        twins.feed(data[start:end])


def c_split(library: Library, body: bytes, number: int, piece_bytes: int) -> list[bytes]:
    offset, piece_number = library.ffi.new("uint8_t *"), library.ffi.new("uint8_t *", number)
    out = library.ffi.new("uint8_t[64]")
    pieces = []
    while offset[0] < len(body):
        size = library.lib.piece_split(body, len(body), piece_bytes, offset, piece_number, out)
        pieces.append(bytes(out)[:size])
    assert piece_number[0] == (number + len(pieces)) % 64
    return pieces


@given(st.binary(min_size=1, max_size=200), st.integers(0, 63), st.sampled_from([8, 64]))
def test_both_sides_cut_the_same_pieces(
    library: Library, body: bytes, number: int, size: int
) -> None:
    assert c_split(library, body, number, size) == split(body, number, size)


class PieceTwins:
    """Both sides' decoders of pieces, fed the same."""

    def __init__(self, library: Library) -> None:
        self._lib, self._new = library.lib, library.ffi.new
        self._python = PieceDecoder()
        self._joiner = self._new("struct piece_joiner *")
        self._lib.piece_reset(self._joiner)
        self._frame = self._new("union bridge_frame *")
        self._check = SequenceCheck(frames.SEQUENCE_MODULUS)

    def feed(self, piece: bytes) -> None:
        what = self._lib.piece_take(self._joiner, piece, len(piece), self._frame)
        if self._joiner.lost:
            self._check.corrupt()
        if what == self._lib.RECEIVED_CORRUPT:
            self._check.corrupt()
        got = None
        if what == self._lib.RECEIVED_FRAME:
            numbered = python_frame(self._frame)
            if type(numbered.frame) is frames.Hello:
                self._check.restart()
            got = numbered if self._check.accept(numbered.sequence, may_restart=False) else None
        assert got == self._python.feed(piece)
        assert self._check.errors == self._python.errors


@st.composite
def hurt_pieces(draw: st.DrawFn) -> list[bytes]:
    """Return the pieces of some frames; some are lost, repeated, changed or out of place."""
    number, pieces = draw(st.integers(0, 63)), []
    for body in draw(st.lists(BODIES, max_size=5)):
        new = split(body, number, draw(st.sampled_from([8, 8, 64])))
        number = (number + len(new)) % 64
        pieces += new
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(pieces)))
        kind = draw(st.sampled_from(["drop", "noise", "head", "byte", "grow", "cut"]))
        if kind == "noise" or at == len(pieces):
            pieces.insert(at, draw(st.binary(max_size=66)))
        elif kind == "drop":
            del pieces[at]
        elif not pieces[at]:
            continue
        elif kind == "head":
            pieces[at] = bytes((draw(st.integers(0, 255)),)) + pieces[at][1:]
        elif kind == "byte":
            where = draw(st.integers(0, len(pieces[at]) - 1))
            pieces[at] = pieces[at][:where] + b"\x15" + pieces[at][where + 1 :]
        elif kind == "grow":
            pieces[at] += bytes(draw(st.integers(1, 8)))
        else:
            pieces[at] = pieces[at][: draw(st.integers(0, len(pieces[at])))]
    return pieces


@given(hurt_pieces())
@settings(max_examples=examples(400))
def test_both_joiners_take_the_same_from_any_pieces(library: Library, pieces: list[bytes]) -> None:
    twins = PieceTwins(library)
    for piece in pieces:
        twins.feed(piece)


STEPS = st.sampled_from([0, 1, 1, 1, 2, 3, 32767, 32768, 32769, 32770, 65534, 65535])


@given(st.lists(st.tuples(st.sampled_from("aaacr"), STEPS), max_size=30))
@settings(max_examples=examples(300))
def test_both_sides_count_the_same_errors(library: Library, steps: list[tuple[str, int]]) -> None:
    check, twin = library.ffi.new("struct sequence_check *"), SequenceCheck(1 << 16)
    number = 0
    for kind, step in steps:
        if kind == "a":
            number = (number + step) % 65536
            taken = library.lib.sequence_accept(check, number, True)
            assert taken == twin.accept(number)
        elif kind == "c":
            library.lib.sequence_corrupt(check)
            twin.corrupt()
        else:
            library.lib.sequence_restart(check)
            twin.restart()
        assert library.lib.sequence_errors(check) == twin.errors


@pytest.mark.parametrize(
    ("step", "taken"), [(0, True), (1, True), (0x8000, True), (0x8001, False), (0xFFFF, False)]
)
def test_a_step_back_is_refused_where_no_sender_may_start_anew(
    library: Library, step: int, taken: bool
) -> None:
    check = library.ffi.new("struct sequence_check *")
    assert library.lib.sequence_accept(check, 100, False)  # the first is always taken
    assert library.lib.sequence_accept(check, (101 + step) % 65536, False) == taken
    expected = (102 + step) % 65536 if taken else 101
    assert check.expected == expected


def test_pieces_of_every_length(library: Library) -> None:
    for length in range(1, 254):
        body = bytes(number % 251 for number in range(length))
        for size in (8, 64):
            assert c_split(library, body, length % 64, size) == split(body, length % 64, size)


@pytest.mark.parametrize(
    "piece", [b"", b"\xc0", b"\xc0" + bytes(64), bytes((0x80, 0x15)) + bytes(20), b"\x41\0\0"]
)
def test_what_is_no_piece(library: Library, piece: bytes) -> None:
    for before in ([], split(frames.pack(frames.Configure(1, 2), 3), 0)[:1]):
        twins = PieceTwins(library)
        for data in (*before, piece, b"\xc5", *split(frames.pack(frames.Stop(), 9), 30)):
            twins.feed(data)
