"""Black boxes without processes: a ring in, files out."""

import errno
import json
import os
import threading
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from motord import config
from motord.cli.record.commands import app
from motord.config import RecordingConfig
from motord.recorder import blackbox
from motord.recorder.blackbox import AT_ONCE, LATE_S
from motord.recorder.commands import handle
from motord.recorder.protocol import AFTER_S, OUTCOMES_MAX, BlackBoxRequest, path_of
from motord.recorder.session import Session
from motord.recording.file_names import part_of
from motord.recording.info import describe
from motord.recording.json_encoding import to_line
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.reader import open_run
from motord.schema import State, Trip
from motord.shm.ring import RingWriter
from tests.unit.recording.runs import METADATA, PERIOD_NS, START_NS, tick_block

CAPACITY = 512
ACCOUNT = {"cause": "OVER_SPEED", "reason": "too fast", "action": "brake", "t_ns": START_NS}


class Bench:
    """A ring that a loop fills and a session; every step takes 50 ms."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.folder = folder / "boxes"
        self.ring_path = folder / "ring"
        self.ring = RingWriter(self.ring_path, CAPACITY)
        self.session = Session(self.ring_path, RecordingConfig(free_min_MB=1.0, **settings))
        self.now_s, self.published = 10.0, 0

    def loop(self, count: int, state=State.ENABLED, trip=0, **more) -> None:
        block = tick_block(count, self.published)
        block["state"], block["trip_bits"], block["first_trip"] = state, trip, trip & -trip
        for name, value in more.items():
            block[name] = value
        for row in block:
            self.ring.slot()[0] = row
            self.ring.publish()
        self.published += count

    def path(self, number: int = 0) -> Path:
        return self.folder / f"blackbox-sim-20250101T{number:09d}Z.mcap"

    def ask(self, tick: int | None, before: int = 100, after: int = 30, number: int = 0) -> Path:
        path = self.path(number)
        wanted = BlackBoxRequest(path, tick, before, after, METADATA, ACCOUNT)
        line = to_line({"do": "blackbox", **vars(wanted)})
        handle(self.session, line, self.now_s)
        return path

    def send_event(self, message: str) -> None:
        content = {"kind": "state", "message": message, "data": {}}
        command = {"do": "blackbox_event", "t_ns": START_NS, "content": content}
        handle(self.session, json.dumps(command).encode(), self.now_s)

    def step(self, seconds: float = 0.05) -> None:
        self.now_s += seconds
        self.session.step(self.now_s)

    def outcome(self, path: Path) -> str:
        self.session.boxes.finish()
        return self.session.report()["blackboxes"][str(path)]


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def ticks_of(path: Path) -> list[int]:
    return open_run(path).ticks(["tick"])["tick"].tolist()


def test_a_box_has_the_ticks_before_and_after_the_trip_and_no_others(bench):
    bench.loop(300)
    bench.loop(10, State.TRIPPED, Trip.OVER_SPEED)
    path = bench.ask(300)
    bench.step()
    assert not path.exists()
    assert not bench.session.over
    bench.send_event("sent while it is open")
    bench.loop(40, State.TRIPPED, Trip.OVER_SPEED | Trip.BUS_OFF)
    bench.step()
    assert bench.outcome(path) == ""
    run = open_run(path)
    assert run.check() is None
    assert run.ticks(["tick"])["tick"].tolist() == list(range(200, 331))
    assert run.metadata["bench"] == "sim"
    assert run.metadata["reason"] == "too fast"
    account = run.metadata["blackbox"]
    assert (account["first"], account["causes"]) == (["OVER_SPEED"], ["OVER_SPEED", "BUS_OFF"])
    event, own = run.events()
    assert event["message"] == "sent while it is open"
    assert (own["kind"], own["data"]) == ("blackbox", account)
    assert not part_of(path).exists()
    assert bench.session.over


def test_a_box_reaches_back_as_far_as_the_ring(bench):
    bench.loop(2 * CAPACITY)
    path = bench.ask(2 * CAPACITY - 1, before=100_000, after=0)
    bench.step()
    assert bench.outcome(path) == ""
    assert ticks_of(path) == list(range(CAPACITY + 1, 2 * CAPACITY))


def test_a_recording_under_way_has_every_tick_all_the_same(bench, tmp_path):
    bench.loop(10)
    start = {"do": "start", "out": str(tmp_path / "day"), "metadata": METADATA}
    handle(bench.session, json.dumps(start).encode(), bench.now_s)
    for _ in range(5):
        bench.loop(50)
        bench.step()
    path = bench.ask(200)
    for _ in range(5):
        bench.loop(50)
        bench.step()
    bench.session.close("done", bench.now_s)
    assert bench.outcome(path) == ""
    assert ticks_of(path) == list(range(100, 231))
    assert ticks_of(tmp_path / "day-000.mcap") == list(range(10, 510))
    assert [e["kind"] for e in open_run(tmp_path / "day-000.mcap").events()] == []


def test_a_dead_loop_leaves_what_it_had_published(bench):
    bench.loop(150)
    bench.ring_path.unlink()  # as when the next loop makes its own
    assert "cannot open" in bench.outcome(bench.ask(None, after=0, number=1))
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    assert "not published" in bench.outcome(bench.ask(None, after=0, number=2))
    bench.published = 0
    bench.loop(150)
    path = bench.ask(None, after=0)
    bench.step()
    assert bench.outcome(path) == ""
    assert ticks_of(path) == list(range(49, 150))
    assert "causes" not in open_run(path).metadata["blackbox"]


def test_ticks_that_do_not_come_are_not_waited_for_forever(bench):
    bench.loop(150)
    path = bench.ask(149)
    bench.step(AFTER_S + LATE_S - 0.1)
    assert bench.session.boxes.filling
    bench.step(0.2)
    assert not bench.session.boxes.filling
    assert bench.outcome(path) == ""
    assert ticks_of(path) == list(range(49, 150))


def test_a_loop_that_has_ended_is_not_waited_for(bench):
    bench.loop(150)
    bench.ring.close()
    path = bench.ask(149)
    bench.step()
    assert bench.outcome(path) == ""


def test_only_the_newest_boxes_of_a_bench_are_kept(tmp_path):
    bench = Bench(tmp_path, blackbox_keep=3)
    bench.loop(150)
    bench.folder.mkdir()
    others = ["blackbox-sim-2-20200101T000000000Z.mcap", "notes.txt", "blackbox-sim-x.mcap"]
    for name in others:
        (bench.folder / name).write_text("")
    part_of(bench.path(0)).write_text("what a killed recorder left")
    for number in range(1, 6):
        assert bench.outcome(bench.ask(149, after=0, number=number)) == ""
    names = {path.name for path in bench.folder.iterdir()}
    assert names == {*others, *(bench.path(number).name for number in (3, 4, 5))}


def test_boxes_are_kept_after_the_clock_was_set_back(tmp_path):
    bench = Bench(tmp_path, blackbox_keep=3)
    bench.loop(150)
    for number in (7, 8, 9, 1, 2):
        assert bench.outcome(bench.ask(149, after=0, number=number)) == ""
    names = {path.name for path in bench.folder.iterdir()}
    assert names == {bench.path(number).name for number in (9, 1, 2)}


def test_asked_again_it_is_written_once_and_over_what_a_killed_recorder_left(bench):
    bench.loop(150)
    bench.folder.mkdir()
    part_of(bench.path()).write_text("half")
    path = bench.ask(149, after=0)
    assert bench.outcome(path) == ""
    before = path.stat().st_mtime_ns
    assert bench.outcome(bench.ask(149, after=0)) == ""
    assert path.stat().st_mtime_ns == before


@pytest.mark.parametrize("after_bytes", [0, 100, 5000, 20_000])
def test_a_full_disk_costs_the_box_alone(bench, monkeypatch, after_bytes):
    def full(self, part):
        if self.size + len(part) > after_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write_all(self, part)

    write_all = McapFile._write_all
    monkeypatch.setattr(McapFile, "_write_all", full)
    bench.loop(150)
    path = bench.ask(149, after=0)
    assert "No space left" in bench.outcome(path)
    assert list(bench.folder.iterdir()) == []
    monkeypatch.undo()
    assert bench.outcome(bench.ask(149, after=0, number=1)) == ""


def test_a_disk_that_its_errors_make_read_only_costs_the_box_alone(bench, monkeypatch):
    def refuse(*unused, **too):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    def fail(self, part):
        if self.size < 5000:
            return write_all(self, part)
        monkeypatch.setattr(Path, "unlink", refuse)
        return refuse()

    write_all = McapFile._write_all
    monkeypatch.setattr(McapFile, "_write_all", fail)
    bench.loop(150)
    assert "Read-only" in bench.outcome(bench.ask(149, after=0))


def test_a_folder_that_cannot_be_made_costs_the_box_alone(bench):
    bench.loop(150)
    bench.folder.write_text("a file")
    assert "File exists" in bench.outcome(bench.ask(149, after=0))


@pytest.mark.parametrize("refused", ["exists", "mkdir"])
def test_a_folder_that_may_not_be_read_costs_the_box_alone(bench, monkeypatch, refused):
    def refuse(*unused, **too):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    bench.loop(150)
    monkeypatch.setattr(Path, refused, refuse)
    assert "Permission denied" in bench.outcome(bench.ask(149, after=0))


def test_while_the_disk_stalls_memory_is_bounded_and_what_is_left_out_is_reported(
    bench, monkeypatch
):
    stalled = threading.Event()
    monkeypatch.setattr(blackbox, "make_room", lambda path, keep: stalled.wait(60))
    bench.folder.mkdir()
    bench.loop(150)
    paths = [bench.ask(149, after=0, number=number) for number in range(AT_ONCE + 1)]
    bench.step()
    assert "still being written" in bench.session.report()["blackboxes"][str(paths[-1])]
    stalled.set()
    assert [bench.outcome(path) for path in paths[:-1]] == [""] * AT_ONCE
    for number in range(OUTCOMES_MAX):
        bench.outcome(bench.ask(149, after=0, number=10 + number))
    assert len(bench.session.report()["blackboxes"]) == OUTCOMES_MAX


def test_malformed_commands_show_in_the_report(bench):
    bench.loop(10)
    handle(bench.session, b'{"do": "blackbox", "path": "x"}', 0.0)
    assert "not understood" in bench.session.report()["error"]
    handle(bench.session, b'{"do": "blackbox_event", "t_ns": 1, "content": {}}', 0.0)
    assert "not understood" in bench.session.report()["error"]


@pytest.mark.parametrize(
    ("state", "first", "written"),
    [
        (State.ENABLED, 0, True),
        (State.READY, 0, False),
        (State.OFF, 0, False),
        (State.TRIPPED, Trip.SUPERVISOR_STALE, True),
        (State.TRIPPED, Trip.BUS_OFF, False),
    ],
)
def test_when_the_daemon_dies_a_box_is_kept_if_the_bench_was_enabled(bench, state, first, written):
    bench.loop(150, state, first)
    wanted = BlackBoxRequest(bench.path(), None, 100, 0, METADATA, ACCOUNT)
    bench.session.boxes.request(wanted, bench.now_s, if_powered=True)
    bench.session.boxes.finish()
    assert bench.path().exists() == written


def test_record_info_shows_what_happened_and_what_to_do(bench):
    bench.loop(100)
    bench.loop(50, State.TRIPPED, Trip.OVER_SPEED)
    path = bench.ask(100, after=0)
    assert bench.outcome(path) == ""
    assert describe(open_run(path))["blackbox"]["action"] == "brake"
    said = CliRunner().invoke(app, ["info", str(path)]).stdout
    for line in ("black box of:     too fast", "suggested:        brake", "OVER_SPEED"):
        assert line in said


def test_the_name_has_bench_and_time():
    bench = config.load()
    path = path_of(bench, START_NS + 7 * PERIOD_NS)
    assert path.name == "blackbox-sim-20231114T221320007Z.mcap"
    assert path.parent == bench.recording.blackbox_directory.absolute()
    assert path.is_absolute()


def test_ticks_are_not_changed_on_their_way(bench):
    bench.loop(150)
    path = bench.ask(149, before=100, after=0)
    assert bench.outcome(path) == ""
    expected = tick_block(150)[49:]
    got = open_run(path).ticks(["t_ns", "angle_rad", "encoder_gray"])
    for name in ("t_ns", "angle_rad", "encoder_gray"):
        assert got[name].tobytes() == expected[name].tobytes()
