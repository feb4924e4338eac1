"""Temporary folders: none stays of a process that was killed, and none in use is removed."""

import fcntl
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from motord.process import temporary_folder as module
from motord.process.temporary_folder import remove_left, temporary_folder

KILLED = """
import os, signal, sys
from pathlib import Path
from motord.process.temporary_folder import temporary_folder

with temporary_folder("tests-", Path(sys.argv[1])) as folder:
    (folder / "rows").write_bytes(bytes(9))
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)])
    assert done.returncode == -signal.SIGKILL
    (other := tmp_path / "other").mkdir()
    [left] = set(tmp_path.iterdir()) - {other}
    assert (left / "rows").exists()
    remove_left("tests-", tmp_path)
    assert {*tmp_path.iterdir()} == {other}
    with temporary_folder("tests-", tmp_path) as folder:
        (folder / "rows").write_bytes(b"")
        assert {*tmp_path.iterdir()} == {folder, other}
    assert {*tmp_path.iterdir()} == {other}


def test_those_in_use_stay(tmp_path: Path) -> None:
    with temporary_folder("tests-", tmp_path) as first, temporary_folder("tests-", tmp_path):
        remove_left("tests-", tmp_path)
        assert first.exists()
        assert len(list(tmp_path.iterdir())) == 2


def test_one_that_is_taken_for_left_before_it_is_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Path] = []
    real = module.tempfile.mkdtemp

    def taken_away(**named: object) -> str:
        made.append(Path(real(**named)))
        if len(made) == 1:
            module._remove_left(made[0])
        return str(made[-1])

    monkeypatch.setattr(module.tempfile, "mkdtemp", taken_away)
    with temporary_folder("tests-", tmp_path) as folder:
        assert folder == made[1]
        assert folder.exists()


def test_one_that_is_removed_while_it_is_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, folders = fcntl.flock, []

    def slow(descriptor: int, how: int) -> None:
        folders.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        if len(folders) == 1:
            folders[0].rmdir()
        real(descriptor, how)

    monkeypatch.setattr(module.fcntl, "flock", slow)
    with temporary_folder("tests-", tmp_path) as folder:
        assert folder == folders[1]
        assert folder.exists()
