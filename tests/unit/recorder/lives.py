"""Supervisor, pipes, recorder, ring and disk in one process; the recorder can be killed anywhere.

A kill comes at a call of the system by which a file is made, written, synced or named, before or
in the midst of it, or between two steps of the recorder. What the killed one would still have done
does not happen: nothing of it is on the disk, and what it had not read of its commands is gone.
"""

import os
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from motord import config
from motord.process import ending_threads
from motord.process.ending_threads import _do
from motord.recorder.commands import handle
from motord.recorder.main import Reporter
from motord.recorder.pipe_lines import LineReader
from motord.recorder.session import Session
from motord.recording.errors import RecordError
from motord.recording.file_names import stem_of, whole_of
from motord.recording.mcap import mcap_file
from motord.recording.reader import Run, open_run
from motord.schema import TICK_DTYPE, State, as_bytes, joined, rows_of
from motord.service.host.events import EventLog
from motord.service.recording import control, session
from motord.service.recording.control import RecordingControl
from motord.service.recording.session import RECORDER
from motord.shm.ring import RingWriter
from motord.shm.timing import KIND, Timing
from tests.unit.recording.runs import START_NS

BENCH = config.load()
RATE_HZ = 100
STEP_TICKS = 10
STEP_S = STEP_TICKS / RATE_HZ
MARGIN_STEPS = 4
"""What is recorded before the bench is enabled, and after it no longer is."""
CAPACITY = 2048
"""Ticks, all of a scenario: what is missing then was not lost for want of room."""


STARTS_S = 1.5 * STEP_S
"""For so long a recorder that was started again is not up yet."""


class Killed(BaseException):
    """What the killed recorder was doing does not go on."""


class Disk:
    """The calls of the system that change recordings; the one numbered `fatal` kills its caller.

    Of a write that is fatal the first `part` (0 to 1) has been done.
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.calls = 0
        self.fatal: int | None = None
        self.part = 0.0
        self.dead = False
        self._open: set[int] = set()
        # what was written outlasts a process without being synced, which takes longest
        calls = {"write": self._guarded(os.write), "fsync": self._guarded(lambda _file: None)}
        files = {"open": self._guarded(self._opened), "close": self._close}
        patch.setattr(mcap_file, "sync_folder", lambda _folder: None)
        patch.setattr(mcap_file, "os", SimpleNamespace(**{**vars(os), **calls, **files}))
        patch.setattr(Path, "rename", self._guarded(Path.rename))

    def release(self) -> None:
        """Close what a process that is dead had open."""
        while self._open:
            os.close(self._open.pop())

    def _opened(self, *arguments: Any) -> int:
        descriptor = os.open(*arguments)
        self._open.add(descriptor)
        return descriptor

    def _close(self, descriptor: int) -> None:
        if self.dead:
            raise Killed
        self._open.discard(descriptor)
        os.close(descriptor)

    def _guarded(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def guarded(*arguments: Any, **options: Any) -> Any:
            self.calls += 1
            if self.dead:
                raise Killed
            if self.calls == self.fatal:
                self.dead = True
                if call is os.write and self.part:
                    descriptor, data = arguments
                    os.write(descriptor, data[: round(self.part * len(data))])
                raise Killed
            return call(*arguments, **options)

        return guarded


class DoneAtOnce:
    """A recorder's thread that is never behind: this one ends no step before it has done all."""

    def __init__(self, _name: str) -> None:
        pass

    def submit(self, work: Callable[[], object]) -> "Future[object]":
        """Do `work`."""
        future: Future[object] = Future()
        _do(future, work)
        return future


class Recorder:
    """A recorder's process: what `Children` returns, with the pipes that a link takes.

    Before `up_s` it starts: it does nothing, and a signal to end it finds nobody to heed it.
    """

    def __init__(self, pid: int, ring: Path, settings: config.RecordingConfig, up_s: float) -> None:
        self.pid = pid
        self._up_s = up_s
        commands, self._to_us = os.pipe()
        self._from_us, reports = os.pipe()
        for end in (commands, reports):
            os.set_blocking(end, False)
        self.stdin = os.fdopen(self._to_us, "wb", buffering=0)
        self.stdout = os.fdopen(self._from_us, "rb", buffering=0)
        self._ends: tuple[int, ...] = (commands, reports)
        self._lines = LineReader(commands)
        self._reporter = Reporter(reports)
        self._session = Session(ring, settings)
        self._code: int | None = None

    def poll(self) -> int | None:
        return self._code

    def step(self, now_s: float) -> None:
        """Do what `main.run` does at a time."""
        if now_s < self._up_s:
            return
        for line in self._lines.read():
            handle(self._session, line, now_s)
            self._session.settle()
        self._session.step(now_s)
        self._session.settle()
        self._reporter.write(self._session.report(), now_s)

    def end(self, now_s: float) -> None:
        """SIGTERM: take what there is, close, end."""
        if now_s < self._up_s:
            self.kill()
            return
        self.step(now_s)
        self._session.close("asked to stop", now_s)
        self._gone()

    def kill(self) -> None:
        """Kill it, while the disk is dead for it."""
        self._code = -9
        self._gone()

    def release(self) -> None:
        """Close what is left of its pipes at the supervisor's end."""
        self._gone()
        self.stdin.close()
        self.stdout.close()

    def _gone(self) -> None:
        for end in self._ends:
            os.close(end)
        self._ends = ()


class Bench:
    """A loop that publishes ticks, the supervisor's `RecordingControl`, a recorder and its disk.

    It is also the supervisor's `Children`: a recorder that was killed has a successor after
    `away_steps`. With `kill_at`, one is killed after it was sent what that step has for it.
    """

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, away_steps: int = 1) -> None:
        self.disk = Disk(patch)
        patch.setattr(control, "describe", lambda *_: {"motor": {}})
        for name in ("BEFORE_S", "AFTER_S"):
            patch.setattr(control, name, MARGIN_STEPS * STEP_S)
        patch.setattr(ending_threads, "Worker", DoneAtOnce)
        clock = {"monotonic": lambda: self.now_s, "monotonic_ns": self._now_ns, "sleep": self._wait}
        patch.setattr(session, "time", SimpleNamespace(**clock))
        self.settings = config.RecordingConfig(
            directory=folder / "runs", sync_s=0.4, chunk_s=0.15, file_max_s=0.6, free_min_MB=0.0
        )  # so that it is synced, and goes on in the next file
        loop = BENCH.loop.model_copy(update={"rate_Hz": RATE_HZ})
        self._ring_path = folder / "ring"
        self._ring = RingWriter(self._ring_path, CAPACITY)
        self.now_s = 1000.0
        self.steps = 0
        self.state = State.OFF
        self.kill_at: int | None = None
        self.kills = 0
        self._tick, self._missed = -1, 0
        self._blocks: list[np.ndarray] = []
        self._away_steps, self._away = away_steps, 0
        self._recorders: list[Recorder] = []
        self._recorder: Recorder | None = self._start_recorder(self.now_s)
        self.events = EventLog(self._unix_ns)
        Timing.create(folder / "timing")
        self.control = RecordingControl(
            BENCH.model_copy(update={"recording": self.settings, "loop": loop}),
            "",
            self,  # type: ignore[arg-type]
            self.events,
            self._unix_ns,
            folder / "timing",
        )

    # --- what the supervisor's side asks of `Children`

    def process(self, name: str) -> Recorder | None:
        assert name == RECORDER
        return self._recorder

    def count(self, name: str, bad: int, dropped: int) -> None:
        assert (name, bad, dropped) == (RECORDER, 0, 0)

    def poll(self, now_ns: int) -> list[Any]:
        return []

    def stop(self, name: str, timeout_s: float) -> None:
        """SIGTERM. A process that is not up yet would be ended by it."""
        if self._recorder is not None:
            self._guard(lambda recorder: recorder.end(self.now_s))

    # ---

    @property
    def ticks(self) -> np.ndarray:
        """All ticks that there were."""
        return joined(self._blocks)

    def step(self, count: int = 1) -> None:
        """Let the time of some steps pass."""
        for _ in range(count):
            self.steps += 1
            self.now_s += STEP_S
            block = self._publish()
            self._revive()
            self.control.take_ticks(block)
            self.control.step(self._now_ns())
            if self.steps == self.kill_at:
                self._kill()
            self._guard(lambda recorder: recorder.step(self.now_s))

    def enabled(self, steps: int) -> None:
        """Be enabled for some steps, then off."""
        self.state = State.ENABLED
        self.step(steps)
        self.state = State.OFF

    def end(self) -> None:
        """End the daemon: the loop, then the recorder."""
        self._ring.close()
        self.control.close()
        self.control.recorder.stop()

    def close(self) -> None:
        """Let go of everything."""
        for recorder in self._recorders:
            recorder.release()
        self.disk.release()

    def recorded(self) -> dict[str, np.ndarray]:
        """Return the ticks of each recording, sorted by their numbers."""
        return {name: ticks_of(runs) for name, runs in self.runs().items()}

    def runs(self) -> dict[str, list[Run]]:
        """Return the files of each recording."""
        runs: dict[str, list[Run]] = {}
        folder = self.settings.directory
        for path in sorted(folder.glob("*.mcap*")) if folder.is_dir() else []:
            stem = stem_of(whole_of(path))
            assert stem is not None
            with suppress(RecordError):  # killed before there was anything in it
                runs.setdefault(stem.name, []).append(open_run(path))
        return runs

    def _now_ns(self) -> int:
        return round(self.now_s * 1e9)

    def _unix_ns(self) -> int:
        return START_NS + self._now_ns()

    def _wait(self, seconds: float) -> None:
        """What the supervisor's side sleeps while it ends."""
        self.now_s += seconds
        self._revive(seconds / STEP_S)
        self._guard(lambda recorder: recorder.step(self.now_s))

    def _publish(self) -> np.ndarray:
        """Publish the ticks of a step: now and then one is missed, or sees an old sample again."""
        block = np.zeros(STEP_TICKS, TICK_DTYPE)
        block["state"] = self.state
        rows, slots = as_bytes(block), as_bytes(self._ring.records)
        for number in range(STEP_TICKS):
            self._tick += 1
            if self._tick % 37 == 36:
                self._tick += 1
                self._missed += 1
            row = block[number : number + 1]
            row["tick"], row["missed"] = self._tick, self._missed
            row["t_ns"] = START_NS + (self._tick - self._tick % 3) * 1_000_000_000 // RATE_HZ
            slots[self._ring.index] = rows[number]
            self._ring.publish()
        self._blocks.append(block)
        return block

    def _revive(self, steps: float = 1.0) -> None:
        self._away -= steps
        if self._recorder is None and self._away < 0:
            self.disk.dead = False
            self._recorder = self._start_recorder(self.now_s + STARTS_S)

    def _start_recorder(self, up_s: float) -> Recorder:
        recorder = Recorder(len(self._recorders) + 1, self._ring_path, self.settings, up_s)
        self._recorders.append(recorder)
        return recorder

    def _guard(self, do: Callable[[Recorder], object]) -> None:
        """Have the recorder, if there is one, do something, in which it may be killed."""
        if self._recorder is None:
            return
        try:
            do(self._recorder)
        except (Killed, RuntimeError):  # the latter is what it becomes in the background
            assert self.disk.dead
        if self.disk.dead:
            self._kill()

    def _kill(self) -> None:
        if self._recorder is not None:
            self.disk.dead = True
            self.kills += 1
            self._recorder.kill()
            self.disk.release()
            self._recorder, self._away = None, self._away_steps


def ticks_of(runs: list[Run]) -> np.ndarray:
    """Return the ticks of a recording, sorted by their numbers."""
    ticks = joined([run.ticks() for run in runs])
    return rows_of(ticks, np.argsort(ticks["tick"]))


def timings_of(runs: list[Run]) -> int:
    """Return how many events `timing` a recording has."""
    return sum(event["kind"] == KIND for run in runs for event in run.events())
