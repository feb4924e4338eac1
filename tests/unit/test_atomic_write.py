import errno
import os
import stat
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest

from motord.atomic_write import write_cached, write_whole

Write = Callable[[Path, str | bytes], None]


@pytest.mark.parametrize("write", [write_whole, write_cached])
def test_it_is_there_whole_and_alone(tmp_path: Path, write: Write) -> None:
    path = tmp_path / "a.json"
    write(path, "old\n")
    write(path, "new é\n")
    assert path.read_text(encoding="utf-8") == "new é\n"
    write(path, b"\xff\r\n")
    assert path.read_bytes() == b"\xff\r\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    ("write", "broken"),
    [(write_whole, "fsync"), (write_whole, "replace"), (write_cached, "replace")],
)
def test_what_was_there_stays_if_writing_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Write, broken: str
) -> None:
    path = tmp_path / "a.json"
    write(path, "old\n")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, "fsync", fail) if broken == "fsync" else (Path, "replace", fail)))
    with pytest.raises(OSError, match="No space"):
        write(path, "new\n")
    assert path.read_text() == "old\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize("write", [write_whole, write_cached])
@pytest.mark.parametrize(
    ("place", "why"),
    [("absent/a.json", "there is no folder {folder}/absent; make it"), ("file/a.json", "Not a ")],
)
def test_an_error_names_the_file_that_was_asked_for(
    tmp_path: Path, write: Write, place: str, why: str
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"a\.json") as raised:
        write(tmp_path / place, "new")
    assert raised.value.filename == str(tmp_path / place)
    assert raised.value.strerror.startswith(why.format(folder=tmp_path))


@pytest.mark.parametrize(("number", "fails"), [(errno.EINVAL, False), (errno.EIO, True)])
def test_a_folder_that_cannot_be_synced_is_none_of_those_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, fails: bool
) -> None:
    def of_folders(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", of_folders)
    with pytest.raises(OSError, match="Input") if fails else nullcontext():
        write_whole(tmp_path / "a.json", "new")
    assert (tmp_path / "a.json").read_text() == "new"


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_who_may_read_and_write_a_file_stays(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "bench.toml"
    path.touch()
    path.chmod(mode)
    before, umask = path.stat(), os.umask(0o037)
    try:
        write_whole(path, "new")
    finally:
        os.umask(umask)
    for name in ("st_mode", "st_uid", "st_gid"):
        assert getattr(path.stat(), name) == getattr(before, name)


def test_nobody_else_can_open_a_private_file_before_its_content_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, chmod, before = tmp_path / "own.toml", os.fchmod, list[os.stat_result]()
    path.touch(0o600)

    def noted(descriptor: int, mode: int) -> None:
        before.append(os.fstat(descriptor))
        chmod(descriptor, mode)

    monkeypatch.setattr(os, "fchmod", noted)
    write_whole(path, "x" * 1_000_000)
    assert [(stat.S_IMODE(status.st_mode), status.st_size) for status in before] == [(0o600, 0)]


@pytest.mark.parametrize(
    ("mode", "left"), [(0o600, 0o600), (0o660, 0o600), (0o664, 0o644), (0o4755, 0o755)]
)
def test_another_group_may_do_no_more_than_everybody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, left: int
) -> None:
    def refused(descriptor: int, uid: int, gid: int) -> None:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    path = tmp_path / "bench.toml"
    path.touch()
    path.chmod(mode)
    monkeypatch.setattr(os, "fchown", refused)
    write_whole(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == left


@pytest.mark.parametrize("write", [write_whole, write_cached])
def test_nothing_is_written_through_a_link_that_somebody_left(tmp_path: Path, write: Write) -> None:
    path, other = tmp_path / "a.json", tmp_path / "other"
    other.write_text("of somebody else")
    (tmp_path / f".a.json.{os.getpid()}.tmp").symlink_to(other)
    write(path, "new")
    assert other.read_text() == "of somebody else"
    assert not path.is_symlink()
    assert path.read_text() == "new"


def test_links_and_pipes_stay_what_they_are(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "target", tmp_path / "link", tmp_path / "pipe"
    target.write_text("old")
    link.symlink_to(target)
    write_whole(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, "text")
        assert os.read(reading, 100) == b"text"
    finally:
        os.close(reading)
    assert pipe.is_fifo()
