"""Whatever the disk does and whenever the process is killed: nothing is lost, nothing is half."""

import errno
import hashlib
import json
import random
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.archive import archive as archiving
from motord.archive.archive import RecordingArchive, verify
from motord.archive.pace import Pace
from motord.archive.selection import select
from motord.recording.mcap.records import MAGIC
from tests.unit.archive.faulty_disk import FaultyDisk, Killed

CHUNK = 4096
NAMES = ("b-1-000.mcap", "blackbox/blackbox-b-1.mcap")
FAULTS = ("kill", "cut", "short", errno.ENOSPC, errno.EIO)


def recordings(folder, names=NAMES):
    source, copies = folder / "runs", folder / "archive"
    (source / "blackbox").mkdir(parents=True)
    copies.mkdir()
    content = {}
    for name in names:
        content[name] = MAGIC + random.Random(name).randbytes(CHUNK * 3 // 2) + MAGIC
        (source / name).write_bytes(content[name])
    return source, copies, content


def small_pace():
    pace = Pace()
    pace.chunk_bytes = CHUNK
    return pace


def one_round(source, copies, delete=None):
    return RecordingArchive(source, copies, small_pace()).update(select(source), delete)


def assert_nothing_lost(source, copies, content):
    for name, data in content.items():
        copy, manifest = copies / name, copies / f"{name}.json"
        if copy.exists():
            assert copy.read_bytes() == data, f"{name}: half a copy under its final name"
        if manifest.exists():
            assert json.loads(manifest.read_text())["sha256"] == hashlib.sha256(data).hexdigest()
            assert copy.exists(), f"{name}: a manifest without a copy"
        if not (source / name).exists():
            assert manifest.exists(), f"{name}: deleted without a verified copy"


def attempt(at, fault, source, copies, delete):
    """Return whether the operation `at` came, after a round with this fault."""
    disk, archive = FaultyDisk(at, fault), RecordingArchive(source, copies, small_pace())
    selected = select(source)
    try:
        with disk():
            archive.update(selected, delete)
    except Killed:
        pass
    if fault == "cut":
        disk.lose_unsynced(copies)
    return disk.count >= at


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_at_every_single_operation(fault):
    at, more = 1, True
    with tempfile.TemporaryDirectory() as base:
        while more:
            folder = Path(base, str(at))
            source, copies, content = recordings(folder, NAMES[1:])
            more = attempt(at, fault, source, copies, 0.0)
            assert_nothing_lost(source, copies, content)
            report = one_round(source, copies)
            assert (report.stopped, report.conflicts) == ("", {}), at
            assert_nothing_lost(source, copies, content)
            assert {name for name, problem in verify(copies, Pace()) if not problem} == {NAMES[1]}
            assert not list(copies.rglob("*.partial"))
            shutil.rmtree(folder)
            at += 1
    assert at > 25


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.integers(1, 120), st.sampled_from(FAULTS)), max_size=6),
    st.sampled_from([None, 0.0]),
)
def test_faults_one_after_the_other(faults, delete):
    with tempfile.TemporaryDirectory() as base:
        source, copies, content = recordings(Path(base))
        for at, fault in faults:
            attempt(at, fault, source, copies, delete)
            assert_nothing_lost(source, copies, content)
        report = one_round(source, copies, delete)
        assert (report.stopped, report.conflicts) == ("", {})
        assert_nothing_lost(source, copies, content)
        assert all((copies / f"{name}.json").exists() for name in NAMES)


def _straight(source, copy, pace):
    copy.write_bytes(b"")
    with copy.open("wb") as file:
        file.write(source.read_bytes())
    return hashlib.sha256(source.read_bytes()).hexdigest()


def test_a_copy_that_grows_under_its_final_name_is_found(monkeypatch):
    monkeypatch.setattr(archiving, "copy_verified", _straight)
    with pytest.raises(AssertionError, match="half a copy"):
        test_a_fault_at_every_single_operation("kill")
