"""The journal of a plan: what a crash leaves of it."""

import errno
import os
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.service.plans import journal_file
from motord.service.plans.journal import PlanNote, read
from motord.service.plans.journal_file import Journal

NOTE = PlanNote(
    run_id="r1", name="calibrate", settings={"turns": 2, "notes": "a\nb\u2028\r"}, points=4,
    points_digest="d", bench_parts={"motor": "m"}, calibration="", started_by="anna",
    notes="by night", t_ns=7,
)  # fmt: skip


def point(index, quality="ok", take=1):
    return {"index": index, "quality": quality, "take": take, "tick_end": 9}


@pytest.fixture
def journal(tmp_path):
    return Journal(tmp_path / "state" / "plans" / "sim.jsonl")


def reloaded(journal):
    journal.settle()
    again = Journal(journal._disk.path)
    again.load()
    return again


def fill(journal, points):
    journal.begin(NOTE, "/runs/a-000.mcap")
    for taken in points:
        journal.point(taken)


def test_a_plan_is_recorded_as_it_happened(journal):
    fill(journal, [point(0), point(1, "noisy"), point(1, "ok", 2)])
    journal.end("aborted", "by ben", 8)
    journal.resumed("/runs/b-000.mcap", "carl", 9)
    journal.point(point(3))
    log = reloaded(journal).log
    assert log == journal.log
    assert log.plan == NOTE
    assert log.recordings == ("/runs/a-000.mcap", "/runs/b-000.mcap")
    assert (log.segments[0].state, log.state) == ("aborted", "")
    assert log.taken == {0, 1, 3}
    journal.end("done", "", 10)
    assert reloaded(journal).log.state == "done"


def test_a_journal_of_an_earlier_version_is_read():
    content = Path(__file__).with_name("journal_format_1.jsonl").read_bytes()
    parsed = read(content)
    assert parsed.size == len(content)
    assert (parsed.log.plan.name, parsed.log.plan.points) == ("calibrate", 3)
    assert parsed.log.taken == {0, 1}
    assert [segment.state for segment in parsed.log.segments] == ["aborted", ""]
    assert [segment.complete for segment in parsed.log.segments] == [True, False]
    assert parsed.log.recordings == ("/runs/calibrate.mcap", "/runs/calibrate.mcap")


def test_a_poor_point_counts_only_when_it_is_not_to_be_taken_again(journal):
    fill(journal, [point(0, "noisy"), point(1, "noisy", 3)])
    assert journal.log.taken == {1}


def test_without_a_file_there_is_no_story(journal):
    assert reloaded(journal).log is None
    journal.point(point(0))  # of a plan that was discarded meanwhile
    assert reloaded(journal).log is None


def test_a_plan_that_begins_takes_the_place_of_the_one_before(journal):
    fill(journal, [point(0)])
    journal.begin(NOTE.model_copy(update={"run_id": "r2"}), "/runs/c-000.mcap")
    log = reloaded(journal).log
    assert (log.plan.run_id, log.taken) == ("r2", set())


def test_what_is_forgotten_is_gone(journal):
    fill(journal, [point(0)])
    journal.forget()
    journal.settle()
    assert not journal._disk.path.exists()
    assert reloaded(journal).log is None
    journal.forget()
    journal.settle()
    assert journal.error == ""


points_taken = st.lists(
    st.builds(
        point, st.integers(0, 9), st.sampled_from(["ok", "speed off by 5 %"]), st.integers(1, 3)
    ),
    max_size=6,
)


@given(points=points_taken, data=st.data())
def test_any_truncation_gives_the_points_up_to_it(tmp_path_factory, points, data):
    journal = Journal(tmp_path_factory.mktemp("journal") / "sim.jsonl")
    fill(journal, points)
    journal.settle()
    content = journal._disk.path.read_bytes()
    size = data.draw(st.integers(0, len(content)))
    journal._disk.path.write_bytes(content[:size])
    cut = reloaded(journal)
    whole = content[:size].count(b"\n")
    if whole == 0:
        assert cut.log is None
        return
    assert list(cut.log.segments[0].points) == points[: whole - 1]
    cut.point(point(7))  # what was cut off is not in the way of what comes
    assert list(reloaded(cut).log.segments[0].points) == [*points[: whole - 1], point(7)]


@given(points=points_taken, at=st.integers(0, 2000), garbage=st.binary(max_size=40))
def test_whatever_is_in_the_file_is_read_up_to_what_makes_no_sense(
    tmp_path_factory, points, at, garbage
):
    journal = Journal(tmp_path_factory.mktemp("journal") / "sim.jsonl")
    fill(journal, points)
    journal.settle()
    content = journal._disk.path.read_bytes()
    parsed = read(content[:at] + garbage + content[at + len(garbage) :])
    assert parsed.size <= max(len(content), at + len(garbage))
    if at >= len(content):
        assert list(parsed.log.segments[0].points)[: len(points)] == points


@pytest.mark.parametrize(
    "content",
    [
        b"null\n", b"[]\n", b'{"kind": "end"}\n', b"\xff\n", b"\n", b"[" * 100_000 + b"\n",
        b'{"kind": "plan", "plan": {}, "recording": ""}\n',
    ],
)  # fmt: skip
def test_what_was_never_a_journal_gives_nothing(content):
    assert read(content).log is None


@pytest.mark.parametrize(
    "line",
    [b'{"kind": "dance"}', b'{"kind": "point", "point": {"index": "x"}}', b'{"kind": "end"}',
     b'{"kind": "point", "point": 3}', b"7",
     b'{"kind": "point", "point": {"index": 1e999}}',
     b'{"kind": "point", "point": {"index": 0, "take": "nan"}}',
     b'{"kind": "point", "point": {"index": 0, "take": "2.0"}}',
     b'{"kind": "point", "point": {"index": 0, "quality": 7}}'],
)  # fmt: skip
def test_a_line_that_makes_no_sense_ends_the_story(journal, line):
    fill(journal, [point(0)])
    journal.settle()
    content = journal._disk.path.read_bytes()
    parsed = read(content + line + b"\n" + content.splitlines(keepends=True)[1])
    assert (parsed.size, len(parsed.log.segments[0].points)) == (len(content), 1)


def test_a_journal_of_another_format_is_none():
    line = (
        b'{"kind":"plan","recording":"","plan":'
        + NOTE.model_copy(update={"format": 2}).model_dump_json().encode()
    )
    assert read(line + b"}\n").log is None


def test_a_full_disk_is_reported_and_what_fits_again_is_kept(journal, monkeypatch):
    fill(journal, [point(0)])
    journal.settle()

    meanwhile = []

    def full(path, line, offset):
        meanwhile.append(journal.error)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(journal_file, "_write", full)
        for _ in range(2):
            journal.point(point(1))
            journal.settle()
            assert "No space left" in journal.error
    assert meanwhile == ["", journal.error]  # else it would be reported with each point
    journal.point(point(2))
    assert [p["index"] for p in reloaded(journal).log.segments[0].points] == [0, 2]
    assert journal.error == ""


def test_a_line_that_fits_in_part_is_taken_back(journal, monkeypatch):
    fill(journal, [point(0)])
    journal.settle()
    pwrite = os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda fd, line, at: pwrite(fd, line[:5], at))
    journal.point(point(1))
    journal.settle()
    assert "No space left" in journal.error
    assert len(reloaded(journal).log.segments[0].points) == 1


def test_a_plan_whose_beginning_cannot_be_kept_adds_nothing_to_another_ones(journal, monkeypatch):
    fill(journal, [point(0)])
    journal.settle()
    before = journal._disk.path.read_bytes()

    def refuse(path, line, offset):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with monkeypatch.context() as patched:
        patched.setattr(journal_file, "_write", refuse)
        journal.begin(NOTE, "/runs/new-000.mcap")
        journal.settle()
    journal.point(point(3))
    journal.settle()
    assert "Read-only" in journal.error
    assert journal._disk.path.read_bytes() == before


def test_a_journal_that_cannot_be_read_is_reported(tmp_path):
    journal = Journal(tmp_path)
    journal.load()
    assert journal.log is None
    assert "directory" in journal.error


def test_a_disk_that_stalls_holds_nobody_up(journal, monkeypatch):
    go_on, write = threading.Event(), journal_file._write

    def stalled(path, line, offset):
        assert go_on.wait(60)
        write(path, line, offset)

    monkeypatch.setattr(journal_file, "_write", stalled)
    fill(journal, [point(0), point(1)])
    assert journal.log.taken == {0, 1}
    assert not journal._disk.path.exists()
    go_on.set()
    assert reloaded(journal).log.taken == {0, 1}


@pytest.mark.parametrize("order", [(True, False), (False, True)])
def test_a_recording_that_was_not_written_stays_so_whatever_dies_later(journal, order):
    journal.begin(NOTE, "run-000.mcap")
    for unrecorded in order:
        journal.recorder_died(0, unrecorded=unrecorded)
    [segment] = journal.log.segments
    assert (segment.complete, segment.written) == (False, False)
    journal.settle()
