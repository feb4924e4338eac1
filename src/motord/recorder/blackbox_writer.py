"""The black boxes that a recorder has in the making, and the thread that writes them."""

from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from motord.config import RecordingConfig
from motord.recorder.blackbox import BlackBox, BlackBoxRequest
from motord.recorder.protocol import note_outcome
from motord.recording.errors import RecordError

AT_ONCE = 3
"""Boxes in memory at a time, while the disk stalls: each may be some ten MB."""


class BlackBoxWriter:
    """Fills boxes from the ring and has them written, apart from any recording.

    `outcomes`: path of each box to "" once it is written, else why it is not.
    """

    def __init__(self, ring: Path, settings: RecordingConfig) -> None:
        self._ring = ring
        self._settings = settings
        self._filling: list[BlackBox] = []
        self._writing: deque[tuple[BlackBox, Future[None]]] = deque()
        self._disk = ThreadPoolExecutor(1, thread_name_prefix="blackbox")
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
        self._writing.append((box, self._disk.submit(box.write, self._settings)))

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
