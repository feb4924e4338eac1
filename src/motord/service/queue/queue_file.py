"""The queue's file, written whole by a thread: a disk that stalls blocks no other."""

from datetime import UTC, datetime
from pathlib import Path

from pydantic import ValidationError

from motord.atomic_write import sync_folder, write_whole
from motord.process.ending_threads import Background
from motord.service.queue.plan_queue import PlanQueue


class QueueFile:
    """The queue at `path`: the one before or the new one, never a part.

    `error` says why the newest is not on the disk, "" if it is or, until `idle`, will be.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer = Background(1)
        self._newest: PlanQueue | None = None
        self._written: PlanQueue | None = None
        self._unusable = ""
        self.error = ""

    @property
    def idle(self) -> bool:
        """True if the newest queue is on the disk, or cannot be."""
        return self._writer.idle

    def load(self) -> tuple[PlanQueue, str]:
        """Return the queue that is on the disk, and what was wrong with it, "" for nothing.

        A file that makes no sense is set aside under a name of its own, and the queue is empty.
        """
        try:
            content = self._path.read_bytes() if self._path.exists() else None
        except OSError as error:
            self._unusable = self.error = f"{self._path}: {error.strerror}"
            return PlanQueue(), f"cannot read it: {self.error}; nothing can be added to it"
        if content is None:
            return PlanQueue(), ""
        try:
            return PlanQueue.model_validate_json(content), ""
        except ValidationError as error:
            what = error.errors(include_url=False, include_input=False)[0]
            place = ".".join(map(str, what["loc"]))
            return PlanQueue(), self._set_aside(f"{place}: {what['msg']}" if place else what["msg"])

    def save(self, queue: PlanQueue) -> None:
        """Have the disk hold `queue`; only the newest is written."""
        self._newest = queue
        self._writer.do(self._write)

    def settle(self) -> None:
        """Wait until everything is on the disk, or cannot be."""
        self._writer.settle()

    def _write(self) -> None:
        queue = self._newest
        if queue is None or queue is self._written or self._unusable:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, queue.model_dump_json())
            self._written, self.error = queue, ""
        except OSError as error:
            self.error = f"{self._path}: {error.strerror}"

    def _set_aside(self, why: str) -> str:
        stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%S}"
        aside = self._path.with_name(f"{self._path.name}.unreadable-{stamp}")
        try:
            self._path.replace(aside)
            sync_folder(aside.parent)
        except OSError as error:
            self._unusable = self.error = f"{self._path}: {error.strerror}"
            return f"it makes no sense ({why}) and cannot be set aside: {self.error}"
        return f"{self._path} makes no sense ({why}) and was set aside as {aside.name}"
