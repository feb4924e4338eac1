"""The estimator process: what a plan's captures give by now, while the plan runs.

`python -m motord.service.estimator.process --config FILE --dir RUNDIR`: what it is to estimate and
the captures come as lines of JSON on stdin, reports go as lines of JSON to stdout (`protocol`),
ticks come out of the ring. Its priority is low, and it ends with stdin. Nobody waits for it: a
capture of which ticks were overwritten meanwhile is left out and reported. A thread follows the
ring, as an estimate may take longer than the ring holds.
"""

import sys
import threading
from collections.abc import Iterable, Mapping
from functools import partial
from pkgutil import resolve_name
from typing import Any, Protocol

import numpy as np

from motord.config import Config
from motord.process.ending_threads import join_in_time, start_thread
from motord.process.left_threads import end_process
from motord.recorder.pipe_lines import LineWriter
from motord.recording.json_encoding import to_line
from motord.schema import TICK_DTYPE, joined, rows_of
from motord.sequencing.observation import Precision
from motord.service.estimator.protocol import PrecisionReport
from motord.service.host import background
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from motord.untrusted import parse_json

READ_AT_ONCE = 1 << 16
KEPT_MAX = 1 << 20
"""Ticks of captures, 176 MB: about two minutes at 8 kHz."""

LOOK_S = 0.25
"""Time between two looks at the ring."""


class CaptureTicks:
    """Follows the ring from the oldest tick that it holds; at most `kept_max` ticks are kept.

    Only ticks of operating points are kept: a plan may pause for an hour. For any thread.
    """

    def __init__(self, ring: RingReader, kept_max: int = KEPT_MAX) -> None:
        self._ring = ring
        self._lock = threading.Lock()
        self._kept_max = kept_max
        self._blocks: list[np.ndarray] = [np.empty(0, TICK_DTYPE)]
        self._kept = 0
        self._after_loss = True  # what came before the first tick is not known
        self._whole_from = 0
        self._newest = -1

    def read(self) -> None:
        """Take in what the ring has."""
        with self._lock:
            while self._ring.backlog:
                block, lost = self._ring.read(READ_AT_ONCE)
                self._after_loss |= lost > 0
                if len(block):
                    self._add(block)

    def of(self, point: Mapping[str, Any]) -> np.ndarray | None:
        """Return the ticks of a capture (`/operating_point`) as far as they are of a point, (n,).

        None if some of them were overwritten before they were read. Those before it are forgotten.
        """
        self.read()
        first, last = int(point["tick_start"]), int(point["tick_end"])
        with self._lock:
            ticks = joined(self._blocks)
            begin, end = np.searchsorted(ticks["tick"], [first, last + 1])
            self._blocks, self._kept = [joined([ticks[end:]])], len(ticks) - int(end)
            whole = self._whole_from <= first and last <= self._newest
        return ticks[begin:end] if whole else None

    def _add(self, block: np.ndarray) -> None:
        if self._after_loss:
            self._whole_from, self._after_loss = int(block["tick"][0]), False
        self._newest = int(block["tick"][-1])
        inside = rows_of(block, block["plan_point"] >= 0)
        self._blocks.append(inside)
        self._kept += len(inside)
        if self._kept > self._kept_max:
            self._blocks, self._kept, self._after_loss = [inside[:0]], 0, True


class Estimator(Protocol):
    """What `Plan.estimator` names, made of the bench, the targets and the plan's options."""

    def take(self, ticks: np.ndarray) -> None:
        """Take a block of ticks, TICK_DTYPE (n,)."""

    def captured(self, point: Mapping[str, Any]) -> Precision:
        """Return what the captures give, with the one that `/operating_point` describes."""


class Estimation:
    """Answers the supervisor's lines with reports.

    What the estimator raises goes on, after a report that says so.
    """

    def __init__(self, config: Config, captures: CaptureTicks, reports: LineWriter) -> None:
        self._config = config
        self._captures = captures
        self._reports = reports
        self._run = ""
        self._estimator: Estimator | None = None
        self._known = Precision(0)

    def handle(self, line: bytes) -> None:
        """Carry out a command."""
        command = parse_json(line)
        try:
            if command["do"] == "start":
                self._run = command["run"]
                made = resolve_name(command["estimator"])
                self._estimator = made(self._config, command["targets"], **command["options"])
            elif self._estimator is not None:
                self._point(self._estimator, command["content"])
        except Exception as error:
            what = f"the estimator failed: {type(error).__name__}: {error}"
            self._report(Precision(self._known.captures, obstacle=what))
            raise

    def _point(self, estimator: Estimator, point: Mapping[str, Any]) -> None:
        ticks = self._captures.of(point)
        if ticks is None:
            what = f"ticks of point {point['index']} were overwritten before they were read"
            self._report(Precision(self._known.captures, self._known.half_widths, what))
            return
        estimator.take(ticks)
        self._known = estimator.captured(point)
        self._report(self._known)

    def _report(self, precision: Precision) -> None:
        report = PrecisionReport.of(self._run, precision)
        self._reports.write(to_line(report.model_dump()))


def follow(captures: CaptureTicks, ended: threading.Event) -> None:
    """Read the ring now and then, until `ended` is set."""
    while not ended.wait(LOOK_S):
        captures.read()


def run(estimation: Estimation, captures: CaptureTicks, commands: Iterable[bytes]) -> None:
    """Handle `commands` until they end, following the ring meanwhile."""
    ended = threading.Event()
    follower = start_thread(partial(follow, captures, ended), "ring")
    try:
        for line in commands:
            if line.endswith(b"\n"):  # else the supervisor died as it wrote
                estimation.handle(line)
    finally:
        ended.set()
        join_in_time(follower)


def serve(config: Config, run_dir: RunDir, reports: LineWriter) -> None:
    """Estimate what stdin says, from the ring of a bench. Raises SharedFileError without one."""
    captures = CaptureTicks(RingReader(run_dir.ring, "oldest"))
    run(Estimation(config, captures, reports), captures, sys.stdin.buffer)


if __name__ == "__main__":
    end_process(background.run("estimator", serve))
