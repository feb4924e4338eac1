"""The tracker process: what ordinary operation shows of the calibration in force.

`python -m motord.service.tracker.process --config FILE --dir RUNDIR`: which calibration comes as a
line of JSON on stdin, reports go as lines of JSON to stdout (`protocol`), ticks come out of the
ring from now on: those before may be of another calibration. Its priority is low, and it ends with
stdin. Nobody waits for it: ticks that it reads too late it does without.
"""

import os
import select
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Protocol

import numpy as np

from motord.calibration import Calibration, CalibrationError, load
from motord.config import Config
from motord.experiments.tracking.tracked import TrackedCalibration
from motord.process.left_threads import end_process
from motord.recorder.pipe_lines import LineReader, LineWriter
from motord.recorder.ring_source import RingSource
from motord.recording.json_encoding import to_line
from motord.service.host import background
from motord.service.tracker.protocol import (
    OBSTACLE_MAX,
    AdoptedReport,
    ReportedTracking,
    TrackerReport,
)
from motord.shm.run_directory import RunDir
from motord.untrusted import parse_json

LOOK_S = 0.25
"""Time between two looks at the ring."""
REPORT_NS = 3_000_000_000
"""Time between two reports."""
READ_AT_ONCE = 1 << 16
"""Ticks, 11 MB: after a pause the rest waits for the next look."""


class Tracker(Protocol):
    """What the command to start names, made of the bench, the calibration and its memory (s)."""

    def take(self, ticks: np.ndarray) -> None:
        """Take a block of ticks, TICK_DTYPE (n,); some may be missing before it."""

    def tracked(self) -> TrackedCalibration | None:
        """Return what is known by now, None before anything."""

    def adopted(self) -> Calibration:
        """Return the calibration as it is tracked. Raises CalibrationError if that is nothing."""


@dataclass
class Tracking:
    """Follows the ring with a tracker and answers the supervisor's lines.

    What the tracker raises goes on, after a report that says so.
    """

    config: Config
    run_dir: RunDir
    reports: LineWriter
    monotonic_ns: Callable[[], int] = time.monotonic_ns
    _tracker: Tracker | None = None
    _source: RingSource | None = None
    _report_ns: int = 0

    def handle(self, line: bytes) -> None:
        """Carry out a command. Raises CalibrationError if there is no such file."""
        command = parse_json(line)
        try:
            if command["do"] == "start":
                self._start(command["tracker"], Path(command["calibration"]))
            elif self._tracker is not None:
                self._adopt(self._tracker, command["number"])
        except Exception as error:
            self._say_why_it_ends(error)
            raise

    def follow(self) -> bool:
        """Take ticks that have come and report if it is time; return whether there may be more."""
        if self._tracker is None or self._source is None:
            return False
        try:
            ticks = self._source.read().block
            if len(ticks):
                self._tracker.take(ticks)
            if self.monotonic_ns() >= self._report_ns:
                self._report_ns = self.monotonic_ns() + REPORT_NS
                tracked = self._tracker.tracked()
                self._report(tracked=ReportedTracking.of(tracked) if tracked else None)
        except Exception as error:
            self._say_why_it_ends(error)
            raise
        return len(ticks) == READ_AT_ONCE

    def _start(self, tracker: str, calibration: Path) -> None:
        self._source = RingSource(self.run_dir.ring, "now", at_once=READ_AT_ONCE)
        made = resolve_name(tracker)
        self._tracker = made(self.config, load(calibration), self.config.tracking.memory_s)

    def _adopt(self, tracker: Tracker, number: int) -> None:
        obstacle = ""
        try:
            tracker.adopted().save(self.run_dir.adopted)
        except CalibrationError as error:
            obstacle = str(error)[:OBSTACLE_MAX]
        self._report(adopted=AdoptedReport(number=number, obstacle=obstacle))

    def _say_why_it_ends(self, error: Exception) -> None:
        what = f"the tracker failed: {type(error).__name__}: {error}"
        self._report(obstacle=what[:OBSTACLE_MAX])

    def _report(
        self,
        tracked: ReportedTracking | None = None,
        adopted: AdoptedReport | None = None,
        obstacle: str = "",
    ) -> None:
        report = TrackerReport(tracked=tracked, adopted=adopted, obstacle=obstacle)
        self.reports.write(to_line(report.model_dump()))


def run(tracking: Tracking, commands: int) -> None:
    """Track until the descriptor `commands` is closed at its other end."""
    os.set_blocking(commands, False)
    lines = LineReader(commands)
    while not lines.ended:
        more = tracking.follow()
        select.select([commands], [], [], 0.0 if more else LOOK_S)
        for line in lines.read():
            tracking.handle(line)


def serve(config: Config, run_dir: RunDir, reports: LineWriter) -> None:
    """Track what stdin says. Raises CalibrationError if there is no such calibration."""
    run(Tracking(config, run_dir, reports), sys.stdin.fileno())


if __name__ == "__main__":
    end_process(background.run("tracker", serve))
