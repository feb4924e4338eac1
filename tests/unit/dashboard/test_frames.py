"""Messages of the socket, both ways."""

import struct

import numpy as np
import pytest

from motord.dashboard.frames import FrameError, decode, encode, encode_document


@pytest.mark.parametrize("text", ["", "a", "ab", "abc", "Grüße"])
def test_what_is_encoded_is_decoded(text):
    floats = np.array([[1.0, np.nan], [-np.inf, 2.5]], np.float32)
    message = encode({"kind": "trace", "text": text}, floats)
    header, found = decode(message)
    assert header == {"kind": "trace", "text": text}
    np.testing.assert_array_equal(found, floats.ravel())
    assert len(message) % 4 == 0


def test_a_document_is_passed_on_as_it_is():
    header, floats = decode(encode_document("state", b'{"state": "OFF", "x": null}'))
    assert header == {"kind": "state", "data": {"state": "OFF", "x": None}}
    assert len(floats) == 0


def framed(header):
    padded = header + b" " * (-len(header) % 4)
    return struct.pack("<I", len(padded)) + padded


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (b"", "too short"),
        (b"\x08\x00\x00", "too short"),
        (b"\xff\xff\xff\xff" + b"{}  ", "4294967295 bytes in a message of 8"),
        (struct.pack("<I", 2) + b"{}", "multiples of 4"),
        (framed(b'{"kind":"ping"}') + b"\0", "multiples of 4"),
        (framed(b"{"), "not JSON"),
        (framed(b"\xff\xfe\xfd\xfc"), "not JSON"),
        (framed(b"[" * 50_000), "not JSON"),
        (framed(b"[]"), "no JSON object"),
        (framed(b'{"kind": 1}'), "no JSON object"),
        (framed(b"null"), "no JSON object"),
    ],
)
def test_a_malformed_message_is_reported_as_such(message, expected):
    with pytest.raises(FrameError, match=expected):
        decode(message)
