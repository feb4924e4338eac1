"""A process that cannot do without its threads."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.patience import PATIENCE_S

PROGRAM = """
import sys, threading
from motord.process.left_threads import end_with_any_thread
from tests.support.panic import panic

end_with_any_thread()
threading.Thread(target={target}, daemon=True).start()
sys.stdin.read()
"""


@pytest.mark.parametrize("target", ["panic", "lambda: 1 / 0", "lambda: sys.exit(0)"])
def test_an_error_that_ends_a_thread_ends_the_process(target):
    command = (sys.executable, "-c", PROGRAM.format(target=target))
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            assert process.wait(PATIENCE_S) == 1  # its stdin has not ended
        finally:
            process.kill()


def test_it_ends_also_where_nobody_takes_what_it_writes():
    command = (sys.executable, "-c", PROGRAM.format(target="panic"))
    with (
        Path("/dev/full").open("wb") as full,
        subprocess.Popen(command, stdin=subprocess.PIPE, stderr=full) as process,
    ):
        try:
            assert process.wait(PATIENCE_S) == 1
        finally:
            process.kill()
