"""Files of tests: the longest first, those of system tests in lanes of about the same length."""

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
def test_system_files_share_lanes_and_others_stand_alone() -> None:
    unit = schedule.units(2)
    found = [unit(file) for file in ("u.py", "a.py", "b.py", "c.py", "a.py")]
    assert found == ["u.py", "lane 0", "lane 1", "lane 1", "lane 0"]


def test_the_table_keeps_what_did_not_run_and_forgets_what_is_gone(root: Path) -> None:
    schedule.write_durations({"a.py": 4.4, "c.py": 1.0, "b.py": 2.0})
    assert list(schedule.durations_s().items()) == [("u.py", 30), ("a.py", 4)]
