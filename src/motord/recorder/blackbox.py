"""A black box: the ticks around a trip and what was known of it, in a file of its own.

The ring always holds the last seconds, recorded or not. A box takes from it what came before the
trip and for a moment after it; then a thread writes it as a recording like any other.
"""

import re
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from motord.config import RecordingConfig
from motord.process.ending_threads import Worker
from motord.recorder.protocol import AFTER_S, BlackBoxRequest, note_outcome
from motord.recording.errors import RecordError
from motord.recording.file_names import PART, STAMP, part_of
from motord.recording.writer import RunWriter
from motord.schema import State, Trip, joined
from motord.shm.ring import RingReader
from motord.shm.shared_records import SharedFileError
from motord.wire.ticks.blocks import Block

LATE_S = 1.0
"""How long after that a box waits for ticks that do not come."""
KIND = "blackbox"
"""Kind of the event that holds a box's account, and key of it in the metadata."""

AT_ONCE = 3
"""Boxes in memory at a time, while the disk stalls: each may be some ten MB."""


class BlackBox:
    """A box in the making, filled from the ring at `ring`. Times are monotonic seconds.

    Raises RecordError if there is no ring or nothing in it.
    """

    def __init__(self, request: BlackBoxRequest, ring: Path, now_s: float) -> None:
        self.request = request
        try:
            self._reader = RingReader(ring, "oldest")
        except SharedFileError as error:
            raise RecordError(f"no black box: {error}") from error
        block, _ = self._reader.read()
        if not len(block):
            raise RecordError("no black box: the loop has not published any tick")
        tick = int(block["tick"][-1]) if request.tick is None else request.tick
        self._first, self._last = max(tick - request.ticks_before, 0), tick + request.ticks_after
        self._blocks = [self._of_the_box(block)]
        self._deadline_s = now_s + AFTER_S + LATE_S
        self._newest = block[-1]

    @property
    def powered(self) -> bool:
        """True if the bench was enabled in the newest tick, or has just lost its supervisor."""
        tripped = int(self._newest["first_trip"]) == Trip.SUPERVISOR_STALE
        return bool(self._newest["state"] == State.ENABLED) or tripped

    def complete(self, now_s: float) -> bool:
        """Take the ticks that have come; return whether these were all."""
        if int(self._newest["tick"]) < self._last:
            closed = self._reader.closed
            block, _ = self._reader.read()
            if len(block):
                self._newest = block[-1]
                self._blocks.append(self._of_the_box(block))
            return closed or int(self._newest["tick"]) >= self._last or now_s >= self._deadline_s
        return True

    def write(self, settings: RecordingConfig) -> None:
        """Write the file, if it is not there, and remove the oldest ones. Raises RecordError."""
        path, ticks = self.request.path, joined(self._blocks)
        try:
            if path.exists():
                return
            make_room(path, settings.blackbox_keep)
            part_of(path).unlink(missing_ok=True)  # of a recorder that was killed while writing it
        except OSError as error:
            raise RecordError(f"{path.parent}: {error.strerror}") from error
        try:
            self._write(path, ticks, settings)
        except RecordError:
            with suppress(OSError):  # as of a disk that its errors made read-only
                part_of(path).unlink()
            raise

    def _write(self, path: Path, ticks: Block, settings: RecordingConfig) -> None:
        account = {**self.request.account, **_causes(ticks)}
        about = {**self.request.metadata, "reason": account["reason"], KIND: account}
        with RunWriter.of(settings, path, about) as writer:
            for event in self.request.events:
                writer.event(event["t_ns"], event["kind"], event["message"], event["data"])
            writer.event(int(account["t_ns"]), KIND, str(account["reason"]), account)
            writer.flush()
            writer.ticks(ticks)

    def _of_the_box(self, block: Block) -> Block:
        return block[(block["tick"] >= self._first) & (block["tick"] <= self._last)]


def make_room(path: Path, keep: int) -> None:
    """Remove the oldest boxes in the folder of `path`: with it there are `keep`. Raises OSError.

    One that is stamped later than `path` is older, too: the computer's clock was set back since.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    bench = path.name.rpartition("-")[0]
    pattern = re.compile(rf"{re.escape(bench)}-{STAMP}\.mcap({re.escape(PART)})?")
    found = (p for p in path.parent.iterdir() if pattern.fullmatch(p.name))
    boxes = sorted(found, key=lambda box: (box.name < path.name, box.name))
    for old in boxes[: max(len(boxes) - keep + 1, 0)]:
        old.unlink(missing_ok=True)


def _causes(ticks: Block) -> dict[str, Any]:
    """Return first cause and all causes as the ticks have them; nothing if there was no trip."""
    tripped = ticks[ticks["state"] == State.TRIPPED]
    if not len(tripped):
        return {}
    bits = int(np.bitwise_or.reduce(tripped["trip_bits"]))
    return {"first": _names(int(tripped["first_trip"][0])), "causes": _names(bits)}


def _names(bits: int) -> list[str]:
    return [trip.name for trip in Trip if trip & bits and trip.name]


class BlackBoxWriter:
    """Fills boxes from the ring and has them written, apart from any recording.

    `outcomes`: path of each box to "" once it is written, else why it is not.
    """

    def __init__(self, ring: Path, settings: RecordingConfig) -> None:
        self._ring = ring
        self._settings = settings
        self._filling: list[BlackBox] = []
        self._writing: deque[tuple[BlackBox, Future[None]]] = deque()
        self._disk = Worker("blackbox")
        self.outcomes: dict[str, str] = {}

    @property
    def filling(self) -> bool:
        """True while ticks are still wanted for a box."""
        return bool(self._filling)

    def request(self, request: BlackBoxRequest, now_s: float, *, if_powered: bool = False) -> None:
        """Begin a box; with `if_powered`, only if the bench was enabled until now."""
        if len(self._filling) + len(self._writing) >= AT_ONCE:
            self._note(request, f"{AT_ONCE} black boxes are still being written")
            return
        try:
            box = BlackBox(request, self._ring, now_s)
        except RecordError as error:
            self._note(request, str(error))
            return
        if box.powered or not if_powered:
            self._filling.append(box)

    def event(self, event: Mapping[str, Any]) -> None:
        """Add an event to the boxes that are being filled."""
        for box in self._filling:
            box.request.events.append(event)

    def step(self, now_s: float) -> None:
        """Take the ticks that have come, write full boxes, note which are written."""
        for box in [box for box in self._filling if box.complete(now_s)]:
            self._filling.remove(box)
            self._write(box)
        while self._writing and self._writing[0][1].done():
            self._take_outcome()

    def finish(self) -> None:
        """Write what there is and wait for it."""
        while self._filling:
            self._write(self._filling.pop(0))
        while self._writing:
            self._take_outcome()

    def _write(self, box: BlackBox) -> None:
        self._writing.append((box, self._disk.submit(partial(box.write, self._settings))))

    def _take_outcome(self) -> None:
        box, future = self._writing.popleft()
        try:
            future.result()
        except RecordError as error:
            self._note(box.request, str(error))
        else:
            self._note(box.request, "")

    def _note(self, request: BlackBoxRequest, outcome: str) -> None:
        note_outcome(self.outcomes, request.path, outcome)
