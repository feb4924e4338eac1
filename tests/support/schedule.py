"""In which order files of tests run, and where: the longest first, system tests a few at a time.

A file is the unit: its tests run one after the other in one process. Files of system tests start
processes that keep to real time, so they form lanes: `tests/run.py` has one process more than
lanes, which runs what needs no time of its own, and fills what system tests leave of the
processors while they wait.
"""

import json
import os
from collections.abc import Callable
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


class Lanes(LoadScopeScheduling):
    """Hands out files; those of system tests in lanes, each to one process."""

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        self._units = units(int(os.environ.get(LANES, self.numnodes)))

    def _split_scope(self, nodeid: str) -> str:
        return self._units(file_of(nodeid))


def units(lanes: int) -> Callable[[str], str]:
    """Return what names the unit of a file; a new file of system tests joins the shortest lane."""
    table = durations_s()
    lane_s = [0.0] * lanes
    known: dict[str, str] = {}

    def unit(file: str) -> str:
        if file not in known:
            known[file] = file
            if "pytest.mark.system" in (ROOT / file).read_text():
                lane = lane_s.index(min(lane_s))
                lane_s[lane] += table.get(file, LISTED_S)
                known[file] = f"lane {lane}"
        return known[file]

    return unit
