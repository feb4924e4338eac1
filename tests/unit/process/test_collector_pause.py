"""Searches for garbage: none while modules are imported, none through them later or at the end."""

import subprocess
import sys

import pytest

from tests.support.patience import PATIENCE_S

PAUSED = """
import gc
from motord.process.collector_pause import collector_paused

with collector_paused():
    import wave
    during, modules = gc.isenabled(), [[] for _ in range(1000)]
assert not during and gc.isenabled()
with collector_paused():
    import wave
    later = [[] for _ in range(1000)]
searched = {id(one) for one in gc.get_objects()}
assert not any(id(one) in searched for one in modules)
assert all(id(one) in searched for one in later)
"""

GARBAGE = """
from motord.process.left_threads import end_process

class Kept:
    def __init__(self):
        self.myself = self

    def __del__(self):
        print("searched")

kept = Kept()
print("done")
end_process(0)
"""


@pytest.mark.parametrize(("program", "output"), [(PAUSED, ""), (GARBAGE, "done\n")])
def test_what_is_not_searched_for_garbage(program, output):
    command = (sys.executable, "-c", program)
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (0, output, "")
