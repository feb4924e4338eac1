"""In which order files of tests run, and where: the longest first, system tests a few at a time.

A file is the unit: its tests run one after the other in one process. Files of system tests start
processes that keep to real time, so they run in lanes, some at a time: `tests/run.py` has more
processes than lanes, which run what needs no time of its own, and fill what system tests leave of
the processors while they wait.
"""

import json
import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "tests" / "durations.json"
"""Seconds by file, on two idle processors; `tests/run.py --durations` writes it."""
LANES = "MOTORD_TEST_LANES"
"""How many files of system tests may run at a time; as many as there are processes without it."""
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


def longest_first(items: list[pytest.Item]) -> None:
    """Put the files in the order of the table; the tests of a file keep theirs."""
    table = durations_s()
    items.sort(key=lambda item: -table.get(file_of(item.nodeid), 0.0))


def next_file(waiting: Iterable[str], lanes: int) -> str:
    """Return which of the files that wait is handed out next, if so many lanes are free: one of
    system tests if there is any, else one of the others; if there is none, the first."""
    waiting = list(waiting)
    return next((file for file in waiting if is_system(file) == (lanes > 0)), waiting[0])


@cache
def is_system(file: str) -> bool:
    """Return whether a file has tests that start processes of their own."""
    return "pytest.mark.system" in (ROOT / file).read_text()


class Lanes(LoadScopeScheduling):
    """Hands out files to processes as they become free, `LANES` files of system tests at a time."""

    def _split_scope(self, nodeid: str) -> str:
        return file_of(nodeid)

    def _assign_work_unit(self, node: Any) -> None:
        lanes = int(os.environ.get(LANES, self.numnodes))
        for other, files in self.assigned_work.items():
            unfinished = (file for file, tests in files.items() if not all(tests.values()))
            lanes -= other is not node and any(map(is_system, unfinished))
        self.workqueue.move_to_end(next_file(self.workqueue, lanes), last=False)
        super()._assign_work_unit(node)
