"""Threads that do not keep their process."""

import subprocess
import sys
import threading
import time

import pytest

from motord.process.ending_threads import Worker, join_until
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
