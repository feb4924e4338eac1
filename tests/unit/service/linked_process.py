"""A link of the supervisor, and processes at its other end: played by the test, or real ones."""

import os
import subprocess
import time
from pathlib import Path

from motord.config import packaged
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.processes import PROCESSES
from tests.support.patience import PATIENCE_S
from tests.support.played_process import PlayedProcess

CONFIG = packaged("sim.toml")
ROOT = Path(__file__).parents[3]
STEP_NS = 10_000_000


class LinkedProcess:
    """The link that `make_link(children, events)` returns; `start(row)` starts its process."""

    def __init__(self, name, make_link, start):
        [row] = (row for row in PROCESSES if row.name == name)
        self._start, self.started, self.now_ns, self.why = start, [], 0, None
        self.events = EventLog(lambda: 0)
        self.children = Children([row], self._started)
        self.link = make_link(self.children, self.events)

    def _started(self, row):
        if self.why is not None:
            raise self.why
        self.started.append(self._start(row))
        return self.started[-1]

    def step(self, seconds=0.01):
        """Let time pass in steps of the supervisor; return how children ended, and start again."""
        ends = []
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            ends += [(end.how, end.again_s) for end in self.children.poll(self.now_ns)]
            self.link.step(self.now_ns)
        return ends

    def until(self, condition):
        """Step with the clock until a condition holds."""
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, vars(self.link)
            time.sleep(0.001)
            self.children.poll(time.monotonic_ns())
            self.link.step(time.monotonic_ns())

    def messages(self, kind):
        return [event.message for event in self.events.recent() if event.kind == kind]

    def close(self):
        self.link.stop()
        for each in self.started:
            if isinstance(each, PlayedProcess):
                each.close()


def running(run_dir, row):
    """Start the process of a row of the table, as the supervisor does."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT / "src", ROOT)))}
    return subprocess.Popen(
        run_dir.command(row.module, CONFIG),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, env=environment,
    )  # fmt: skip
