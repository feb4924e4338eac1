"""The recorder process: drains the tick ring into MCAP files, apart from the loop.

`python -m motord.recorder.main --config FILE --dir RUNDIR`: commands come as lines of JSON on
stdin (`commands.handle`), reports go as lines of JSON to stdout (`Session.report`). When SIGTERM
comes, it takes what the loop still writes, closes the file and ends; when stdin ends, because the
supervisor died, it follows the loop until that has ramped down and ended.
"""

import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path

from motord.config import Config, ConfigError, load_started
from motord.process.allocator import allocate_from_one_heap
from motord.process.bench_options import bench_options
from motord.process.ending_threads import join_in_time, start_thread
from motord.process.left_threads import end_process
from motord.recorder.commands import handle
from motord.recorder.crash_recovery import CrashRecovery
from motord.recorder.launch import BACKLOG_MAX_BYTES
from motord.recorder.pipe_lines import LINE_MAX_BYTES, LineReader, LineWriter
from motord.recorder.protocol import AFTER_S, BEFORE_S, BlackBoxRequest, path_of
from motord.recorder.rolling_file import ASKED_TO_STOP
from motord.recorder.session import Session
from motord.recording.errors import RecordError
from motord.recording.json_encoding import to_line
from motord.recording.metadata import describe
from motord.shm.run_directory import RunDir

DRAIN_S = 0.05
"""Time between two looks at the ring."""

REPORT_S = 0.5
"""Time between two reports, if nothing happens."""

BLOCKED_S = 2.0
"""After so long without a report another thread says that the process waits, and lives."""

REPORTED_AT_ONCE = (
    "recording", "file", "lost", "closed", "error", "obstacle", "blackboxes", "leftovers",
)  # fmt: skip
"""Fields of a report whose change is reported without delay."""

READS_AT_ONCE = 64
COMMAND_MAX_BYTES = BACKLOG_MAX_BYTES
"""A command is no longer than what its sender keeps."""

LAST_TICKS_S = 1.0
"""How long to wait, when asked to end, for the loop to end first; without a supervisor, for its
next tick."""


class Reporter:
    """Writes reports to a descriptor that does not block, each whole.

    While the one before has not been taken there is no new one: recording waits for no reader. To
    be used by two threads.
    """

    def __init__(self, descriptor: int) -> None:
        self._lines = LineWriter(descriptor, LINE_MAX_BYTES)
        self._lock = threading.Lock()
        self._last: tuple[object, ...] = ()
        self._reported_s = 0.0

    def write(self, report: dict[str, object], now_s: float) -> None:
        """Write `report` if one is due, or if one of `REPORTED_AT_ONCE` changed."""
        with self._lock:
            self._lines.flush()
            state = tuple(report.get(key) for key in REPORTED_AT_ONCE)
            if self._lines.waiting or (state == self._last and now_s < self._reported_s + REPORT_S):
                return
            self._last, self._reported_s = state, now_s
            self._lines.write(to_line(report))

    def write_blocked(self) -> None:
        """Write that the process lives, and waits."""
        with self._lock:
            self._lines.flush()
            if not self._lines.waiting:
                self._lines.write(to_line({"recording": False, "blocked": True}))

    @contextmanager
    def alive(self, clock_s: Callable[[], float] = time.monotonic) -> Iterator[None]:
        """Have a thread write so while there are no reports, as when the disk stalls."""
        over = threading.Event()
        self._reported_s = clock_s()  # the first report is awaited from now on

        def follow() -> None:
            while not over.wait(REPORT_S):
                if clock_s() - self._reported_s > BLOCKED_S:
                    self.write_blocked()

        thread = start_thread(follow, "alive")
        try:
            yield
        finally:
            over.set()
            join_in_time(thread)


def run(
    session: Session,
    commands: LineReader,
    reporter: Reporter,
    stopping: Callable[[], bool],
    wait: Callable[[float], None],
    clock_s: Callable[[], float] = time.monotonic,
    on_orphaned: Callable[[float], None] = lambda now_s: None,
) -> None:
    """Record until `stopping()` or the end of the commands; `wait(s)` returns early for those.

    `on_orphaned` is called when the commands have ended without being asked to stop.
    """
    end_s: float | None = None
    while True:
        now_s = clock_s()
        for line in _all_of(commands):
            handle(session, line, now_s)
        ticks_came = session.step(now_s)
        reporter.write(session.report(), now_s)
        if end_s is None and (stopping() or commands.ended):
            end_s = now_s + LAST_TICKS_S
            if not stopping():
                session.stop_following()
                try:
                    on_orphaned(now_s)
                except Exception as error:  # the recording has to be closed all the same
                    _say(f"of what ended the daemon there is no black box: {error!r}")
        if end_s is not None and ticks_came and not stopping():
            end_s = now_s + LAST_TICKS_S
        if end_s is not None and (session.over or now_s >= end_s):
            break
        wait(DRAIN_S)
    reason = ASKED_TO_STOP if stopping() else "the supervisor ended"
    session.close(reason, clock_s(), over=False)
    session.boxes.finish()
    reporter.write(session.report(), clock_s())


def main(arguments: Sequence[str] | None = None, commands: int = 0, reports: int = 1) -> int:
    """Run the recorder process on two descriptors, stdin and stdout; return its exit code."""
    parser = bench_options("recorder")
    parser.add_argument("--out", type=Path, help="record at once, to OUT-000.mcap and so on")
    options = parser.parse_args(arguments)
    allocate_from_one_heap()  # every recording has a thread
    lines, reporter = LineReader(commands, COMMAND_MAX_BYTES), Reporter(reports)
    stopped: list[int] = []
    with ExitStack() as stack:
        try:
            run_dir = RunDir.at(options.dir)
            config, text = load_started(options.config, run_dir.bench_file, plans=False)
            metadata = cache(lambda: describe(config, text))  # few recorders need it
            session = Session(run_dir.ring, config.recording)
            recovery = CrashRecovery(config, run_dir, metadata, session.note_recovered)
            if options.out is not None:
                session.start(options.out, metadata(), time.monotonic())
            for descriptor in (commands, reports):
                os.set_blocking(descriptor, False)
            signal.signal(signal.SIGTERM, lambda number, frame: stopped.append(number))
            recovery.start()
            stack.callback(recovery.stop)
            stack.enter_context(reporter.alive())
        except (ConfigError, RecordError, OSError) as error:
            _say(str(error))
            return 1
        run(
            session,
            lines,
            reporter,
            lambda: bool(stopped),
            lambda wait_s: _wait(commands, lines, wait_s),
            on_orphaned=lambda now_s: _record_daemon_death(session, config, metadata(), now_s),
        )
    return 0


def _record_daemon_death(
    session: Session, config: Config, metadata: Mapping[str, object], now_s: float
) -> None:
    """Keep what led to the daemon's death, if it left the bench enabled."""
    now_ns = time.time_ns()
    account = {
        "cause": "daemon died",
        "reason": "the daemon died while the bench was enabled",
        "action": "look into the system's log for what ended it (out of memory, kill -9, a crash)",
        "t_ns": now_ns,
    }
    box = BlackBoxRequest(
        path=path_of(config, now_ns),
        tick=None,
        ticks_before=round(BEFORE_S * config.loop.rate_Hz),
        ticks_after=round(AFTER_S * config.loop.rate_Hz),
        metadata={**metadata, **session.metadata},
        account=account,
    )
    session.boxes.request(box, now_s, if_powered=True)


def _say(text: str) -> None:
    """Write a line to stderr, which may have ended with the supervisor."""
    with suppress(OSError):
        sys.stderr.write(f"motord recorder: {text}\n")


def _all_of(commands: LineReader) -> Iterator[bytes]:
    """Yield the commands that have come, at most so many that the ring is not forgotten."""
    for _ in range(READS_AT_ONCE):
        lines = commands.read()
        yield from lines
        if not lines:
            return


def _wait(commands: int, lines: LineReader, wait_s: float) -> None:
    """Wait for a command, but at most `wait_s`; no commands come after their end."""
    if lines.pending:
        return
    select.select([] if lines.ended else [commands], [], [], wait_s)


if __name__ == "__main__":
    end_process(main())
