import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from motord.wire.bridge import cobs

# few values, so that zeros and long runs without zero both are common
BYTES = st.one_of(
    st.binary(max_size=600),
    st.lists(st.sampled_from([0, 1, 1, 255]), max_size=40).map(bytes),
    st.tuples(st.integers(0, 520), st.binary(max_size=4)).map(lambda t: b"\x01" * t[0] + t[1]),
)


@given(BYTES)
@example(b"\xff" + b"\x01" * 254)
@example(b"\x01" * 254)
def test_there_and_back_without_zeros(data: bytes) -> None:
    stuffed = cobs.encode(data)
    assert 0 not in stuffed
    assert cobs.decode(stuffed) == data
    assert len(data) + 1 <= len(stuffed) <= len(data) + 1 + len(data) // 254


@pytest.mark.parametrize(
    ("plain", "stuffed"),
    [  # the examples of the paper and of its common test vectors
        (b"", b"\x01"),
        (b"\0", b"\x01\x01"),
        (b"\0\0", b"\x01\x01\x01"),
        (b"\x11\x22\0\x33", b"\x03\x11\x22\x02\x33"),
        (b"\x11\0\0\0", b"\x02\x11\x01\x01\x01"),
        (bytes(range(1, 255)), b"\xff" + bytes(range(1, 255))),
        (bytes(range(255)), b"\x01\xff" + bytes(range(1, 255))),
        (bytes(range(1, 256)), b"\xff" + bytes(range(1, 255)) + b"\x02\xff"),
    ],
)
def test_known_vectors(plain: bytes, stuffed: bytes) -> None:
    assert cobs.encode(plain) == stuffed
    assert cobs.decode(stuffed) == plain


@pytest.mark.parametrize("stuffed", [b"\x03\x11", b"\xff", b"\x02\x11\x00", b"\x05abc"])
def test_what_was_never_stuffed_is_refused(stuffed: bytes) -> None:
    assert cobs.decode(stuffed) is None


@given(st.binary(max_size=300))
def test_any_bytes_decode_or_are_refused(data: bytes) -> None:
    decoded = cobs.decode(data)
    assert decoded is None or len(decoded) <= len(data)
