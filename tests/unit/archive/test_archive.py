"""What is archived, what is left alone and why, what is resumed, deleted and found to differ."""

import json
import os
import time

import pytest

from motord.archive import manifest as manifests
from motord.archive.archive import DAY_NS, RecordingArchive, verify
from motord.archive.pace import (
    CHUNK_MAX,
    CHUNK_MIN,
    ConflictError,
    Pace,
    PausedError,
    SameFolderError,
)
from motord.archive.selection import select
from motord.archive.verified_copy import copy_verified, partial_of
from motord.client.roster import BenchRoster
from motord.recording.mcap.mcap_file import try_lock
from motord.recording.mcap.records import MAGIC
from tests.support.played_benches import state_of
from tests.unit.archive.test_faults import CHUNK, one_round, recordings, small_pace

NAME = "b-1-000.mcap"


@pytest.fixture
def folders(tmp_path):
    source, copies, _ = recordings(tmp_path)
    return source, copies


def test_what_is_archived_is_not_copied_again(folders):
    source, copies = folders
    archive = RecordingArchive(source, copies, small_pace())
    assert len(archive.update(select(source)).copied) == 2
    assert archive.update(select(source)).there == 2
    assert one_round(*folders).there == 2
    os.utime(source / NAME, ns=(1, 1))  # the same content all the same
    assert one_round(*folders).there == 2


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_who_may_read_a_recording_may_read_its_copy(folders, mode):
    """And nobody else, also where a round that was interrupted began it with another mode."""
    source, copies = folders
    (source / NAME).chmod(mode)
    partial_of(source / NAME, copies / NAME).touch(0o644)
    one_round(*folders)
    assert (copies / NAME).stat().st_mode & 0o777 == mode


def test_another_file_of_the_name_is_left_alone_and_the_others_are_archived(folders):
    _source, copies = folders
    (copies / NAME).write_bytes(b"somebody else's")
    report = one_round(*folders)
    assert "another file than the recording of this name" in report.conflicts[NAME]
    assert report.copied == ["blackbox/blackbox-b-1.mcap"]
    assert (copies / NAME).read_bytes() == b"somebody else's"


def test_a_recording_that_differs_from_its_manifest_is_another_one(folders):
    source, _copies = folders
    one_round(*folders)
    data = (source / NAME).read_bytes()
    (source / NAME).write_bytes(data[:-9] + b"x" + data[-8:])
    os.utime(source / NAME, ns=(1, 1))
    report = one_round(*folders, 0.0)
    assert "another file" in report.conflicts[NAME]
    assert (source / NAME).exists()


def test_a_copy_that_is_cut_is_not_taken_for_one(folders):
    source, copies = folders
    one_round(*folders)
    os.truncate(copies / NAME, 10)
    assert "is not as its manifest says" in one_round(*folders, 0.0).conflicts[NAME]
    assert (source / NAME).exists()


@pytest.mark.parametrize("content", ["{", "[]", '{"file": 3}', "\x00"])
def test_a_manifest_that_is_none_is_left_alone(folders, content):
    _, copies = folders
    manifests.manifest_of(copies / NAME).write_text(content)
    assert "not a manifest of the archive" in one_round(*folders).conflicts[NAME]


def test_a_changed_bit_in_the_archive_is_found_and_keeps_the_recording(folders):
    source, copies = folders
    one_round(*folders)
    with (copies / NAME).open("r+b") as file:
        file.seek(100)
        byte = file.read(1)
        file.seek(100)
        file.write(bytes([byte[0] ^ 1]))
    differing = {name: problem for name, problem in verify(copies, Pace()) if problem}
    assert list(differing) == [NAME]
    assert "differs from what was archived on 20" in differing[NAME]
    assert "is not deleted" in one_round(*folders, 0.0).conflicts[NAME]
    assert (source / NAME).exists()


def test_a_copy_that_is_gone_is_made_again_and_stops_no_round(folders):
    source, copies = folders
    archive = RecordingArchive(source, copies, small_pace())
    archive.update(select(source))
    (copies / NAME).unlink()
    report = archive.update(select(source), 0.0)
    assert "is gone" in report.conflicts[NAME]
    assert report.deleted == ["blackbox/blackbox-b-1.mcap"]
    assert archive.update(select(source)).copied == [NAME]


def test_missing_copies_and_files_without_a_manifest_are_named(folders):
    _, copies = folders
    one_round(*folders)
    (copies / NAME).unlink()
    (copies / "other.mcap").write_bytes(b"x")
    problems = dict(verify(copies, Pace()))
    assert problems == {
        NAME: "is missing", "blackbox/blackbox-b-1.mcap": "", "other.mcap": "has no manifest",
    }  # fmt: skip
    assert one_round(*folders).copied == [NAME]


def test_nothing_is_deleted_before_its_time(folders):
    source, copies = folders
    assert not one_round(*folders, 1.0).deleted
    path = manifests.manifest_of(copies / NAME)
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "verified_ns": time.time_ns() - 2 * DAY_NS}))
    assert one_round(*folders, 1.0).deleted == [NAME]
    assert not (source / NAME).exists()


def test_what_is_read_back_is_what_counts(folders, monkeypatch):
    source, copies = folders
    real = os.write

    def with_a_wrong_bit(descriptor, data):
        return real(descriptor, bytes([data[0] ^ 1]) + bytes(data[1:]))

    monkeypatch.setattr(os, "write", with_a_wrong_bit)
    report = one_round(*folders, 0.0)
    assert "what is read back there is not what was written" in report.stopped
    assert not list(copies.rglob("*.mcap"))
    assert (source / NAME).exists()


def test_it_stops_within_a_chunk_and_goes_on_from_there(folders):
    source, copies = folders
    seen = []
    pace = Pace(busy=lambda: "bench b is enabled" if len(seen) > 3 else seen.append(1) or "")
    pace.chunk_bytes = CHUNK
    report = RecordingArchive(source, copies, pace).update(select(source))
    assert (report.stopped, report.paused) == ("bench b is enabled", True)
    partial = partial_of(source / NAME, copies / NAME)
    inode, size = partial.stat().st_ino, partial.stat().st_size
    assert size in (CHUNK, 2 * CHUNK)
    written = []
    monkey = pytest.MonkeyPatch()
    real = os.write
    monkey.setattr(os, "write", lambda fd, data: written.append(len(data)) or real(fd, data))
    with monkey.context():
        copy_verified(source / NAME, copies / NAME, small_pace())
    monkey.undo()
    assert sum(written) == (source / NAME).stat().st_size - size
    assert (copies / NAME).stat().st_ino == inode


def test_the_limit_holds_and_waits_are_broken_off():
    now_s = [0.0]
    pace = Pace(1e6, clock_s=lambda: now_s[0], sleep=lambda s: now_s.__setitem__(0, now_s[0] + s))
    for _ in range(100):
        pace.spend(pace.chunk_bytes)
    assert now_s[0] == pytest.approx(100 * pace.chunk_bytes / 1e6)
    busy = Pace(1.0, lambda: "" if now_s[0] < 50 else "now", lambda: now_s[0],
                lambda s: now_s.__setitem__(0, now_s[0] + s))  # fmt: skip
    with pytest.raises(PausedError, match="now"):
        busy.spend(10**6)
    assert now_s[0] < 50.1
    assert [Pace(rate).chunk_bytes for rate in (1.0, None)] == [CHUNK_MIN, CHUNK_MAX]


def test_watching_waits_in_place_until_the_bench_is_idle(folders):
    source, copies = folders
    said, looks = [], []

    def busy():
        looks.append(1)
        return "it records" if 3 < len(looks) < 9 else ""

    pace = Pace(busy=busy, sleep=lambda s: None, on_busy=said.append)
    report = RecordingArchive(source, copies, pace).update(select(source))
    assert (said, len(report.copied), report.stopped) == (["it records", ""], 2, "")


def test_two_at_once_do_not_write_to_one_file(folders):
    source, copies = folders
    partial = partial_of(source / NAME, copies / NAME)
    with partial.open("wb") as other:
        assert try_lock(other.fileno())
        report = one_round(*folders)
    assert "another `motord archive` copies it now" in report.conflicts[NAME]
    assert one_round(*folders).copied == [NAME]


@pytest.mark.parametrize("written_s", [1, 1 << 33])
def test_only_whole_recordings_are_copied(folders, written_s):
    """Also where the clock was set back since one that is not whole was written."""
    source, _copies = folders
    (source / "cut-000.mcap").write_bytes(MAGIC + b"and no end")
    (source / "b-2.closing.mcap").write_bytes(MAGIC + MAGIC)
    left = source / "left-000.mcap.part"
    left.write_bytes(MAGIC)
    os.utime(left, (written_s, written_s))
    report = one_round(*folders)
    assert sorted(report.unfinished) == ["cut-000.mcap", "left-000.mcap.part"]
    assert len(report.copied) == 2
    with left.open("r+b") as file:
        assert try_lock(file.fileno())
        paused = one_round(*folders)
    assert (paused.being_written, paused.paused) == ([left.name], True)


@pytest.mark.parametrize("where", ["gone", "runs/b-1-000.mcap"])
def test_an_archive_that_is_none(tmp_path, folders, where):
    assert "no such folder" in one_round(folders[0], tmp_path / where, 0.0).stopped
    assert (folders[0] / NAME).exists()


@pytest.mark.parametrize("where", ["runs", "runs/blackbox", "link"])
def test_an_archive_that_is_where_the_recordings_are_is_refused(tmp_path, folders, where):
    """No next run goes on from there."""
    (tmp_path / "link").symlink_to(tmp_path / "runs")
    with pytest.raises(SameFolderError, match="where the recordings are; name another folder"):
        one_round(folders[0], tmp_path / where, 0.0)
    assert (folders[0] / NAME).exists()


def test_a_copy_that_is_the_recording_itself_deletes_nothing(folders):
    source, copies = folders
    (copies / NAME).symlink_to(source / NAME)
    assert "the recording itself" in one_round(*folders, 0.0).conflicts[NAME]
    (copies / NAME).unlink()
    one_round(*folders)
    (copies / NAME).unlink()
    (copies / NAME).symlink_to(source / NAME)
    assert one_round(*folders, 0.0).conflicts
    manifests.manifest_of(copies / NAME).unlink()
    (copies / NAME).unlink()
    (copies / NAME).symlink_to("nowhere")
    assert "another file" in one_round(*folders, 0.0).conflicts[NAME]
    assert (source / NAME).exists()


def test_a_recording_that_changes_meanwhile_is_not_archived(folders, monkeypatch):
    source, copies = folders

    def touched():
        os.utime(source / NAME)
        return ""

    with pytest.raises(ConflictError, match="changed while it was copied"):
        copy_verified(source / NAME, copies / NAME, Pace(busy=touched))
    assert not (copies / NAME).exists()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, ""),
        ({"state": "TRIPPED"}, ""),
        ({"state": "ENABLED"}, "bench a is enabled"),
        ({"fault": "no loop"}, ""),
    ],
)
def test_when_a_bench_is_needed(changes, why):
    roster = BenchRoster()
    roster.token("a", "x", there=True)
    assert "does not say" in roster.entries(0.0)[0].needed_for
    roster.published("a", state_of("a", **changes), 0.0)
    assert roster.entries(0.5)[0].needed_for == why
    assert "does not say" in roster.entries(2.0)[0].needed_for
