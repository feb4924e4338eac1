"""The page of the interlocks: what trips, at what limit, after how long, and what to do then."""

from tools.reference.markdown import code, page, table

from motord.api.descriptions import TRIP_ACTION
from motord.config.sections import Sections
from motord.config.text.descriptions import section_of
from motord.control.interlock_table import INTERLOCKS, EvidenceSource, Interlock

SOURCES = {
    EvidenceSource.LOOP: "ticks",
    EvidenceSource.BRIDGE: "samples of the bridge",
    EvidenceSource.INVERTER: "feedback of the inverter",
}
INTRO = """In the order in which the first of several causes of one tick is chosen. *May last*: for
how long the condition may hold without a trip; one that is interrupted starts over, or this time is
counted *up and down*, down while it does not hold. *Evidence*: new ones of these show whether it
does. How they work, and what each fault leads to: [Faults](../faults.md). Limits are keys of the
[bench file](bench-file.md)."""


def interlocks() -> str:
    """Return the page."""
    rows = [
        (
            str(lock.bit),
            code(lock.trip.name),
            lock.meaning,
            _limits(lock),
            *_lasts(lock),
        )
        for lock in INTERLOCKS
    ]
    actions = [(code(lock.trip.name), TRIP_ACTION[lock.trip]) for lock in INTERLOCKS]
    return page(
        "Interlocks",
        "motord.control.interlock_table",
        INTRO,
        table(("bit", "cause", "trips when", "limit", "may last", "evidence"), rows),
        "## What to do",
        "Before the reset, `motord reset`. State, events and `motord status` say the same.",
        table(("cause", "what to do"), actions),
    )


def _limits(lock: Interlock) -> str:
    return ", ".join(_key(key) for key in lock.limit.split(", ") if key)


def _key(key: str) -> str:
    section, _, name = key.partition(".")
    table = section_of(Sections.model_fields[section])
    assert table is not None
    assert name in table.model_fields, key
    return f"[`{key}`](bench-file.md#{section})"


def _lasts(lock: Interlock) -> tuple[str, str]:
    """Return for how long the condition may hold, and what is evidence of it."""
    if not lock.lasts:
        return "", ""
    lasts = _key(lock.lasts) if isinstance(lock.lasts, str) else f"{1e3 * lock.lasts:g} ms"
    lasts += ", up and down" if lock.counted else ""
    return lasts, SOURCES[lock.source]
