"""A hash is used for a file that looks as it did, and no other."""

import json
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.batch import file_hashes
from motord.batch.file_hashes import FileHashes

HOUR_NS = 3_600_000_000_000


@pytest.fixture
def file(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"12")
    monkeypatch.setattr(file_hashes.time, "time_ns", lambda: path.stat().st_mtime_ns + HOUR_NS)
    hashes = FileHashes(tmp_path)
    hashes.add(path, path.stat(), "ab")
    hashes.save()
    return path


def test_it_is_kept_for_the_next_run(file):
    hashes = FileHashes(file.parent)
    assert hashes.find(file, file.stat()) == "ab"
    assert FileHashes(file.parent, trusted=False).find(file, file.stat()) is None


def longer(path, was_ns):
    path.write_bytes(b"123")
    os.utime(path, ns=(0, was_ns))


def touched(path, was_ns):
    os.utime(path, ns=(0, was_ns + 1000))


def replaced(path, was_ns):
    other = path.with_name("other")
    other.write_bytes(b"34")
    os.utime(other, ns=(0, was_ns))
    other.replace(path)


@pytest.mark.parametrize("change", [longer, touched, replaced])
def test_another_size_time_or_inode_is_another_file(file, change):
    change(file, file.stat().st_mtime_ns)
    assert FileHashes(file.parent).find(file, file.stat()) is None


def test_of_a_file_that_has_just_changed_none_is_kept(file, monkeypatch):
    new = file.with_name("new.mcap")
    new.write_bytes(b"1")
    just_ns = new.stat().st_mtime_ns + file_hashes.RACY_NS
    monkeypatch.setattr(file_hashes.time, "time_ns", lambda: just_ns)
    hashes = FileHashes(file.parent)
    hashes.add(new, new.stat(), "cd")
    hashes.save()
    assert FileHashes(file.parent).find(new, new.stat()) is None
    monkeypatch.setattr(file_hashes.time, "time_ns", lambda: just_ns + 1)
    hashes.add(new, new.stat(), "cd")
    hashes.save()
    assert FileHashes(file.parent).find(new, new.stat()) == "cd"


def test_two_runs_keep_what_each_other_found(file):
    first, second = FileHashes(file.parent), FileHashes(file.parent)
    for hashes, name in ((first, "b"), (second, "c")):
        hashes.add(file.with_name(name), file.stat(), name)
    first.save()
    second.save()
    last = FileHashes(file.parent)
    found = [last.find(file.with_name(name), file.stat()) for name in ("a.mcap", "b", "c")]
    assert found == ["ab", "b", "c"]


@given(
    st.one_of(
        st.binary(max_size=40),
        st.recursive(st.integers() | st.text(max_size=3) | st.none(), st.lists, max_leaves=3).map(
            lambda value: json.dumps({"PATH": value}).encode()
        ),
    )
)
def test_what_is_damaged_is_not_used(tmp_path_factory, noise):
    path = tmp_path_factory.mktemp("hashes") / "a.mcap"
    path.touch()
    hashes = FileHashes(path.parent)
    hashes.add(path, path.stat(), "ab")
    hashes._path.write_bytes(noise.replace(b"PATH", str(path).encode()))
    assert FileHashes(path.parent).find(path, path.stat()) is None
