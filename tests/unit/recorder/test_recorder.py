"""The recorder's loop, its pipes, and the process itself."""

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from motord.config import RecordingConfig, packaged
from motord.recorder import launch, main
from motord.recorder.launch import RecorderLink, spawn_piped
from motord.recorder.main import DRAIN_S, LAST_TICKS_S, Reporter
from motord.recorder.pipe_lines import LineReader
from motord.recorder.protocol import MessageReader, RecorderReport, RecordingTask
from motord.recorder.session import Session
from motord.recording.file_names import part_of
from motord.recording.reader import open_run
from motord.shm.ring import RingWriter
from motord.shm.run_directory import RunDir
from tests.support.patience import PATIENCE_S
from tests.unit.recording.runs import METADATA, point_of, tick_block

CONFIG = packaged("sim.toml")


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    for end in ends:
        os.set_blocking(end, False)
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue  # closed by the test


def publish(ring: RingWriter, first: int, count: int) -> None:
    for row in tick_block(count, first):
        ring.slot()[0] = row
        ring.publish()


# --- lines and reports


def test_lines_come_whole_whatever_the_pieces(pipe):
    lines = LineReader(pipe[0])
    assert lines.read() == []
    os.write(pipe[1], b"one\ntw")
    assert lines.read() == [b"one"]
    os.write(pipe[1], b"o\n\nthree")
    assert lines.read() == [b"two", b""]
    assert not lines.ended
    os.close(pipe[1])
    assert lines.read() == []
    assert lines.ended
    assert lines.read() == []


def test_a_report_is_written_when_something_changes_or_it_is_time(pipe):
    reporter, reports = Reporter(pipe[1]), LineReader(pipe[0])
    report: dict[str, object] = {"recording": True, "file": "a", "lost": 0, "error": "", "ticks": 1}
    reporter.write(report, 10.0)
    reporter.write({**report, "ticks": 2}, 10.1)
    assert [json.loads(r)["ticks"] for r in reports.read()] == [1]
    reporter.write({**report, "ticks": 3}, 10.6)
    reporter.write({**report, "ticks": 4, "lost": 5}, 10.7)
    assert [json.loads(r)["ticks"] for r in reports.read()] == [3, 4]


def test_while_there_are_no_reports_it_says_that_it_lives(pipe, monkeypatch):
    monkeypatch.setattr(main, "REPORT_S", 0.001)
    reporter, received = Reporter(pipe[1]), MessageReader(pipe[0], RecorderReport)
    now_s, came = [10.0], []
    reporter.write({"recording": True}, now_s[0])
    with reporter.alive(lambda: now_s[0]):
        now_s[0] += main.BLOCKED_S
        reporter.write({"recording": True, "lost": 1}, now_s[0])
        now_s[0] += main.BLOCKED_S + 0.01
        end_s = time.monotonic() + PATIENCE_S
        while len(came) < 5 and time.monotonic() < end_s:
            came += received.read(0)
    assert [report.blocked for report in came[:5]] == [False, False, True, True, True]
    assert received.bad == 0


def test_a_recorder_that_has_not_reported_yet_is_blocked_after_the_same_time(pipe, monkeypatch):
    """As one whose first step waits for its disk: not at once, because there was no report."""
    monkeypatch.setattr(main, "REPORT_S", 0.001)
    reporter, received = Reporter(pipe[1]), MessageReader(pipe[0], RecorderReport)
    looks_s = iter([1e6, *[1e6 + main.BLOCKED_S] * 5])  # from 0.0 on it would be long ago
    looked = threading.Event()

    def clock_s() -> float:
        now_s = next(looks_s, None)
        if now_s is None:
            looked.set()
        return 1e6 + main.BLOCKED_S if now_s is None else now_s

    with reporter.alive(clock_s):
        assert looked.wait(PATIENCE_S)
    assert received.read(0) == []


def test_a_supervisor_that_does_not_read_or_is_gone_does_not_matter(pipe):
    reporter = Reporter(pipe[1])
    report: dict[str, object] = {"recording": True, "error": "x" * 4000}
    for i in range(50):
        reporter.write(report, float(i))
    os.close(pipe[0])
    reporter.write(report, 100.0)


def test_reports_of_more_than_a_page_come_whole_or_not_at_all(pipe):
    reporter, received = Reporter(pipe[1]), MessageReader(pipe[0], RecorderReport)
    came = []
    for i in range(200):
        report: dict[str, object] = {"recording": True, "error": "x" * 16_000, "ticks": i}
        reporter.write(report, float(i))
        if i % 7 == 0:  # now and then the supervisor looks
            came += [report.ticks for report in received.read(i * 10**9)]
    assert received.bad == 0
    assert len(came) > 20
    assert came == sorted(set(came))


# --- the loop, with a clock of its own


class Scene:
    """A session, a ring, pipes; every wait of the recorder advances the clock."""

    def __init__(self, folder: Path, pipe: tuple[int, int]) -> None:
        self.ring = RingWriter(folder / "ring", 512)
        self.stem = folder / "day"
        self.session = Session(folder / "ring", RecordingConfig(free_min_MB=0))
        self.session.start(self.stem, METADATA, 0.0)
        self.commands = pipe
        self.now_s = 0.0
        self.stop = False
        self.at: dict[int, Callable[[], object]] = {}
        self.waits = 0
        self.on_orphaned: Callable[[float], object] = lambda now_s: None

    def wait(self, seconds: float) -> None:
        self.waits += 1
        self.now_s += seconds
        self.at.get(self.waits, lambda: None)()

    def run(self) -> None:
        read, write = os.pipe()
        main.run(
            self.session, LineReader(self.commands[0]), Reporter(write), lambda: self.stop,
            self.wait, lambda: self.now_s, self.on_orphaned,
        )  # fmt: skip
        os.close(read)
        os.close(write)

    def end(self) -> None:
        self.stop = True


def test_on_a_signal_it_ends_when_the_loop_has_ended(tmp_path, pipe):
    scene = Scene(tmp_path, pipe)
    scene.at = {
        2: lambda: publish(scene.ring, 0, 50),
        3: scene.end,
        5: lambda: publish(scene.ring, 50, 50),
        6: scene.ring.close,
    }
    scene.run()
    assert scene.waits == 6
    run = open_run(tmp_path / "day-000.mcap")
    assert len(run.ticks()) == 100
    assert run.end["reason"] == "asked to stop"


def test_when_the_supervisor_dies_it_follows_the_loop_until_no_more_ticks_come(tmp_path, pipe):
    scene = Scene(tmp_path, pipe)
    scene.at = {
        2: lambda: os.close(pipe[1]),
        4: lambda: publish(scene.ring, 0, 10),
        20: lambda: publish(scene.ring, 10, 10),
    }
    scene.run()
    assert scene.now_s == pytest.approx(20 * DRAIN_S + LAST_TICKS_S, abs=0.06)
    run = open_run(tmp_path / "day-000.mcap")
    assert len(run.ticks()) == 20
    assert run.end["reason"] == "the supervisor ended"


def test_the_recording_is_closed_though_the_death_of_the_supervisor_cannot_be_kept(
    tmp_path, pipe, capsys
):
    def fail(now_s):
        raise PackageNotFoundError("numba")

    scene = Scene(tmp_path, pipe)
    scene.on_orphaned = fail
    scene.at = {2: lambda: publish(scene.ring, 0, 10), 4: lambda: os.close(pipe[1])}
    scene.run()
    assert open_run(tmp_path / "day-000.mcap").end["reason"] == "the supervisor ended"
    assert capsys.readouterr().err == (
        "motord recorder: of what ended the daemon there is no black box: "
        "PackageNotFoundError('numba')\n"
    )


@pytest.mark.parametrize("said", [True, False], ids=["closed", "superseded"])
def test_when_the_supervisor_dies_it_leaves_the_next_loop_to_others(tmp_path, pipe, said):
    scene = Scene(tmp_path, pipe)

    def next_loop() -> None:
        publish(scene.ring, 11, 10)
        if said:
            scene.ring.close()
        publish(RingWriter(tmp_path / "ring", 512), 0, 7)

    scene.at = {
        2: lambda: publish(scene.ring, 0, 10),
        3: lambda: os.close(pipe[1]),
        30: next_loop,
    }
    scene.at[20] = lambda: publish(scene.ring, 10, 1)
    scene.run()
    assert scene.waits in (30, 31)
    assert len(open_run(tmp_path / "day-000.mcap").ticks()) == 21


def test_commands_are_carried_out_in_order(tmp_path, pipe):
    scene = Scene(tmp_path, pipe)
    event = {"do": "event", "t_ns": 5, "content": {"kind": "a", "message": "b"}}
    lines = [event, {"do": "stop", "reason": "done"}]
    scene.at = {1: lambda: os.write(pipe[1], b"".join(json.dumps(c).encode() + b"\n"
                                                      for c in lines)), 3: scene.end}  # fmt: skip
    scene.run()
    assert scene.waits == 3
    assert open_run(tmp_path / "day-000.mcap").events()[0]["kind"] == "a"


# --- main, in this process


@pytest.fixture
def signals() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("signals")
def test_main_records_at_once_if_given_a_path(tmp_path, pipe):
    ring = RingWriter(tmp_path / "ring", 512)
    publish(ring, 0, 5)
    ring.close()
    read, write = os.pipe()
    os.close(pipe[1])
    arguments = ["--config", str(CONFIG), "--dir", str(tmp_path), "--out", str(tmp_path / "day")]
    assert main.main(arguments, pipe[0], write) == 0
    os.set_blocking(read, False)
    last = json.loads(LineReader(read).read()[-1])
    assert last["file"] == str(tmp_path / "day-000.mcap")
    assert not last["recording"]
    run = open_run(tmp_path / "day-000.mcap")
    assert run.metadata["config"] == CONFIG.read_text()
    os.close(read)
    os.close(write)


def test_mistakes_are_one_line_and_exit_code_1(tmp_path, capsys):
    for config, out in ((tmp_path / "absent.toml", "day"), (CONFIG, "file/day")):
        (tmp_path / "file").write_text("")
        arguments = ["--config", str(config), "--dir", str(tmp_path), "--out", str(tmp_path / out)]
        assert main.main(arguments) == 1
        message = capsys.readouterr().err
        assert message.startswith("motord recorder: ")
        assert message.count("\n") == 1


# --- the supervisor's end of the pipes


def test_the_link_needs_pipes():
    process = subprocess.Popen([sys.executable, "-c", ""], stdin=subprocess.DEVNULL)
    process.wait()
    with pytest.raises(ValueError, match="without pipes"):
        RecorderLink(process)


def test_a_recorder_that_does_not_read_is_no_reason_to_wait(monkeypatch):
    monkeypatch.setattr(launch, "BACKLOG_MAX_BYTES", 200_000)
    never_reads = "import signal; signal.pause()"
    process = spawn_piped([sys.executable, "-c", never_reads])
    link = RecorderLink(process)
    for i in range(400):
        link.record("event", i, {"kind": "kind", "message": "x" * 1000})
    assert link.commands.dropped > 50
    process.kill()
    process.wait()
    assert link.reports(0) == []
    link.record("event", 0, {"kind": "kind", "message": "the pipe is broken"})
    link.close()


def test_children_with_pipes_start_no_thread_pools():
    count = "import os; print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])"
    process = spawn_piped([sys.executable, "-c", count])
    assert process.communicate()[0].split() == [b"1", b"1"]


# --- the process


class Supervisor:
    """Starts recorder processes on a ring that the test fills."""

    def __init__(self, folder: Path) -> None:
        self.run_dir = RunDir("bench", folder)
        self.run_dir.create()
        self.ring = RingWriter(self.run_dir.ring, 4096)
        self.stem = folder / "runs" / "day"
        self.published = 0
        self.last: RecorderReport | None = None
        self.process = spawn_piped(self.run_dir.command("motord.recorder.main", CONFIG))
        self.link = RecorderLink(self.process)

    def again(self) -> None:
        self.link.close()
        self.process = spawn_piped(self.run_dir.command("motord.recorder.main", CONFIG))
        self.link = RecorderLink(self.process)
        self.last = None

    def start(self, *, resume: bool = False) -> None:
        self.link.start(RecordingTask(self.stem, METADATA), resume=resume)

    def loop(self, count: int) -> None:
        publish(self.ring, self.published, count)
        self.published += count

    def until(self, condition: Callable[[RecorderReport], object], limit_s: float = 30.0) -> None:
        """Wait for a report that meets `condition`."""
        deadline_s = time.monotonic() + limit_s
        while not (self.last and condition(self.last)):
            assert time.monotonic() < deadline_s, self.last
            assert self.process.stdout is not None
            select.select([self.process.stdout], [], [], 1.0)
            for report in self.link.reports(0):
                self.last = report

    def end(self) -> int:
        code = self.process.wait(30)
        self.link.close()
        return code

    def recorded(self) -> list[int]:
        files = sorted(self.stem.parent.glob("*.mcap*"))
        return [int(t) for file in files for t in open_run(file).ticks(["tick"])["tick"]]


@pytest.fixture
def supervisor(tmp_path: Path) -> Iterator[Supervisor]:
    supervisor = Supervisor(tmp_path)
    yield supervisor
    if supervisor.process.poll() is None:
        supervisor.process.kill()
        supervisor.end()


@pytest.mark.system
def test_the_process_records_reports_and_ends_on_sigterm(supervisor):
    supervisor.start()
    supervisor.until(lambda r: r.recording)
    supervisor.loop(1000)
    supervisor.until(lambda r: r.ticks == 1000)
    supervisor.link.record("event", 1, {"kind": "state", "message": "ENABLED", "data": {"a": 1}})
    supervisor.link.record("plan", 2, {"plan": "calibrate"})
    supervisor.link.record("operating_point", 3, point_of(tick_block(5)))
    supervisor.link.stop("plan done")
    supervisor.until(lambda r: not r.recording)
    run = open_run(Path(supervisor.last.file))
    assert run.end["reason"] == "plan done"
    assert (len(run.events()), len(run.plan()), len(run.operating_points())) == (1, 1, 1)
    supervisor.start()
    supervisor.until(lambda r: r.recording)
    supervisor.loop(500)
    supervisor.ring.close()
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        supervisor.process.send_signal(number)
    assert supervisor.end() == 0
    assert supervisor.recorded() == list(range(1500))
    assert not list(supervisor.stem.parent.glob("*.part"))


@pytest.mark.system
def test_a_killed_process_is_followed_by_one_that_goes_on(supervisor):
    supervisor.start()
    supervisor.until(lambda r: r.recording)
    supervisor.loop(600)
    supervisor.until(lambda r: r.bytes > 50_000)
    supervisor.loop(300)
    supervisor.until(lambda r: r.ticks == 900)
    supervisor.process.kill()
    supervisor.end()
    supervisor.loop(200)
    supervisor.again()
    supervisor.start(resume=True)
    supervisor.until(lambda r: r.recording)
    supervisor.loop(50)
    supervisor.link.close()  # as if the supervisor had died
    supervisor.ring.close()
    assert supervisor.process.wait(30) == 0
    assert supervisor.recorded() == list(range(supervisor.published))
    assert part_of(supervisor.stem.with_name("day-000.mcap")).exists()
