"""Summary of a recording: `motord record info`."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from pydantic import ValidationError

from motord.recording import topics
from motord.recording.damage import utc
from motord.recording.reader import Run
from motord.recording.recovery import METADATA_RECOVERED
from motord.recording.topics import CHANNEL_TOPIC
from motord.shm.timing import KIND, TimingSummary, total

_FROM_METADATA = (
    *("bench", "motor", "plan", "calibration", "calibration_findings", "notes", "blackbox"),
)


def describe(run: Run, *, check: bool = False) -> dict[str, Any]:
    """Return what `record info` prints, ready for JSON; times are Unix ns and UTC text.

    Of a file that was closed only the index and the events are read, unless `check` asks for all,
    or its ticks are not those that it had then.
    """
    if check:
        run.check()
    events, recovered = run.events(), run.source.metadata(METADATA_RECOVERED)
    span = (None if recovered or run.damage else _noted_span(run)) or _counted_span(run)
    if any(event["kind"] == "loop_restarted" for event in events):
        span["ticks_missing"] = None  # the counter began anew
    operating_points = run.operating_points()
    structure = run.source.structure
    facts: dict[str, Any] = {
        "file": str(run.path),
        "bytes": structure.size,
        "chunks": len(structure.chunks),
        **{key: run.metadata[key] for key in _FROM_METADATA if key in run.metadata},
        **span,
        "timing": _timing(events),
        "events": _count(run, topics.EVENTS.name),
        "plan_messages": _count(run, topics.PLANS.name),
        "channels": [
            {"name": name, "unit": one.unit, "readings": _count(run, f"{CHANNEL_TOPIC}{name}")}
            for name, one in run.channels().items()
        ],
        "operating_points": operating_points,
        "columns": list(run.columns),
    }
    if recovered:
        facts["recovered"] = recovered
    damage = run.damage
    facts["damage"] = str(damage) if damage else None
    facts["losses"] = damage.lines() if damage else []
    return facts


def _noted_span(run: Run) -> dict[str, Any] | None:
    """Return what the writer noted when it closed the file, None if it did not."""
    if not run.source.structure.indexed:
        return None
    if run.end.get("ticks") == 0:
        return {"ticks": 0}
    keys = ("ticks", "tick_first", "t_start_ns", "tick_last", "t_end_ns")
    noted = [value for key in keys if isinstance(value := run.end.get(key), int)]
    return _span(*noted) if len(noted) == len(keys) else None


def _counted_span(run: Run) -> dict[str, Any]:
    count, first, last = 0, None, None
    for block in run.blocks(["tick", "t_ns"]):
        count += len(block)
        first, last = first or block[0].item(), block[-1].item()
    return {"ticks": 0} if first is None or last is None else _span(count, *first, *last)


def _span(
    count: int, tick_first: int, start_ns: int, tick_last: int, end_ns: int
) -> dict[str, Any]:
    """Return the facts of `count` ticks, the first and the last of them as given."""
    duration_s = (end_ns - start_ns) / 1e9
    return {
        "ticks": count,
        "tick_first": tick_first,
        "tick_last": tick_last,
        "ticks_missing": tick_last - tick_first + 1 - count,
        "start": utc(start_ns),
        "t_start_ns": start_ns,
        "t_end_ns": end_ns,
        "duration_s": duration_s,
        "rate_Hz": (count - 1) / duration_s if duration_s > 0 else None,
    }


def _timing(events: Iterable[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the timing of the loop, None if the file has none."""
    parts: list[TimingSummary] = []
    for event in (one for one in events if one["kind"] == KIND):
        with suppress(ValidationError):  # what another program calls so
            parts.append(TimingSummary.model_validate(event.get("data")))
    if not parts:
        return None
    whole = total(parts)
    return {"words": whole.line(), **whole.model_dump(mode="json")}


def _count(run: Run, topic: str) -> int:
    channel = run.source.number(topic)
    if channel is None:
        return 0
    if run.source.structure.indexed:
        return run.source.structure.counts.get(channel, 0)
    chunks = run.source.read(run.source.chunks(channel))
    return sum(part.channel == channel for chunk in chunks for part in chunk.messages)
