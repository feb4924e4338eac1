"""In which order files of tests run, and where: the longest first, system tests a few at a time.

A file is the unit: its tests run one after the other in one process; of TOGETHER the folder is,
since its files share what takes long to start. Files of system tests start
processes that keep to real time, so they run in lanes, the first processes of pytest. The others,
of a lower priority, run what needs no time of its own, and fill what system tests leave of the
processors while they wait.
"""

import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "tests" / "durations.json"
"""Seconds by file, on two idle processors; `tests/run.py --durations` writes it."""
LANES = "MOTORD_TEST_LANES"
"""How many processes are lanes; all without it."""
NICE = 5
"""Of the others: a lane that wants a processor gets three times as much of it."""
TOGETHER = "tests/browser"
"""Its files have one browser, whose processes take three seconds of a processor to start."""
LISTED_S = 3.0
"""Shorter files are not listed, and run last."""


def durations_s() -> dict[str, float]:
    """Return the table: seconds by file."""
    return dict(json.loads(TABLE.read_text()))


def write_durations(seconds: dict[str, float]) -> None:
    """Replace the seconds of the files that ran; the others keep theirs."""
    kept = {name: s for name, s in durations_s().items() if (ROOT / name).exists()} | seconds
    listed = {name: round(s) for name, s in kept.items() if s >= LISTED_S}
    longest_first = dict(sorted(listed.items(), key=lambda item: (-item[1], item[0])))
    TABLE.write_text(json.dumps(longest_first, indent=1) + "\n")


def file_of(nodeid: str) -> str:
    """Return the file that a test is in."""
    return nodeid.partition("::")[0]


def unit_of(nodeid: str) -> str:
    """Return what a test is handed out with: its file or folder."""
    file = file_of(nodeid)
    return TOGETHER if file.startswith(f"{TOGETHER}/") else file


def longest_first(items: list[pytest.Item]) -> None:
    """Put the files in the order of the table; the tests of a file keep theirs."""
    table = durations_s()
    items.sort(key=lambda item: -table.get(file_of(item.nodeid), 0.0))


@cache
def is_system(unit: str) -> bool:
    """Return whether a file, or one of a folder, has tests that start processes of their own."""
    path = ROOT / unit
    files = path.glob("test_*.py") if path.is_dir() else [path]
    return any("pytest.mark.system" in file.read_text() for file in files)


def lanes_of(processes: list[Any]) -> list[Any]:
    """Return those of the processes that are lanes: the first, as they are numbered."""
    numbered = sorted(processes, key=lambda process: number(process.gateway.id))
    return numbered[: int(os.environ.get(LANES, len(numbered)))]


def number(worker: str) -> int:
    """Return the number in the name that pytest-xdist gives to a process."""
    return int(worker.removeprefix("gw"))


def give_way(worker: str) -> None:
    """Lower the priority of this process, pytest-xdist's `worker`, unless it is a lane."""
    if LANES in os.environ and number(worker) >= int(os.environ[LANES]):
        os.nice(NICE)


class Lanes(LoadScopeScheduling):
    """Hands out files to processes as they become free, those of system tests to lanes alone.

    A lane runs the others when no system tests are left.
    """

    def _split_scope(self, nodeid: str) -> str:
        return unit_of(nodeid)

    def _reschedule(self, node: Any) -> None:
        if self.workqueue and self._next_unit(node) is None and not node.shutting_down:
            node.shutdown()
        super()._reschedule(node)

    def _assign_work_unit(self, node: Any) -> None:
        if unit := self._next_unit(node):
            self.workqueue.move_to_end(unit, last=False)
            super()._assign_work_unit(node)

    def _next_unit(self, node: Any) -> str | None:
        """Return which of the units that wait a process runs next, None if there is none for it."""
        lane = node in lanes_of(self.nodes)
        suited = (unit for unit in self.workqueue if is_system(unit) == lane)
        return next(suited, next(iter(self.workqueue), None) if lane else None)
