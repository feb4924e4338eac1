"""Threads that do not keep their process."""

import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from motord.process import ending_threads, left_threads
from motord.process.ending_threads import NoThreadError, Worker, ends_in_time, join_until
from tests.support.patience import PATIENCE_S


def test_work_is_done_in_order_and_what_it_raises_ends_no_thread():
    worker, done = Worker("tests"), []

    def fail():
        done.append("failed")
        sys.exit("a plan's own program")

    first = worker.submit(lambda: done.append("first"))
    failed = worker.submit(fail)
    assert worker.submit(lambda: [*done, "last"]).result(PATIENCE_S) == ["first", "failed", "last"]
    assert first.exception() is None
    assert isinstance(failed.exception(), SystemExit)


def test_a_worker_that_is_not_needed_any_more_ends_its_thread():
    worker = Worker("tests")
    thread = worker.submit(threading.current_thread).result(PATIENCE_S)
    del worker
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_where_no_thread_can_be_started_a_worker_says_what_to_do(monkeypatch):
    def refuse(_thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(NoThreadError, match="ulimit -u, TasksMax"):
        Worker("tests")


def test_threads_are_waited_for_together():
    go_on = threading.Event()
    threads = [threading.Thread(target=go_on.wait, daemon=True) for _ in range(3)]
    for thread in threads:
        thread.start()
    join_until(time.monotonic() + 0.01, threads)
    assert all(thread.is_alive() for thread in threads)
    go_on.set()
    join_until(time.monotonic() + PATIENCE_S, threads)
    assert not any(thread.is_alive() for thread in threads)


def test_what_never_returns_is_left_and_what_fails_says_so(monkeypatch):
    go_on = threading.Event()
    with monkeypatch.context() as changed:
        changed.setattr(ending_threads, "CLOSE_S", 0.01)
        assert not ends_in_time(go_on.wait, "tests")
    go_on.set()
    assert ends_in_time(go_on.wait, "tests")
    with pytest.raises(ZeroDivisionError):
        ends_in_time(lambda: 1 / 0, "tests")


def test_where_no_thread_can_be_started_it_is_done_all_the_same(monkeypatch):
    """With Python 3.12 and later there is none at the end of the interpreter."""

    def refuse(_thread):
        raise RuntimeError("can't create new thread at interpreter shutdown")

    done = threading.Event()
    monkeypatch.setattr(threading.Thread, "start", refuse)
    assert ends_in_time(done.set, "tests")
    assert done.is_set()


OBJECT_THAT_OUTLIVES_ALL = """
import builtins
from motord.process.ending_threads import ends_in_time

class Connection:
    def __del__(self, ends_in_time=ends_in_time, print=print):
        print(ends_in_time(lambda: print("closed"), "tests"))

builtins.connection = Connection()
"""


def test_what_is_closed_by_the_end_of_the_interpreter_does_not_hang():
    command = (sys.executable, "-c", OBJECT_THAT_OUTLIVES_ALL)
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (0, "closed\nTrue\n", "")


LEFT_BEHIND = """
import atexit, threading
from motord.process import ending_threads
from motord.process.left_threads import end_process

ending_threads.CLOSE_S = {close_s}
atexit.register(print, "at exit")
print(ending_threads.ends_in_time({work}, "tests"))
end_process(3)
"""


@pytest.mark.parametrize(
    ("work", "close_s", "ended"),
    [("threading.Event().wait", 0.01, False), ("threading.Event", PATIENCE_S, True)],
)
def test_a_process_that_leaves_a_thread_behind_ends_before_that_comes_back(work, close_s, ended):
    """Zenoh aborted it, if it had closed a connection while the interpreter ended."""
    command = (sys.executable, "-c", LEFT_BEHIND.format(work=work, close_s=close_s))
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (3, f"{ended}\nat exit\n", "")


def test_a_profiler_shows_what_it_found(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("from motord.process.left_threads import end_process\nend_process(0)\n")
    command = (sys.executable, "-m", "cProfile", script)
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (0, "")
    assert "function calls" in done.stdout


@pytest.mark.parametrize("tool", ["getprofile", "gettrace", "get_tool"])
def test_who_follows_a_thread_is_seen(tool: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Profilers and debuggers of Python 3.12 and later use `sys.monitoring`."""
    monitoring = SimpleNamespace()
    monkeypatch.setattr(sys, "monitoring", monitoring, raising=False)
    for place, name in ((sys, "getprofile"), (sys, "gettrace"), (monitoring, "get_tool")):
        monkeypatch.setattr(place, name, lambda *_: None, raising=False)
    assert not left_threads._is_traced()
    place = monitoring if tool == "get_tool" else sys
    monkeypatch.setattr(place, tool, lambda number=5: "a tool" if number == 5 else None)
    assert left_threads._is_traced()


UNLIMITED = re.compile(r"(thread|follower)\.join\(\)|session\.close\(\)")
SOURCE = Path(ending_threads.__file__).parents[1]


@pytest.mark.parametrize("package", ["client", "recorder", "service"])
def test_no_process_waits_for_a_thread_or_a_connection_without_a_limit(package):
    found = [
        f"{path.relative_to(SOURCE)}: {line.strip()}"
        for path in sorted((SOURCE / package).rglob("*.py"))
        for line in path.read_text().splitlines()
        if UNLIMITED.search(line)
    ]
    in_its_own_thread = ["client/benches.py: session.close()  # type: ignore[no-untyped-call]"]
    assert found == (in_its_own_thread if package == "client" else [])


@pytest.mark.parametrize("package", ["recorder", "service"])
def test_every_thread_of_a_process_is_started_in_one_way(package):
    """What an executor has no thread for fails when it is asked for."""
    found = [
        path.name
        for path in sorted((SOURCE / package).rglob("*.py"))
        if re.search(r"Thread\(|PoolExecutor\(", path.read_text())
    ]
    assert found == []


PROGRAM = """
import threading, time
from motord.process import ending_threads

ending_threads.CLOSE_S = {close_s}
worker = ending_threads.Worker("tests")
worker.submit(lambda: {work})
worker.submit(lambda: print("done", flush=True))
{drop}
"""


@pytest.mark.parametrize("drop", ["", "del worker"], ids=["kept", "dropped"])
@pytest.mark.parametrize(
    ("work", "close_s", "said"),
    [("time.sleep(0.1)", PATIENCE_S, "done\n"), ("threading.Event().wait()", 0.01, "")],
    ids=["slow", "for-ever"],
)
def test_a_process_ends_with_its_work_but_not_only_then(work, close_s, said, drop):
    program = PROGRAM.format(work=work, close_s=close_s, drop=drop)
    command = (sys.executable, "-c", program)
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (0, said, "")
