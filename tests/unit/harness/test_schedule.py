"""Files of tests: the longest first, those of system tests a few at a time."""

import json
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


@pytest.mark.usefixtures("root")
@pytest.mark.parametrize(
    ("waiting", "lanes", "chosen"),
    [
        (("u.py", "a.py", "b.py"), 2, "a.py"),
        (("u.py", "b.py"), 1, "b.py"),
        (("b.py", "u.py"), 0, "u.py"),
        (("b.py", "c.py"), 0, "b.py"),
        (("u.py",), 2, "u.py"),
    ],
)
def test_a_free_lane_takes_a_file_of_system_tests(
    waiting: tuple[str, ...], lanes: int, chosen: str
) -> None:
    schedule.is_system.cache_clear()
    assert schedule.next_file(waiting, lanes) == chosen
    schedule.is_system.cache_clear()


class Node:
    """A process of pytest-xdist that is sent tests."""

    shutting_down = False

    def __init__(self) -> None:
        self.sent: list[int] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        self.sent += indices


def test_a_process_that_ends_one_system_file_keeps_its_lane(
    root: Path, pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its next file waits behind its last test: these are one lane, not two."""
    (root / "v.py").write_text("")
    schedule.is_system.cache_clear()
    monkeypatch.setenv(schedule.LANES, "1")
    monkeypatch.setattr("xdist.scheduler.loadscope.parse_tx_spec_config", lambda _: [None] * 2)
    lanes, nodes = schedule.Lanes(pytestconfig), (Node(), Node())
    tests = ["a.py::1", "u.py::1", "u.py::2", "v.py::1", "b.py::1"]
    for node in nodes:
        lanes.add_node(node)
        lanes.registered_collections[node] = tests
    lanes.collection = tests
    for nodeid in tests:
        lanes.workqueue.setdefault(schedule.file_of(nodeid), {})[nodeid] = False
    for node in (nodes[0], nodes[1], nodes[0]):
        lanes._assign_work_unit(node)
    schedule.is_system.cache_clear()
    assert (nodes[0].sent, nodes[1].sent) == ([0, 4], [1, 2])


def test_the_table_keeps_what_did_not_run_and_forgets_what_is_gone(root: Path) -> None:
    schedule.write_durations({"a.py": 4.4, "c.py": 1.0, "b.py": 2.0})
    assert list(schedule.durations_s().items()) == [("u.py", 30), ("a.py", 4)]
