"""The run folder: private, one daemon, clear refusals, nothing left after a crash."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from motord.process.private_folder import base_directory
from motord.shm import run_directory
from motord.shm.run_directory import RunDir, RunDirError

HOLD = """
import sys
from pathlib import Path
from motord.shm.run_directory import RunDir
with RunDir("bench", Path(sys.argv[1])).hold() as held:
    held.ring.write_bytes(b"ring of " + sys.argv[2].encode())
    print("held", flush=True)
    sys.stdin.readline()
"""


def holder(base: Path, name: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-c", HOLD, str(base), name]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"held\n"
    return process


def test_base_is_the_users_runtime_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert base_directory() == tmp_path / "motord"
    for other in ("", str(tmp_path / "none")):
        monkeypatch.setenv("XDG_RUNTIME_DIR", other)
        assert base_directory() == Path(f"/dev/shm/motord-{os.getuid()}")


def test_names_of_files(tmp_path: Path) -> None:
    run_dir = RunDir.at(tmp_path / "b")
    assert run_dir.bench == "b"
    names = [run_dir.ring, run_dir.setpoint, run_dir.tables, run_dir.loop_status]
    assert [n.name for n in names] == ["ring", "setpoint", "tables", "loop.json"]
    assert {n.parent for n in names} == {tmp_path / "b"}


def test_folder_is_private_and_goes_when_done(tmp_path: Path) -> None:
    base = tmp_path / "base"
    with RunDir("b", base).hold() as run_dir:
        assert run_dir.path.stat().st_mode & 0o777 == 0o700
        assert base.stat().st_mode & 0o777 == 0o700
        run_dir.ring.touch()
        run_dir.loop_status.touch()
    assert not run_dir.path.exists()


def test_open_folder_is_closed(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir(mode=0o755)
    RunDir("b", tmp_path).create()
    assert (tmp_path / "b").stat().st_mode & 0o777 == 0o700


def test_folder_of_another_user_or_kind_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with pytest.raises(RunDirError, match="no folder"):
        RunDir("link", tmp_path).create()
    (tmp_path / "file").touch()
    with pytest.raises(RunDirError, match=r"cannot make it: .*; let XDG_RUNTIME_DIR name"):
        RunDir("file", tmp_path).create()
    monkeypatch.setattr(run_directory.os, "getuid", lambda: 12345)
    with pytest.raises(RunDirError, match="another user"):
        RunDir("real", tmp_path).create()


def test_the_refusal_of_a_second_daemon_names_the_one_that_runs(tmp_path: Path) -> None:
    with holder(tmp_path, "first") as process:
        with (
            pytest.raises(RunDirError, match=f"daemon process {process.pid} holds .*stop it"),
            RunDir("bench", tmp_path).hold(),
        ):
            pass
        assert RunDir("bench", tmp_path).ring.read_bytes() == b"ring of first"
        with RunDir("other", tmp_path).hold():
            pass
        process.communicate(b"end\n")
    assert not (tmp_path / "bench").exists()


def test_files_of_a_killed_daemon_are_replaced(tmp_path: Path) -> None:
    with holder(tmp_path, "first") as process:
        process.kill()
    run_dir = RunDir("bench", tmp_path)
    assert run_dir.ring.read_bytes() == b"ring of first"
    with run_dir.hold():
        assert not run_dir.ring.exists()
        [left] = run_dir.left_rings()
        assert left.read_bytes() == b"ring of first"
    [left] = run_dir.left_rings()  # nobody has looked after it
    left.unlink()
    with run_dir.hold():
        pass
    assert not run_dir.path.exists()


def test_lock_waits_for_its_holder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_dir = RunDir("b", tmp_path)
    run_dir.create()
    first = run_dir.lock("loop", 0.0)
    first.__enter__()
    monkeypatch.setattr(run_directory.time, "sleep", lambda _s: first.__exit__(None, None, None))
    with run_dir.lock("loop", 60.0):
        assert (run_dir.path / "loop.lock").read_text() == str(os.getpid())


def test_lock_is_not_fooled_by_a_removed_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The holder removes the lock file between our opening and locking it."""
    run_dir = RunDir("b", tmp_path)
    run_dir.create()
    path = run_dir.path / "daemon.lock"
    real_flock, calls = run_directory.fcntl.flock, []

    def flock(descriptor: int, operation: int) -> None:
        if not calls:
            path.unlink()
        calls.append(descriptor)
        real_flock(descriptor, operation)

    monkeypatch.setattr(run_directory.fcntl, "flock", flock)
    with run_dir.lock("daemon", 0.0):
        assert len(calls) == 2
        assert path.read_text() == str(os.getpid())


def test_holder_without_a_name_is_a_question_mark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_dir = RunDir("b", tmp_path)
    run_dir.create()
    with run_dir.lock("loop", 0.0):
        (run_dir.path / "loop.lock").write_text("")
        with pytest.raises(RunDirError, match=r"process \? holds"), run_dir.lock("loop", 0.0):
            pass
    assert run_directory._holder(tmp_path / "none") == "?"


def test_a_folder_that_is_removed_under_the_daemon(tmp_path: Path) -> None:
    """As the runtime directory of a user who logs out."""
    with RunDir("bench", tmp_path).hold() as held:
        held.ring.write_bytes(b"ring")
        shutil.rmtree(held.path)
        where = re.escape(str(held.path / "loop.lock"))
        with (
            pytest.raises(RunDirError, match=f"{where}: cannot open it: No such file"),
            held.lock("loop", 0.0),
        ):
            pass
    assert not held.path.exists()
