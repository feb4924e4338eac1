"""What is missing of a recording, in numbers and as text."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

LINES_MAX = 12
"""Losses that a list shows, each on a line of its own."""
ON_A_LINE_MAX = 3
"""Losses that are shown where there is one line for all."""
REASONS_MAX = 2
"""Reasons that are shown of a stretch of losses."""
GAP_NS = 10_000_000
"""What is lost on both sides of so short a time is one loss: ticks are as far apart."""
_NEVER_NS = 1 << 64


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
    be read, None where there is none; of a chunk that is in the index, the times of its messages.
    `messages` is false if only indexes are gone, no messages.
    """

    offset: int
    size: int
    reason: str
    from_ns: int | None = None
    to_ns: int | None = None
    messages: bool = True

    def __str__(self) -> str:
        where = f"{self.size} bytes from byte {self.offset} on: " if self.size else ""
        return f"{where}{self.reason}; {self.missing}"

    @property
    def missing(self) -> str:
        """Which messages are missing, as a clause."""
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

    def lines(self, most: int = LINES_MAX) -> list[str]:
        """Return a line of text for each stretch of time, in order; `most` and how many more.

        What is lost of one stretch, as several topics may be, is one line.
        """
        stretches = list(_stretches(self.losses))
        lines = [_words(stretch) for stretch in stretches[:most]]
        if more := len(stretches) - len(lines):
            lines.append(f"and {more} more, {self.bytes_lost} bytes in all")
        return lines

    def __str__(self) -> str:
        return "; ".join(self.lines(ON_A_LINE_MAX))


def _stretches(losses: Iterable[Loss]) -> Iterator[list[Loss]]:
    """Yield the losses that follow each other in time; those of no messages by themselves, last."""
    stretch: list[Loss] = []
    end_ns = 0
    for loss in sorted((one for one in losses if one.messages), key=_begin_ns):
        if stretch and _begin_ns(loss) > end_ns + GAP_NS:
            yield stretch
            stretch = []
        last_ns = _NEVER_NS if loss.to_ns is None else loss.to_ns
        end_ns = max(end_ns, last_ns) if stretch else last_ns
        stretch.append(loss)
    if stretch:
        yield stretch
    yield from ([loss] for loss in losses if not loss.messages)


def _begin_ns(loss: Loss) -> int:
    return -1 if loss.from_ns is None else loss.from_ns


def _words(stretch: Sequence[Loss]) -> str:
    if len(stretch) == 1:
        return str(stretch[0])
    ends_ns = [loss.to_ns for loss in stretch if loss.to_ns is not None]
    reasons = list(dict.fromkeys(loss.reason for loss in stretch))
    more = [f"{len(reasons) - REASONS_MAX} other reasons"] if len(reasons) > REASONS_MAX else []
    whole = Loss(
        min(loss.offset for loss in stretch),
        sum(loss.size for loss in stretch),
        ", ".join(reasons[:REASONS_MAX] + more),
        stretch[0].from_ns,
        max(ends_ns) if len(ends_ns) == len(stretch) else None,
    )
    return (
        f"{whole.size} bytes in {len(stretch)} parts from byte {whole.offset} on: "
        f"{whole.reason}; {whole.missing}"
    )


def damage_of(losses: Iterable[Loss]) -> Damage | None:
    """Return the account of `losses`, None if there are none."""
    ordered = tuple(sorted(set(losses), key=lambda loss: loss.offset))
    return Damage(ordered) if ordered else None
