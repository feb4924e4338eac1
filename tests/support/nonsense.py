"""Lines that a broken or hostile process may send in the place of a message."""

import json
import random
from typing import Any

LINE_MAX_BYTES = 20_000

_DEEP = (b"[" * 10_000, b'{"a":' * 3_000, b'{"recording":' + b"[" * 5_000 + b"]" * 5_000 + b"}")
_NUMBERS = (b"9" * 5000, b"-1e999", b"NaN", b"1e-400", b"0x10", b"18446744073709551616")
_WORDS = (
    "recording",
    "ticks",
    "file",
    "error",
    "blackboxes",
    "message",
    "data",
    "kind",
    "who",
    "do",
)
_VALUES: tuple[Any, ...] = (True, None, -1, 1 << 70, 0.5, "x", "\ud800", [], [1], {}, {"kind": 1})


def random_line(chance: random.Random) -> bytes:
    """Return bytes that are no message of a child, perhaps with newlines in them."""
    return (_bytes, _deep, _number, _wrong, _cut, _text)[chance.randrange(6)](chance)


def _bytes(chance: random.Random) -> bytes:
    return chance.randbytes(chance.randrange(200))


def _deep(chance: random.Random) -> bytes:
    return chance.choice(_DEEP)[:LINE_MAX_BYTES]


def _number(chance: random.Random) -> bytes:
    return b'{"recording":true,"ticks":' + chance.choice(_NUMBERS) + b',"x":1}'


def _wrong(chance: random.Random) -> bytes:
    words = chance.sample(_WORDS, 3)
    content = {word: chance.choice(_VALUES) for word in words}
    return json.dumps({**content, "no message": 1}).encode()


def _cut(chance: random.Random) -> bytes:
    whole = b'{"recording":true,"file":"runs/x-000.mcap","ticks":12,"error":""}'
    return whole[: chance.randrange(1, len(whole) - 1)]


def _text(chance: random.Random) -> bytes:
    return b"Traceback (most recent call last):" + b" " * chance.randrange(LINE_MAX_BYTES - 100)
