"""Which recordings a result is of, and their plan."""

from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import islice

from motord.recording.plan_columns import PlanValue, common_columns, plan_columns
from motord.recording.reader import Run
from motord.results.error import ResultsError
from motord.results.stored_result import file_digest
from motord.wire.ticks.blocks import Block


def recorded_since(runs: Sequence[Run]) -> datetime:
    """Return when the first of the recordings began. Raises ResultsError without any tick."""
    firsts_ns = [int(block["t_ns"][0]) for run in runs for block in _first_block(run)]
    if not firsts_ns:
        raise ResultsError("no recording with ticks, so nothing to store a result of")
    return datetime.fromtimestamp(min(firsts_ns) // 1000 / 1e6, UTC)


def recorded_digests(runs: Sequence[Run]) -> tuple[tuple[str, str], ...]:
    """Return name and SHA-256 of each recording. Raises OSError."""
    return tuple((run.path.name, file_digest(run.path)) for run in runs)


def recorded_plan(runs: Sequence[Run]) -> dict[str, PlanValue]:
    """Return the plan of the recordings, and those of its settings that they have in common."""
    return common_columns([plan_columns(run.metadata) for run in runs])


def _first_block(run: Run) -> list[Block]:
    return [block for block in islice(run.blocks(("t_ns",)), 1) if len(block)]
