"""A recorder's session without its process: ring, clock and disk are stepped by the test."""

import json
from pathlib import Path
from typing import Any

from motord.config import RecordingConfig
from motord.recorder.commands import handle
from motord.recorder.session import Session
from motord.recording.reader import open_run
from motord.shm.ring import RingWriter
from tests.unit.recording.runs import METADATA, tick_block

CAPACITY = 256

PLENTY = 10**12


class FreeSpace:
    """Bytes that are free on the disk."""

    bytes = PLENTY


class Bench:
    """A ring that a loop fills, a session that empties it, a clock and a disk."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.folder = folder
        self.stem = folder / "runs" / "day"
        self.ring_path = folder / "ring"
        self.ring = RingWriter(self.ring_path, CAPACITY)
        short = {"sync_s": 1.0, "free_min_MB": 1.0, **settings}  # files, too, shorter than may be
        self.settings = RecordingConfig().model_copy(update=short)
        self.now_s = 1000.0
        self.published = 0
        self.session = self.new_session()

    def new_session(self) -> Session:
        return Session(self.ring_path, self.settings)

    def loop(self, count: int, first: int | None = None) -> None:
        """Publish `count` ticks, as the loop does."""
        first = self.published if first is None else first
        block = tick_block(count, first)
        block["missed"] = 0
        for row in block:
            self.ring.slot()[0] = row
            self.ring.publish()
        self.published = first + count

    def step(self, seconds: float = 0.05) -> None:
        self.now_s += seconds
        self.session.step(self.now_s)
        self.session.settle()

    def do(self, **command: Any) -> None:
        handle(self.session, json.dumps(command).encode(), self.now_s)

    def start(self, **more: Any) -> None:
        self.do(do="start", out=str(self.stem), metadata=METADATA, **more)

    def stop(self) -> None:
        self.do(do="stop", reason="done")

    def finish(self, last_tick: int | None = None, **more: Any) -> None:
        """Finish the recording, which ended with `last_tick`, or with the newest one."""
        tick = tick_block(1, self.published - 1 if last_tick is None else last_tick)[0]
        newest = {"tick": int(tick["tick"]), "t_ns": int(tick["t_ns"]), "missed": 0}
        about = {"metadata": METADATA, "reason": "done", "newest": newest, "to_end": False}
        self.do(do="finish", **({"out": str(self.stem)} | about | more))

    def report(self) -> dict[str, Any]:
        return self.session.report()

    def files(self) -> list[Path]:
        return sorted(self.stem.parent.glob("*.mcap*"))

    def recorded(self) -> list[int]:
        return [int(t) for f in self.files() for t in open_run(f).ticks(["tick"])["tick"]]

    def events(self) -> list[dict[str, Any]]:
        return [event for file in self.files() for event in open_run(file).events()]
