"""Input nobody expects: bytes, JSON values, text, out of a seeded `random.Random`."""

import random
from typing import Any

ODD_NUMBERS = (0, -0.0, -1, 1e308, -1e308, 5e-324, 2**31, 2**63, -(2**63), 10**30, 1.5, True)
ODD_TEXTS = (
    "", " ", "\0", "\n", "a\nb", "\x1b[2J", "ü", "𝕏", "\u202e", "../../etc/passwd", "nan", "inf",
    "%s%n", "null", "{}", "'; --", "a" * 65, "a" * 5000, "/dev/zero", "/dev/null", "/", "on",
    "2026-03-01T12:00:00", "9999-12-31T23:59:59-01:00",
)  # fmt: skip


def some_bytes(rng: random.Random, longest: int = 200) -> bytes:
    """Return random bytes, sometimes of a few values only."""
    count = rng.randrange(longest)
    if rng.random() < 0.3:
        alphabet = rng.randbytes(3) + b"\0"
        return bytes(rng.choice(alphabet) for _ in range(count))
    return rng.randbytes(count)


def mutate_bytes(rng: random.Random, content: bytes, most: int = 8) -> bytes:
    """Return `content` with a few bits, bytes or pieces changed, moved, lost or doubled."""
    data = bytearray(content)
    for _ in range(rng.randint(1, most)):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(7)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and at < len(data):
            data[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
        elif kind == 2:
            data[at:at] = some_bytes(rng, 16)
        elif kind == 3:
            del data[at : at + rng.randrange(1, 20)]
        elif kind == 4:
            piece = data[at : at + rng.randrange(1, 60)]
            to = rng.randrange(len(data) + 1)
            data[to:to] = piece
        elif kind == 5 and rng.random() < 0.2:
            del data[at:]
        elif at + 8 <= len(data):
            data[at : at + 8] = rng.choice((0, 1, 2**31, 2**63 - 1, 2**64 - 1)).to_bytes(
                8, "little"
            )
    return bytes(data)


def odd_value(rng: random.Random, depth: int = 0) -> Any:
    """Return a JSON value of any kind."""
    kind = rng.randrange(8)
    if kind == 0:
        return rng.choice(ODD_NUMBERS)
    if kind == 1:
        return rng.uniform(-10, 10)
    if kind == 2:
        return rng.choice(ODD_TEXTS)
    if kind == 3:
        return "".join(chr(rng.randrange(0x20, 0x2FF)) for _ in range(rng.randrange(20)))
    if kind == 4 and depth < 3:
        return [odd_value(rng, depth + 1) for _ in range(rng.randrange(4))]
    if kind == 5 and depth < 3:
        return {str(odd_value(rng, 9)): odd_value(rng, depth + 1) for _ in range(rng.randrange(4))}
    return rng.choice((None, True, False, rng.randrange(-5, 5)))


def mutate_json(rng: random.Random, content: Any) -> Any:
    """Return a JSON value with one part replaced, left out or added, somewhere inside."""
    if isinstance(content, dict) and content and rng.random() < 0.9:
        changed = dict(content)
        key = rng.choice(list(changed))
        kind = rng.random()
        if kind < 0.2:
            del changed[key]
        elif kind < 0.3:
            changed[str(odd_value(rng, 9))] = odd_value(rng)
        else:
            changed[key] = mutate_json(rng, changed[key])
        return changed
    if isinstance(content, list) and content and rng.random() < 0.8:
        at = rng.randrange(len(content))
        return [*content[:at], mutate_json(rng, content[at]), *content[at + rng.randrange(2) :]]
    return odd_value(rng)


def mutate_text(rng: random.Random, text: str) -> bytes:
    """Return a text of lines with lines lost, doubled, swapped, values replaced; or its bytes."""
    if rng.random() < 0.3:
        return mutate_bytes(rng, text.encode())
    lines = text.splitlines()
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(lines))
        kind = rng.randrange(5)
        if kind == 0 and len(lines) > 1:
            del lines[at]
        elif kind == 1:
            lines.insert(rng.randrange(len(lines)), lines[at])
        elif kind == 2:
            lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
        elif "=" in lines[at]:
            name, _, value = lines[at].partition("=")
            lines[at] = f"{name}={_odd_toml(rng, value)}"
    return "\n".join(lines).encode("utf-8", "replace")


def _odd_toml(rng: random.Random, value: str) -> str:
    odd = rng.choice(ODD_NUMBERS)
    text = rng.choice(("", "/", "x" * 300))
    return rng.choice(
        (
            f" {str(odd).lower()}", " nan", " -inf", ' "text"', " []", " {}", " true",
            f" [{value}, {value}]", f" -{value.strip()}", f'"{text}"', " 1979-05-27", " [[[[]]]]",
        )
    )  # fmt: skip
