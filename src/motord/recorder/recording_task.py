"""What to record, as the supervisor asks for it and the recorder keeps it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class RecordingTask:
    """A recording: files `stem`-000.mcap and so on, from `first_tick` if the ring still has it."""

    stem: Path
    metadata: Mapping[str, Any]
    first_tick: int | None = None
