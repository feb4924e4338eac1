"""Child processes: restart policies, back-off, texts of exits; with fakes and with real ones."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from motord import config
from motord.service.gateway.link import GATEWAY
from motord.service.host.children import (
    BACKOFF_FIRST_S,
    BACKOFF_LAST_S,
    KILLED_S,
    NOT_ENDED,
    Children,
    Process,
    exit_text,
    spawn,
)
from motord.service.processes import PROCESSES
from motord.shm.run_directory import RunDir

SECOND_NS = 1_000_000_000


def process(name, restart, start):
    return Process(name, "motord.absent", start, restart, "a gap", 5.0)


def sleeping(command):
    return spawn((sys.executable, "-c", "import time; time.sleep(60)"))


def children_of(*table):
    return Children(table, lambda row: row.start(Path("bench.toml"), RunDir("sim")))


class FakeProcess:
    pid = 42

    def __init__(self, command):
        self.command = command
        self.code = None
        self.signals = []
        self.waits_s = []
        self.deaf = self.stuck = False

    def poll(self):
        return self.code

    def wait(self, timeout=None):
        self.waits_s.append(timeout)
        if self.code is None and timeout is not None:
            raise subprocess.TimeoutExpired("x", timeout)
        return self.code

    def send_signal(self, sig):
        self.signals.append(sig)
        if not self.stuck and (not self.deaf or sig == signal.SIGKILL):
            self.code = -sig


@pytest.fixture
def started():
    return []


@pytest.fixture
def children(started):
    def start(command):
        started.append(FakeProcess(command))
        return started[-1]

    return children_of(process("loop", "on reset", start), process("recorder", "always", start))


def test_the_loop_stays_down_until_it_is_started_again(children, started):
    children.start("loop", 0)
    assert children.process("loop") is started[0]
    started[0].code = -9
    [end] = children.poll(SECOND_NS)
    assert (end.process.name, end.how, end.again_s) == ("loop", "killed by SIGKILL", None)
    assert children.poll(100 * SECOND_NS) == []
    assert len(started) == 1
    children.start("loop", 100 * SECOND_NS)
    assert children.views()["loop"].restarts == 1


def test_the_recorder_is_restarted_with_growing_pauses(children, started):
    children.start("recorder", 0)
    now_ns, pauses_s = 0, []
    for _ in range(8):
        started[-1].code = 1
        [end] = children.poll(now_ns)
        pauses_s.append(end.again_s)
        before = len(started)
        children.poll(now_ns + round(end.again_s * 1e9) - 1)
        assert len(started) == before
        now_ns += round(end.again_s * 1e9)
        children.poll(now_ns)
        assert len(started) == before + 1
    assert pauses_s[0] == BACKOFF_FIRST_S
    assert pauses_s == sorted(pauses_s)
    assert pauses_s[-1] == BACKOFF_LAST_S


def test_a_gateway_that_cannot_open_is_seldom_started(started):
    """As its files are wrong, until somebody mends them: each start takes half a second."""

    def start(row):
        started.append(FakeProcess(row))
        started[-1].code = 1
        return started[-1]

    children = Children([row for row in PROCESSES if row.name == GATEWAY], start)
    children.start_all(0)
    for now_s in range(600):
        children.poll(now_s * SECOND_NS)
    assert 10 < len(started) < 70


def test_one_that_ran_for_long_is_restarted_soon(children, started):
    children.start("recorder", 0)
    for second in (1, 20):
        started[-1].code = 1
        [end] = children.poll(second * SECOND_NS)
        assert end.again_s == BACKOFF_FIRST_S
        children.poll((second + 1) * SECOND_NS)


def test_starting_twice_starts_once(children, started):
    children.start("loop", 0)
    children.start("loop", 0)
    assert len(started) == 1


def test_a_stopped_child_stays_down(children, started):
    children.start("recorder", 0)
    assert children.stop("recorder") == "killed by SIGTERM"
    assert children.poll(100 * SECOND_NS) == []
    assert children.process("recorder") is None
    assert children.stop("recorder") == "killed by SIGTERM"


def test_one_that_does_not_listen_is_killed(children, started):
    children.start("loop", 0)
    started[0].deaf = True
    assert children.stop("loop") == "killed by SIGKILL"
    assert started[0].signals == [signal.SIGTERM, signal.SIGKILL]


def test_one_that_waits_in_the_kernel_does_not_hold_up_the_end_and_is_said(children, started):
    children.start("loop", 0)
    started[0].stuck = True
    assert children.stop("loop") == NOT_ENDED  # a fake that waits without a limit returns None
    assert started[0].waits_s == [5.0, KILLED_S]
    assert children.not_ended == {"loop": 42}
    assert children.views()["loop"].exit == NOT_ENDED


def test_one_that_is_killed_is_waited_for_by_nobody_and_no_event(started):
    def start(command):
        started.append(FakeProcess(command))
        return started[-1]

    children = children_of(process("estimator", "never", start))
    assert children.views() == {}
    children.start_all(0)
    assert started == []
    for number in range(2):
        children.start("estimator", 0)
        assert children.views()["estimator"].running
        started[number].deaf = True  # as if its end took a while
        children.kill("estimator")
        children.kill("estimator")
        assert started[number].signals == [signal.SIGKILL]
    assert children.views() == {}
    assert children.poll(SECOND_NS) == []
    children.start("estimator", 0)
    started[-1].code = -9
    [end] = children.poll(SECOND_NS)
    assert (end.how, end.again_s) == ("killed by SIGKILL", None)
    assert children.views()["estimator"].exit == "killed by SIGKILL"


def test_one_that_is_killed_leaves_no_zombie():
    children = children_of(process("estimator", "never", sleeping))
    children.start("estimator", 0)
    pid = children.process("estimator").pid
    children.process("estimator").send_signal(signal.SIGSTOP)
    children.kill("estimator")
    end_s = time.monotonic() + 30
    while Path(f"/proc/{pid}").exists():
        assert time.monotonic() < end_s
        assert children.poll(0) == []
        time.sleep(0.01)


def test_views_and_signals(children, started):
    assert children.views()["loop"].model_dump() == {
        "pid": None, "running": False, "restarts": 0, "exit": "",
        "bad_messages": 0, "dropped_messages": 0,
    }  # fmt: skip
    children.signal("loop", signal.SIGUSR1)
    children.start("loop", 0)
    assert children.views()["loop"].pid == 42
    children.signal("loop", signal.SIGUSR1)
    assert started[0].signals == [signal.SIGUSR1]


@pytest.mark.parametrize(
    ("code", "expected"),
    [(0, "exit code 0"), (3, "exit code 3"), (-15, "killed by SIGTERM"), (-99, "signal 99")],
)
def test_exit_texts(code, expected):
    assert expected in exit_text(code)


def test_real_processes_end_when_they_are_stopped():
    children = children_of(process("recorder", "always", sleeping))
    children.start("recorder", 0)
    assert children.stop("recorder") == "killed by SIGTERM"
    child = spawn((sys.executable, "-c", "raise SystemExit(3)"))
    assert child.wait(30) == 3


def test_those_that_always_run_are_started_together(children, started):
    children.start_all(0)
    assert children.process("recorder") is started[0]
    assert children.process("loop") is None


@pytest.mark.parametrize(
    ("listen", "names"),
    [
        (("tcp/127.0.0.1:7447",), ["recorder", "estimator", "loop"]),
        (("tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"), ["gate", "recorder", "estimator", "loop"]),
    ],
)
def test_the_table_has_what_a_bench_needs(listen, names):
    bench = config.load()
    bench = bench.model_copy(update={"zenoh": bench.zenoh.model_copy(update={"listen": listen})})
    assert [row.name for row in PROCESSES if row.while_(bench)] == names
    for row in PROCESSES:
        command = RunDir("sim").command(row.module, Path("bench.toml"))
        assert command[:3] == [sys.executable, "-P", "-m"]
        assert "bench.toml" in command
