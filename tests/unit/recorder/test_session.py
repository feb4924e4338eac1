"""The recorder without its process: a ring in, files out."""

import errno
import json
import shutil
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import RecordingConfig
from motord.recorder.commands import handle
from motord.recorder.ring_source import Mark, last_mark
from motord.recorder.rolling_file import RollingFile
from motord.recorder.session import Session
from motord.recording import storage
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, next_file, numbers, part_of
from motord.recording.reader import open_run
from motord.recording.storage import free_bytes, obstacle
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE
from motord.shm.ring import RingWriter
from tests.unit.recording.runs import METADATA, PERIOD_NS, START_NS, point_of, same, tick_block

CAPACITY = 256
PLENTY = 10**12


class FreeSpace:
    """Bytes that are free on the disk."""

    bytes = PLENTY


@pytest.fixture(autouse=True)
def _free_space(monkeypatch: pytest.MonkeyPatch) -> None:
    FreeSpace.bytes = PLENTY
    monkeypatch.setattr(storage, "free_bytes", lambda folder: FreeSpace.bytes)


class Bench:
    """A ring that a loop fills, a session that empties it, a clock and a disk."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.folder = folder
        self.stem = folder / "runs" / "day"
        self.ring_path = folder / "ring"
        self.ring = RingWriter(self.ring_path, CAPACITY)
        self.settings = RecordingConfig(sync_s=1.0, free_min_MB=1.0, **settings)
        self.now_s = 1000.0
        self.published = 0
        self.session = self.new_session()

    def new_session(self) -> Session:
        return Session(self.ring_path, self.settings)

    def loop(self, count: int, first: int | None = None) -> None:
        """Publish `count` ticks, as the loop does."""
        first = self.published if first is None else first
        block = tick_block(count, first)
        block["missed"] = 0
        for row in block:
            self.ring.slot()[0] = row
            self.ring.publish()
        self.published = first + count

    def step(self, seconds: float = 0.05) -> None:
        self.now_s += seconds
        self.session.step(self.now_s)
        self.session.settle()

    def do(self, **command: Any) -> None:
        handle(self.session, json.dumps(command).encode(), self.now_s)

    def start(self, **more: Any) -> None:
        self.do(do="start", out=str(self.stem), metadata=METADATA, **more)

    def stop(self) -> None:
        self.do(do="stop", reason="done")

    def finish(self, last: int | None = None, **more: Any) -> None:
        """Finish the recording, which ended with tick `last`, or with the newest one."""
        tick = tick_block(1, self.published - 1 if last is None else last)[0]
        newest = {"tick": int(tick["tick"]), "t_ns": int(tick["t_ns"]), "missed": 0}
        about = {"metadata": METADATA, "reason": "done", "newest": newest, "to_end": False}
        self.do(do="finish", out=str(self.stem), **(about | more))

    def report(self) -> dict[str, Any]:
        return self.session.report()

    def files(self) -> list[Path]:
        return sorted(self.stem.parent.glob("*.mcap*"))

    def recorded(self) -> list[int]:
        return [int(t) for f in self.files() for t in open_run(f).ticks(["tick"])["tick"]]

    def events(self) -> list[dict[str, Any]]:
        return [event for file in self.files() for event in open_run(file).events()]


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def test_ticks_from_the_start_on_are_recorded_once(bench):
    bench.loop(20)
    bench.start()
    for _ in range(10):
        bench.loop(50)
        bench.step()
    bench.loop(30)
    bench.stop()
    bench.loop(30)
    bench.step()
    assert bench.recorded() == list(range(20, 550))
    assert [f.name for f in bench.files()] == ["day-000.mcap"]
    run = open_run(bench.files()[0])
    assert run.metadata == {"format": "1", **METADATA, "recording": "day", "file": 0}
    assert run.end["reason"] == "done"
    report = bench.report()
    assert report == {
        "recording": False, "file": str(bench.files()[0]), "path": str(bench.files()[0]),
        "files": 1, "ticks": 530,
        "bytes": bench.files()[0].stat().st_size, "lost": 0, "error": "",
        "closed": [str(bench.stem)],
    }  # fmt: skip
    block = np.concatenate(list(run.blocks()))
    expected = tick_block(530, 20)
    assert block["tick"].tolist() == expected["tick"].tolist()
    assert bench.session.over


def test_a_point_comes_after_its_ticks_so_that_a_file_cut_off_has_both_or_neither(bench):
    bench.start()
    for last in (40, 90):
        bench.loop(50)
        content = point_of(tick_block(last + 1))
        bench.do(do="operating_point", t_ns=START_NS, content=content)
    bench.stop()
    [file] = bench.files()
    content = file.read_bytes()
    for size in range(0, len(content), 97):
        cut = bench.folder / "cut.mcap"
        cut.write_bytes(content[:size])
        try:
            run = open_run(cut)
            points, ticks = run.operating_points(), run.ticks(["tick"])["tick"]
        except RecordError:
            continue
        for point in points:
            assert set(range(point["tick_end"] + 1)) <= set(ticks.tolist())
    assert [p["tick_end"] for p in open_run(file).operating_points()] == [40, 90]


@given(
    st.lists(
        st.sampled_from(["loop 1", "loop 70", "loop 200", "step", "late step", "restart"]),
        max_size=25,
    )
)
@settings(max_examples=60)
def test_whatever_happens_every_tick_is_in_the_files_once_or_counted(tmp_path_factory, actions):
    bench = Bench(tmp_path_factory.mktemp("bench"), file_max_s=0.3)
    bench.start()
    bench.loop(1)
    bench.step(1.1)  # so that there is a file to go on from
    for action in actions:
        if action.startswith("loop"):
            bench.loop(int(action.split()[1]))
        elif action == "restart":  # as if killed: nothing is closed
            bench.session = bench.new_session()
            bench.start(resume=True)
        else:
            bench.step(1.1 if action == "late step" else 0.05)
    bench.stop()
    recorded = bench.recorded()
    assert recorded == sorted(set(recorded))
    missing = set(range(bench.published)) - set(recorded)
    reported = [e["data"]["lost"] for e in bench.events() if e["kind"] == "ring_lost"]
    assert sum(reported) == len(missing)
    if "restart" not in actions:
        assert bench.report()["lost"] == len(missing)


def test_overwritten_ticks_are_counted_and_reported(bench):
    bench.start()
    bench.loop(10)
    bench.step()
    bench.loop(CAPACITY + 100)
    bench.step()
    bench.stop()
    recorded = bench.recorded()
    missing = sorted(set(range(bench.published)) - set(recorded))
    assert missing == list(range(10, 10 + len(missing)))
    assert len(missing) >= 100
    event = next(e for e in bench.events() if e["kind"] == "ring_lost")
    assert event["data"] == {"lost": len(missing), "tick_after": 10 + len(missing)}
    assert event["message"].startswith(f"{len(missing)} ticks were overwritten")
    assert event["t_ns"] == START_NS + (10 + len(missing)) * PERIOD_NS
    assert bench.report()["lost"] == len(missing)


def test_messages_are_recorded_and_forgotten_without_a_recording(bench):
    bench.do(do="event", t_ns=1, content={"kind": "early", "message": "not recorded"})
    bench.do(do="plan", t_ns=1, content={})
    bench.do(do="operating_point", t_ns=1, content={})
    point = point_of(tick_block(5))
    bench.start()
    bench.loop(5)
    bench.do(do="event", t_ns=2, content={"kind": "state", "message": "READY"})
    bench.do(do="event", t_ns=3, content={"kind": "state", "message": "X", "data": {"a": 1}})
    bench.do(do="plan", t_ns=4, content={"plan": "verify"})
    bench.do(do="operating_point", t_ns=5, content=point)
    bench.stop()
    run = open_run(bench.files()[0])
    assert [(e["t_ns"], e["kind"], e["data"]) for e in run.events()] == [
        (2, "state", {}), (3, "state", {"a": 1}),
    ]  # fmt: skip
    assert run.plan() == [{"t_ns": 4, "plan": "verify"}]
    assert run.operating_points() == [{"t_ns": 5, **point}]


@pytest.mark.parametrize(
    "line",
    [b"", b"{", b"7", b"[]", b'{"do":"dance"}', b'{"do":"start"}', b'{"do":"start","out":5}',
     b'{"do":"event","t_ns":1}', b'{"do":"plan","t_ns":1,"content":[]}',
     b'{"do":"plan","t_ns":10000000000000000000,"content":{}}',
     b'{"do":"operating_point","t_ns":null,"content":{}}', b"\xff\xfe",
     b'{"do":"start","out":"x","metadata":5}'],
)  # fmt: skip
def test_a_command_that_makes_no_sense_is_reported_and_harms_nothing(bench, line):
    bench.start()
    bench.loop(5)
    if b"metadata" not in line:
        handle(bench.session, line, bench.now_s)
        bench.do(do="event", t_ns="x", content={"kind": "k", "message": "m"})
        assert "command not understood" in bench.report()["error"]
        assert bench.report()["recording"]
        bench.stop()
        assert bench.recorded() == list(range(5))


def test_a_new_start_ends_the_recording_and_loses_nothing_between(bench):
    bench.start()
    bench.loop(40)
    bench.step()
    bench.loop(40)
    bench.start()
    bench.loop(40)
    bench.stop()
    assert [f.name for f in bench.files()] == ["day-000.mcap", "day-001.mcap"]
    assert bench.recorded() == list(range(120))
    assert len(open_run(bench.files()[0]).ticks()) == 80
    assert open_run(bench.files()[0]).end["reason"] == "the recording day began"


def test_a_new_file_by_time(tmp_path):
    bench = Bench(tmp_path, file_max_s=0.2)
    bench.start()
    for _ in range(10):
        bench.loop(50)
        bench.step()
    bench.stop()
    assert [f.name for f in bench.files()] == ["day-000.mcap", "day-001.mcap"]
    assert [len(open_run(f).ticks()) for f in bench.files()] == [250, 250]
    assert [open_run(f).metadata["file"] for f in bench.files()] == [0, 1]
    assert bench.recorded() == list(range(500))
    assert open_run(bench.files()[0]).end["reason"].startswith("goes on in the next file")
    assert bench.report()["files"] == 2
    assert bench.report()["bytes"] == sum(f.stat().st_size for f in bench.files())


def test_a_new_file_by_size(tmp_path):
    bench = Bench(tmp_path, file_max_MB=0.02, chunk_s=0.01)
    bench.start()
    for _ in range(10):
        bench.loop(50)
        bench.step()
    bench.stop()
    assert len(bench.files()) > 2
    assert bench.recorded() == list(range(500))
    assert "after 0.02 MB" in open_run(bench.files()[0]).end["reason"]


def test_what_is_synced_survives_the_recorder(bench):
    bench.start()
    bench.loop(100)
    bench.step(0.05)
    assert bench.recorded() == []
    bench.step(1.0)
    assert bench.recorded() == list(range(100))
    assert bench.files() == [part_of(file_name(bench.stem, 0))]


def test_a_recorder_that_was_killed_goes_on_where_its_file_ends(bench):
    bench.start()
    bench.loop(100)
    bench.step(1.1)
    bench.loop(60)
    bench.step()  # in memory only
    bench.session = bench.new_session()
    bench.loop(30)
    bench.start(resume=True)
    bench.step()
    bench.loop(10)
    bench.step()
    bench.stop()
    assert [f.name for f in bench.files()] == ["day-000.mcap.part", "day-001.mcap"]
    assert bench.recorded() == list(range(200))
    event = bench.events()[0]
    assert event["kind"] == "recorder_restarted"
    assert event["data"] == {"tick_before": 99, "tick_after": 100, "lost": 0}
    assert bench.report()["lost"] == 0


def test_what_the_ring_no_longer_holds_after_a_restart_is_reported(bench):
    bench.start()
    bench.loop(100)
    bench.step(1.1)
    bench.session = bench.new_session()
    bench.loop(CAPACITY + 50)
    bench.start(resume=True)
    bench.stop()
    recorded = bench.recorded()
    missing = sorted(set(range(bench.published)) - set(recorded))
    assert len(missing) >= 50
    assert {e["kind"]: e["data"]["lost"] for e in bench.events()} == {
        "recorder_restarted": len(missing), "ring_lost": len(missing),
    }  # fmt: skip
    assert bench.report()["lost"] == len(missing)


def test_skipped_periods_are_not_lost_ticks(bench):
    bench.start()
    bench.loop(10)
    bench.step(1.1)
    bench.session = bench.new_session()
    for _ in range(CAPACITY):  # the ring holds ticks 15 on; 10 to 14 were skipped by the loop
        row = tick_block(1, bench.published + 5)
        row["missed"] = 5
        bench.ring.slot()[0] = row[0]
        bench.ring.publish()
        bench.published += 1
    bench.start(resume=True)
    bench.stop()
    assert bench.report()["lost"] == 1  # the oldest slot of a full ring is never read


def test_resuming_with_nothing_new_waits_for_news(bench):
    bench.start()
    bench.loop(10)
    bench.step(1.1)
    bench.session = bench.new_session()
    bench.start(resume=True)
    bench.step()
    assert bench.report()["ticks"] == 0
    bench.loop(5)
    bench.stop()
    assert bench.recorded() == list(range(15))


def test_the_same_sample_in_two_ticks_is_no_reason_to_drop_one(bench):
    bench.start()
    block = tick_block(4)
    block["t_ns"] = START_NS
    for row in block[:2]:
        bench.ring.slot()[0] = row
        bench.ring.publish()
    bench.step(1.1)
    bench.session = bench.new_session()
    for row in block[2:]:
        bench.ring.slot()[0] = row
        bench.ring.publish()
    bench.start(resume=True)
    bench.stop()
    assert bench.recorded() == [0, 1, 2, 3]


@pytest.mark.parametrize("overwritten", [False, True])
def test_what_comes_after_a_file_that_has_all_is_all_recorded(bench, overwritten):
    """Even ticks that saw the sample of the last one in the file again."""
    block = tick_block(CAPACITY + 10)
    block["missed"], block["t_ns"][:4] = 0, START_NS
    bench.start()
    _publish(bench, block[:2])
    bench.step(1.1)
    bench.session = bench.new_session()
    if overwritten:  # by the oldest that the ring still has
        _publish(bench, block[2 : CAPACITY + 1])
    bench.start(resume=True)
    bench.step()
    last = CAPACITY + 10 if overwritten else 9
    _publish(bench, block[CAPACITY + 1 if overwritten else 2 : last])
    bench.stop()
    assert bench.recorded() == list(range(last))
    assert bench.report()["lost"] == 0


def _publish(bench, block):
    for row in block:
        bench.ring.slot()[0] = row
        bench.ring.publish()


# --- what a recorder that died left of a recording that has ended


def test_a_recording_that_ended_without_its_recorder_is_finished_by_the_next(bench):
    bench.start()
    bench.loop(100)
    bench.step(1.1)
    bench.loop(60)
    bench.session = bench.new_session()
    bench.finish()
    bench.loop(10)
    bench.step()
    assert bench.recorded() == list(range(160))
    assert [f.name for f in bench.files()] == ["day-000.mcap.part", "day-001.mcap"]
    assert open_run(bench.files()[1]).end["reason"] == "done"
    report = bench.report()
    assert (report["recording"], report["closed"]) == (False, [str(bench.stem)])


def test_one_that_was_closed_by_its_recorder_is_left_as_it_is(bench):
    bench.start()
    bench.loop(100)
    bench.stop()
    bench.session = bench.new_session()
    bench.loop(60)
    bench.finish(first_tick=0)
    assert bench.recorded() == list(range(100))
    assert bench.report()["closed"] == [str(bench.stem)]
    assert [f.name for f in bench.files()] == ["day-000.mcap"]


def test_one_whose_recorder_died_between_two_files_is_not_closed(tmp_path, monkeypatch):
    bench = Bench(tmp_path, file_max_s=0.05)
    bench.start()
    bench.loop(60)
    bench.step()
    bench.loop(20)

    def killed(*_):
        raise RecordError("killed")

    monkeypatch.setattr(RollingFile, "_next_writer", killed)
    bench.step()
    monkeypatch.undo()
    monkeypatch.setattr(storage, "free_bytes", lambda folder: PLENTY)
    assert [f.name for f in bench.files()] == ["day-000.mcap"]
    bench.session = bench.new_session()
    bench.finish()
    assert bench.recorded() == list(range(80))
    assert bench.report()["closed"] == [str(bench.stem)]


def test_one_of_which_there_is_no_file_begins_with_its_first_tick(bench):
    bench.loop(100)
    bench.finish(first_tick=60)
    assert bench.recorded() == list(range(60, 100))


def test_one_that_cannot_be_finished_is_reported_and_not_tried_for_ever(bench):
    bench.loop(10)
    FreeSpace.bytes = 0
    bench.finish(first_tick=0)
    assert "nothing is recorded" in bench.report()["error"]
    FreeSpace.bytes = PLENTY
    bench.loop(10)
    bench.step(60.0)
    assert bench.files() == []
    assert "closed" not in bench.report()


def test_a_mark_that_is_newer_than_the_ring_waits(bench):
    with RunWriter(file_name(bench.stem, 0), {}) as writer:
        writer.ticks(tick_block(1, 5000))
    bench.loop(20)
    bench.start(resume=True)
    bench.step()
    assert bench.report()["ticks"] == 0
    bench.stop()


def test_a_mark_of_another_loop_hides_nothing_that_is_newer(bench):
    with RunWriter(file_name(bench.stem, 0), {}) as writer:
        writer.ticks(tick_block(1, 5000)[:1])
    block = tick_block(3)
    block["t_ns"] += 10_000 * PERIOD_NS
    for row in (tick_block(1)[0], *block):
        bench.ring.slot()[0] = row
        bench.ring.publish()
    bench.start(resume=True)
    bench.stop()
    assert bench.recorded() == [5000, 0, 1, 2]
    assert bench.report()["lost"] == 0


def test_the_ring_may_come_later_and_come_anew(tmp_path):
    bench = Bench(tmp_path)
    bench.ring_path.unlink()
    bench.start()
    bench.step()
    assert bench.report()["error"] == ""
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(30)
    bench.step()
    bench.loop(20)
    bench.ring.close()
    old = bench.ring
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(10, first=0)
    for _ in range(3):
        bench.step()
    assert old.head == 50
    assert not bench.session.over
    bench.ring.close()
    assert bench.session.over
    bench.stop()
    assert bench.recorded() == [*range(50), *range(10)]
    assert [(e["kind"], e["data"]) for e in bench.events()] == [
        ("loop_restarted", {"tick_after": 0})
    ]


def test_a_ring_that_cannot_be_read_is_reported(bench):
    bench.ring_path.write_bytes(b"something else")
    bench.start()
    bench.step()
    assert "not a ring file" in bench.report()["error"]
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(3)
    bench.stop()
    assert bench.report()["error"] == ""
    assert bench.recorded() == [0, 1, 2]


def test_a_lost_ring_is_no_new_ring(bench):
    bench.start()
    bench.loop(5)
    bench.ring_path.unlink()
    bench.step()
    bench.loop(5)
    bench.step()
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(10))


def test_the_first_tick_of_one_loop_is_none_of_the_next(bench):
    """Or its ticks, which begin at 0, would be left out until they came to that number."""
    bench.loop(50)
    bench.start(first_tick=1000)
    bench.step()
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(5, first=0)
    bench.step()
    bench.step()
    bench.stop()
    assert bench.recorded() == [0, 1, 2, 3, 4]


# --- space and errors


def test_too_little_space_ends_the_recording_cleanly(bench):
    bench.start()
    bench.loop(100)
    bench.step(1.1)
    FreeSpace.bytes = 999_999
    bench.loop(50)
    bench.step(0.05)
    assert bench.report()["recording"]
    bench.step(1.0)
    report = bench.report()
    assert not report["recording"]
    assert "less than recording.free_min_MB = 1 is free; the recording was ended" in report["error"]
    run = open_run(bench.files()[0])
    assert bench.files()[0].suffix == ".mcap"
    assert run.damage is None
    assert run.events()[-1]["kind"] == "recording_ended"
    assert bench.recorded() == list(range(150))
    bench.loop(50)
    bench.step()
    bench.do(do="event", t_ns=1, content={"kind": "late", "message": "late"})
    assert bench.recorded() == list(range(150))
    bench.start()
    assert "nothing is recorded" in bench.report()["error"]
    FreeSpace.bytes = PLENTY
    bench.start()
    assert bench.report()["error"] == ""
    bench.stop()


def test_a_disk_that_fails_ends_the_recording(bench, monkeypatch):
    bench.start()
    bench.loop(100)
    bench.step(1.1)

    def fail(descriptor: int, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.write", fail)
    bench.loop(50)
    bench.step(1.1)
    report = bench.report()
    assert not report["recording"]
    assert "No space left on device" in report["error"]
    monkeypatch.undo()
    bench.stop()
    assert bench.recorded() == list(range(100))
    assert bench.files()[0].suffix == ".part"


def test_unknown_free_space_is_no_reason_to_stop(tmp_path, monkeypatch):
    def fail(folder: Path) -> int:
        raise OSError

    monkeypatch.setattr(storage, "free_bytes", fail)
    recording = RollingFile(tmp_path / "day", {}, RecordingConfig(), 0.0)
    recording.step(5.0)
    assert recording.open
    recording.close("done")
    recording.close("done again")
    assert not recording.open


def test_free_space_of_a_folder(tmp_path):
    assert free_bytes(tmp_path) > 0


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot make it"):
        RollingFile(tmp_path / "file" / "day" / "x", {}, RecordingConfig(), 0.0)


def test_a_next_file_that_cannot_be_made_leaves_the_last_one_whole(tmp_path, monkeypatch):
    bench = Bench(tmp_path, file_max_s=0.05)
    bench.start()
    bench.loop(100)
    bench.step()
    monkeypatch.setattr("motord.recorder.rolling_file.next_file", lambda stem: file_name(stem, 0))
    bench.loop(100)
    bench.step()
    assert "day-000.mcap: exists already" in bench.report()["error"]
    assert not bench.report()["recording"]
    assert bench.recorded() == list(range(100))
    assert open_run(bench.files()[0]).damage is None


def test_resuming_without_a_readable_file_takes_all_that_the_ring_has(bench):
    bench.start()
    bench.loop(10)
    bench.step()
    bench.session = bench.new_session()
    bench.start(resume=True)
    bench.stop()
    assert bench.recorded() == list(range(10))


# --- a disk that stalls


class StallingDisk:
    """Stands for os.fsync of a disk that does not answer until it is released."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reached, self.answer = threading.Event(), threading.Event()
        monkeypatch.setattr("os.fsync", self.fsync)

    def fsync(self, descriptor: int) -> None:
        self.reached.set()
        assert self.answer.wait(60)


def stall(bench: Bench, disk: StallingDisk) -> None:
    """Get the session's thread into the disk."""
    bench.loop(10)
    bench.now_s += 1.1
    bench.session.step(bench.now_s)
    assert disk.reached.wait(60)


def loop_and_step(bench: Bench, times: int) -> None:
    for _ in range(times):
        bench.loop(CAPACITY // 2)
        bench.now_s += 0.05
        bench.session.step(bench.now_s)


def test_the_ring_is_read_while_the_disk_stalls(bench, monkeypatch):
    bench.start()
    disk = StallingDisk(monkeypatch)
    stall(bench, disk)
    loop_and_step(bench, 10)
    bench.do(do="event", t_ns=7, content={"kind": "state", "message": "meanwhile"})
    loop_and_step(bench, 10)
    assert bench.report()["ticks"] == 10
    assert bench.report()["error"] == ""
    disk.answer.set()
    bench.stop()
    assert bench.recorded() == list(range(10 + 20 * (CAPACITY // 2)))
    assert bench.report()["lost"] == 0
    assert [e["message"] for e in bench.events()] == ["meanwhile"]


def test_what_is_held_for_a_stalled_disk_is_bounded_and_the_rest_counted(tmp_path, monkeypatch):
    most = 3 * (CAPACITY // 2)
    monkeypatch.setattr("motord.recorder.session.BACKLOG_BYTES", most * TICK_DTYPE.itemsize)
    bench = Bench(tmp_path)
    bench.start()
    disk = StallingDisk(monkeypatch)
    stall(bench, disk)
    loop_and_step(bench, 20)
    disk.answer.set()
    bench.stop()
    recorded = bench.recorded()
    assert recorded[: 10 + most - CAPACITY // 2] == list(range(10 + most - CAPACITY // 2))
    missing = sorted(set(range(bench.published)) - set(recorded))
    assert recorded == sorted(set(recorded))
    assert bench.report()["lost"] == len(missing) > 10 * CAPACITY // 2
    assert [e["data"]["lost"] for e in bench.events()] == [len(missing)]


def test_a_disk_that_fails_after_a_stall_ends_the_recording(bench, monkeypatch):
    bench.start()
    disk = StallingDisk(monkeypatch)
    stall(bench, disk)

    def fail(descriptor: int, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.write", fail)
    loop_and_step(bench, 4)
    disk.answer.set()
    bench.session.settle()
    bench.step(1.1)
    assert "No space left on device" in bench.report()["error"]
    assert not bench.report()["recording"]
    bench.step()
    assert bench.session.over
    monkeypatch.undo()
    assert bench.recorded() == list(range(10))


def test_a_mistake_in_the_background_is_not_kept_quiet(bench, monkeypatch):
    def stumble(self: RollingFile, block: np.ndarray, lost: int) -> None:
        raise ValueError("a mistake")

    bench.start()
    bench.loop(5)
    monkeypatch.setattr(RollingFile, "ticks", stumble)
    with pytest.raises(RuntimeError, match="in the background failed"):
        bench.step()


# --- names and marks


def test_one_killed_as_a_recording_begins_does_not_record_twice_what_the_one_before_has(bench):
    bench.start()
    bench.loop(50)
    bench.stem = bench.stem.with_name("night")
    bench.start()
    bench.loop(20)
    bench.session = bench.new_session()  # none of them in a file
    bench.start(resume=True)
    bench.loop(5)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(75))
    night = [f for f in bench.files() if f.name.startswith("night")]
    assert sum(len(open_run(f).ticks()) for f in night) == 25


def test_recordings_of_other_benches_next_to_it_do_not_matter(bench):
    bench.stem.parent.mkdir()
    with RunWriter(file_name(bench.stem.with_name("other"), 0), {}) as writer:
        writer.ticks(tick_block(10, 1000))
    (bench.stem.parent / "no-recording.mcap").write_bytes(b"")
    (bench.stem.parent / "broken-000.mcap").write_bytes(b"broken")
    bench.loop(20)
    bench.start(resume=True)
    bench.step()
    bench.stop()
    [day] = [f for f in bench.files() if f.name.startswith("day")]
    assert open_run(day).ticks(["tick"])["tick"].tolist() == list(range(20))


def test_names_of_files(tmp_path):
    stem = tmp_path / "day"
    assert numbers(tmp_path / "absent" / "day") == []
    assert next_file(stem) == tmp_path / "day-000.mcap"
    for name in ("day-000.mcap", "day-004.mcap.part", "day-x.mcap", "day-7.txt", "days-9.mcap"):
        (tmp_path / name).write_text("")
    assert numbers(stem) == [0, 4]
    assert next_file(stem) == tmp_path / "day-005.mcap"
    assert file_name(stem, 1234).name == "day-1234.mcap"


def test_the_last_tick_of_a_recording(tmp_path):
    stem = tmp_path / "day"
    assert last_mark(stem) is None
    block = tick_block(600)
    with RunWriter(file_name(stem, 0), {}, chunk_s=0.1) as writer:
        writer.ticks(block)
    RunWriter(file_name(stem, 1), {}).abandon()
    (tmp_path / "day-002.mcap.part").write_bytes(b"")
    expected = Mark(599, int(block["t_ns"][-1]), int(block["missed"][-1]))
    assert last_mark(stem) == expected
    content = bytearray(file_name(stem, 0).read_bytes())
    content[open_run(file_name(stem, 0)).source.structure.chunks[-1].offset + 200] ^= 1
    file_name(stem, 0).write_bytes(content)
    assert last_mark(stem).tick == 499
    assert same(open_run(file_name(stem, 0)).tick_table.last(), block[499:500])


# --- a disk that takes no more, and takes again


def test_a_folder_that_is_deleted_is_reported_and_recording_goes_on_when_it_is_back(bench):
    bench.start()
    bench.loop(40)
    bench.step()
    bench.step(1.0)  # a sync
    shutil.rmtree(bench.stem.parent)
    bench.stem.parent.write_text("in the way of a folder")
    bench.loop(10)
    bench.step(1.1)
    bench.step()
    report = bench.report()
    assert not report["recording"]
    assert "it was removed or moved while it was being written" in report["error"]
    for _ in range(10):
        bench.loop(10)
        bench.step(1.0)
    assert not bench.report()["recording"]
    assert bench.report()["error"] != ""
    bench.stem.parent.unlink()
    bench.step(30.0)
    bench.step(30.0)
    bench.loop(10)
    bench.step()
    report = bench.report()
    assert report["recording"]
    assert report["error"] == ""
    assert Path(report["path"]).exists()
    bench.stop()
    recorded = bench.recorded()
    assert recorded == list(range(160))  # the ring had them all
    [event] = [e for e in bench.events() if e["kind"] == "recording_resumed"]
    assert event["data"]["lost"] == 0
    assert "removed or moved" in event["data"]["reason"]


def test_what_a_vanished_file_had_and_the_ring_has_no_more_is_counted(bench):
    bench.start()
    bench.loop(40)
    bench.step(1.1)
    shutil.rmtree(bench.stem.parent)
    bench.step(1.1)
    bench.loop(CAPACITY)
    bench.step(30.0)
    bench.loop(10)
    bench.step(0.05)
    bench.stop()
    recorded = bench.recorded()
    assert recorded == list(range(recorded[0], 40 + CAPACITY + 10))
    assert bench.report()["lost"] == recorded[0]
    assert recorded[0] > 40


def test_a_disk_that_was_full_takes_the_rest_in_a_new_file(bench):
    bench.start()
    for _ in range(4):
        bench.loop(30)
        bench.step(1.1)
    FreeSpace.bytes = 0
    bench.loop(10)
    bench.step(1.1)
    bench.step(1.1)
    assert "free_min_MB" in bench.report()["error"]
    bench.loop(50)
    bench.step(1.1)
    FreeSpace.bytes = PLENTY
    bench.step(30.0)
    bench.loop(5)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(185))
    assert [f.name for f in bench.files()] == ["day-000.mcap", "day-001.mcap"]


def test_a_start_that_fails_is_tried_again_and_loses_nothing(bench):
    bench.loop(20)
    bench.stem.parent.write_text("in the way of a folder")
    bench.start()
    assert bench.report()["error"] != ""
    bench.loop(30)
    bench.step()
    bench.stem.parent.unlink()
    bench.step(1.1)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(20, 50))
    assert bench.report()["error"] == ""


def test_a_file_that_cannot_get_its_name_at_the_end_is_reported(bench):
    bench.start()
    bench.loop(40)
    bench.step()
    shutil.rmtree(bench.stem.parent)
    bench.stop()
    [outcome] = bench.report()["leftovers"].values()
    assert "not ended in order, with 40 ticks" in outcome


def test_a_descriptor_that_is_missing_is_an_error_and_not_the_end(bench, monkeypatch):
    def no_more(*arguments):
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patch:
        patch.setattr("motord.recorder.session.last_mark", no_more)
        bench.start(resume=True)
    assert "Too many open files" in bench.report()["error"]


def test_whether_it_could_record_is_looked_at_while_it_does_not(bench):
    bench.settings = bench.session._settings.model_copy(update={"directory": bench.stem.parent})
    bench.session = bench.new_session()
    bench.step()
    assert "obstacle" not in bench.report()
    assert bench.files() == []
    FreeSpace.bytes = 0
    bench.step(2.1)
    assert "free_min_MB" in bench.report()["obstacle"]
    FreeSpace.bytes = PLENTY
    shutil.rmtree(bench.stem.parent)
    bench.stem.parent.write_text("in the way of a folder")
    bench.step(2.1)
    assert f"{bench.stem.parent}: cannot write there" in bench.report()["obstacle"]
    bench.stem.parent.unlink()
    bench.step(2.1)
    assert "obstacle" not in bench.report()


# --- from a tick on


def test_a_recording_begins_with_the_tick_that_is_asked_for(bench):
    bench.loop(100)
    bench.step()
    bench.start(first_tick=60)
    bench.loop(10)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(60, 110))
    assert bench.report()["lost"] == 0
    assert not any(e["kind"] == "recorder_restarted" for e in bench.events())


def test_ticks_that_the_recording_before_has_are_not_recorded_twice(bench):
    bench.start()
    bench.loop(50)
    bench.step()
    bench.stop()
    bench.loop(10)
    for _ in range(2):  # by the same recorder, and by one that was started since
        bench.stem = bench.stem.with_name(f"{bench.stem.name}x")
        bench.start(first_tick=20)
        bench.loop(10)
        bench.step()
        bench.stop()
        bench.session = bench.new_session()
    assert sorted(bench.recorded()) == list(range(80))


def test_a_counter_that_began_anew_hides_no_tick(bench):
    bench.start()
    bench.loop(200)
    bench.step()
    bench.stop()
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(50, first=0)
    bench.stem = bench.stem.with_name("next")
    bench.start(first_tick=0)
    bench.step()
    bench.stop()
    assert bench.report()["ticks"] == 50


def test_ticks_before_the_first_that_the_ring_has_are_counted_as_lost(bench):
    bench.loop(CAPACITY + 100)
    bench.start(first_tick=50)
    bench.step()
    bench.stop()
    recorded = bench.recorded()
    assert recorded[-1] == CAPACITY + 99
    assert bench.report()["lost"] == recorded[0] - 50 > 0


def test_a_folder_that_is_there_but_takes_no_file_is_an_obstacle(tmp_path, monkeypatch):
    settings = RecordingConfig(directory=tmp_path, free_min_MB=0.0)
    assert obstacle(settings) == ""

    def immutable(path, content):
        raise PermissionError(errno.EPERM, "Operation not permitted", str(path))

    monkeypatch.setattr(Path, "write_bytes", immutable)
    assert obstacle(settings) == f"{tmp_path}: cannot write there: Operation not permitted"
