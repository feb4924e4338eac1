"""Status of the loop process, in `loop.json`: at start, when ready, at the end."""

from enum import StrEnum
from pathlib import Path

from pydantic import BaseModel, ValidationError

from motord.atomic_write import write_whole
from motord.loop.rt_setup import RealtimeStatus
from motord.section.complaints import wrong_things
from motord.shm.histogram import TimeSummary

SIZE_MAX_BYTES = 1 << 20


class LoopPhase(StrEnum):
    """Where in its life the loop process is."""

    STARTING = "starting"
    READY = "ready"  # devices open, ticks are being published
    STOPPED = "stopped"
    FAILED = "failed"


class LoopStatus(BaseModel, frozen=True):
    """The loop process: who, since when, with which rights, and at the end how it went."""

    phase: LoopPhase
    pid: int
    rate_Hz: int = 0
    offset_ns: int = 0
    error: str = ""
    reason: str = ""
    foreign_threads: list[str] = []
    realtime: RealtimeStatus | None = None
    ticks: int = 0
    missed: int = 0
    wake_late: TimeSummary = TimeSummary()
    work: TimeSummary = TimeSummary()

    def write(self, path: Path) -> None:
        """Write the file in one step, so that a reader sees the old or the new one."""
        write_whole(path, self.model_dump_json(indent=1))

    @classmethod
    def read(cls, path: Path) -> "LoopStatus | None":
        """Return what the file says, or None if there is none (yet).

        Raises OSError if it cannot be read or is no status.
        """
        try:
            with path.open("rb") as file:
                content = file.read(SIZE_MAX_BYTES + 1)
        except FileNotFoundError:
            return None
        if len(content) > SIZE_MAX_BYTES:
            raise OSError(f"{path}: is longer than any status of a loop")
        try:
            return cls.model_validate_json(content)
        except ValidationError as error:
            wrong = next(wrong_things(error))
            raise OSError(f"{path}: is no status of a loop: {wrong}") from None
