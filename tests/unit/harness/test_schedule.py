"""Files of tests: the longest first, those of system tests a few at a time."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support import schedule


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(schedule, "ROOT", tmp_path)
    monkeypatch.setattr(schedule, "TABLE", tmp_path / "durations.json")
    schedule.TABLE.write_text(json.dumps({"a.py": 9, "b.py": 5, "gone.py": 70, "u.py": 30}))
    for name in ("a.py", "b.py", "c.py"):
        (tmp_path / name).write_text("pytestmark = pytest.mark.system\n")
    (tmp_path / "u.py").write_text("")
    return tmp_path


@pytest.mark.usefixtures("root")
def test_the_longest_files_come_first_and_each_keeps_its_order() -> None:
    ids = ("b.py::2", "b.py::1", "c.py::1", "u.py::1")
    items = [SimpleNamespace(nodeid=nodeid) for nodeid in ids]
    schedule.longest_first(items)
    assert [item.nodeid for item in items] == ["u.py::1", "b.py::2", "b.py::1", "c.py::1"]


class Node:
    """A process of pytest-xdist that is sent tests."""

    def __init__(self, number: int) -> None:
        self.gateway = SimpleNamespace(id=f"gw{number}")
        self.sent: list[int] = []
        self.shutting_down = False

    def send_runtest_some(self, indices: list[int]) -> None:
        self.sent += indices

    def shutdown(self) -> None:
        self.shutting_down = True


@pytest.fixture
def handed_out(
    root: Path, pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[list[str], list[int]], list[Node]]]:
    """Return what hands out tests to processes, one of them a lane, as in the beginning."""
    (root / "v.py").write_text("")
    schedule.is_system.cache_clear()
    monkeypatch.setenv(schedule.LANES, "1")

    def hand_out(tests: list[str], numbers: list[int]) -> list[Node]:
        monkeypatch.setattr(
            "xdist.scheduler.loadscope.parse_tx_spec_config", lambda _: [None] * len(numbers)
        )
        lanes, nodes = schedule.Lanes(pytestconfig), [Node(number) for number in numbers]
        for node in nodes:
            lanes.add_node(node)
            lanes.add_node_collection(node, tests)
        monkeypatch.setattr(pytestconfig.option, "loadscopereorder", False, raising=False)
        lanes.schedule()
        return nodes

    yield hand_out
    schedule.is_system.cache_clear()


def test_system_tests_go_to_the_lane_and_the_others_elsewhere(
    handed_out: Callable[[list[str], list[int]], list[Node]],
) -> None:
    tests = ["u.py::1", "a.py::1", "u.py::2", "v.py::1", "b.py::1"]
    other, lane = handed_out(tests, [1, 0])
    assert (lane.sent, other.sent) == ([1, 4], [0, 2, 3])
    assert lane.shutting_down
    assert other.shutting_down


def test_a_lane_runs_the_others_when_no_system_tests_are_left(
    handed_out: Callable[[list[str], list[int]], list[Node]],
) -> None:
    lane, other = handed_out(["u.py::1", "a.py::1", "v.py::1"], [0, 1])
    assert (lane.sent, other.sent) == ([1, 2], [0])


def test_system_tests_are_left_to_the_lane_and_to_whoever_replaces_it(
    handed_out: Callable[[list[str], list[int]], list[Node]],
) -> None:
    lane, other = handed_out(["a.py::1", "b.py::1", "c.py::1"], [2, 3])
    assert (lane.sent, other.sent) == ([0, 1], [])
    assert other.shutting_down
    assert not lane.shutting_down


def test_files_that_share_a_browser_run_one_after_the_other_in_one_lane(
    root: Path, handed_out: Callable[[list[str], list[int]], list[Node]]
) -> None:
    folder = root / schedule.TOGETHER
    folder.mkdir(parents=True)
    (folder / "test_p.py").write_text("pytestmark = pytest.mark.system\n")
    (folder / "test_q.py").write_text("")
    page, pure = (f"{schedule.TOGETHER}/test_{name}.py::1" for name in "pq")
    lane, other = handed_out([page, "a.py::1", "u.py::1", pure, "v.py::1"], [0, 1])
    assert (lane.sent, other.sent) == ([0, 3, 1], [2, 4])


def test_only_what_is_no_lane_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[int] = []
    monkeypatch.setattr("os.nice", given.append)
    monkeypatch.delenv(schedule.LANES, raising=False)
    schedule.give_way("gw7")  # of a run without lanes
    monkeypatch.setenv(schedule.LANES, "2")
    for worker in ("gw0", "gw1", "gw2", "gw10"):
        schedule.give_way(worker)
    assert given == [schedule.NICE] * 2


def test_the_table_keeps_what_did_not_run_and_forgets_what_is_gone(root: Path) -> None:
    schedule.write_durations({"a.py": 4.4, "c.py": 1.0, "b.py": 2.0})
    assert list(schedule.durations_s().items()) == [("u.py", 30), ("a.py", 4)]
