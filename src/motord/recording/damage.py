"""What is missing of a recording, in numbers and as text."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime


def utc(t_ns: int) -> str:
    """Return a Unix time in ns as ISO 8601 with ms; "an unknown time" if it is out of range."""
    try:
        moment = datetime.fromtimestamp(t_ns // 1_000_000_000, UTC)
    except (OverflowError, ValueError, OSError):
        return "an unknown time"
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{t_ns // 1_000_000 % 1000:03d}Z"


@dataclass(frozen=True)
class Loss:
    """A part of the file that cannot be read: `size` bytes at byte `offset`, and why.

    `from_ns` and `to_ns` (Unix ns) are the last time before it and the first after it that could
    be read, None where there is none. `messages` is false if only indexes are gone, no messages.
    """

    offset: int
    size: int
    reason: str
    from_ns: int | None = None
    to_ns: int | None = None
    messages: bool = True

    def __str__(self) -> str:
        where = f"{self.size} bytes from byte {self.offset} on: {self.reason}"
        return f"{where}; {self._missing()}"

    def _missing(self) -> str:
        if not self.messages:
            return "no messages are missing"
        if self.from_ns is None and self.to_ns is None:
            return "all that was in it is missing"
        if self.from_ns is None:
            return f"anything before {utc(self.to_ns or 0)} is missing"
        if self.to_ns is None:
            return f"anything after {utc(self.from_ns)} is missing"
        return f"anything between {utc(self.from_ns)} and {utc(self.to_ns)} is missing"


@dataclass(frozen=True)
class Damage:
    """All losses of a file, in the order of their places in it."""

    losses: tuple[Loss, ...]

    @property
    def bytes_lost(self) -> int:
        """Bytes that cannot be read."""
        return sum(loss.size for loss in self.losses)

    @property
    def from_ns(self) -> int | None:
        """Unix ns of the last message before the first loss of messages; None if there is none."""
        times = [loss.from_ns for loss in self.losses if loss.messages]
        return times[0] if times else None

    def __str__(self) -> str:
        return "; ".join(map(str, self.losses))


def damage_of(losses: Iterable[Loss]) -> Damage | None:
    """Return the account of `losses`, None if there are none."""
    ordered = tuple(sorted(set(losses), key=lambda loss: loss.offset))
    return Damage(ordered) if ordered else None
