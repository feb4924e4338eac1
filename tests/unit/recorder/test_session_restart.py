"""A session after its recorder died, or another loop began: ticks are recorded once or counted."""

import shutil

import pytest

from motord.recorder.rolling_file import RollingFile
from motord.recorder.session import GIVEN_MAX, Session
from motord.recording import storage
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, part_of
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.shm.ring import RingWriter
from tests.unit.recorder.recorder_bench import CAPACITY, PLENTY, Bench, FreeSpace
from tests.unit.recording.runs import PERIOD_NS, START_NS, point_of, tick_block

pytestmark = pytest.mark.usefixtures("free_space")


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


def test_messages_that_were_dropped_on_their_way_are_written_though_the_recording_goes_on(bench):
    """Each once: the sender does not know which of them came."""
    came, dropped = (
        {"do": "event", "t_ns": START_NS + n, "content": {"kind": "note", "message": m, "data": {}}}
        for n, m in enumerate(("came", "dropped"))
    )
    bench.start(last=[])
    bench.loop(100)
    bench.do(**came)
    for _ in range(2):
        bench.start(resume=True, last=[came, dropped])
    bench.step()
    bench.stop()
    assert len(bench.files()) == 1
    assert [event["message"] for event in bench.events()] == ["came", "dropped"]


def test_a_message_is_not_written_again_after_many_states(bench):
    came = {
        "do": "event", "t_ns": START_NS, "content": {"kind": "note", "message": "came", "data": {}}
    }  # fmt: skip
    bench.start(last=[])
    bench.do(**came)
    for n in range(GIVEN_MAX + 1):
        bench.do(do="state", t_ns=START_NS + n, content={"state": "READY"})
    bench.start(resume=True, last=[came])
    bench.stop()
    assert [event["message"] for event in bench.events()] == ["came"]


def test_a_point_that_was_dropped_on_its_way_comes_after_its_ticks(bench):
    bench.start(last=[])
    bench.loop(100)
    point = {"do": "operating_point", "t_ns": START_NS, "content": point_of(tick_block(100))}
    bench.start(resume=True, last=[point])
    bench.session.settle()
    assert bench.report()["ticks"] == 100
    bench.stop()
    assert [p["index"] for p in open_run(bench.files()[0]).operating_points()] == [0]


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


def test_asking_again_for_what_is_closed_and_what_goes_on_makes_no_new_file(bench):
    """As after commands that were dropped, or while a ring cannot be read."""
    bench.start()
    bench.loop(20)
    bench.stop()
    before = bench.stem
    bench.stem = before.with_name("night")
    bench.start()
    bench.loop(30)
    for _ in range(5):
        bench.step()
        bench.finish(last_tick=19, out=str(before))
        bench.start(resume=True)
    bench.loop(10)
    bench.stop()
    assert [f.name for f in bench.files()] == ["day-000.mcap", "night-000.mcap"]
    assert bench.recorded() == list(range(60))
    assert bench.report()["closed"] == [str(before), str(bench.stem)]


def test_one_that_goes_on_is_finished_in_its_own_file(bench):
    bench.start()
    bench.loop(20)
    bench.finish()
    assert [f.name for f in bench.files()] == ["day-000.mcap"]
    assert bench.recorded() == list(range(20))
    assert (bench.report()["recording"], bench.report()["closed"]) == (False, [str(bench.stem)])


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


def test_resuming_without_a_readable_file_takes_all_that_the_ring_has(bench):
    bench.start()
    bench.loop(10)
    bench.step()
    bench.session = bench.new_session()
    bench.start(resume=True)
    bench.stop()
    assert bench.recorded() == list(range(10))


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


@pytest.mark.parametrize("folder", [".", "removed"])
def test_a_ring_that_can_never_come_is_an_error(bench, folder):
    """The ring of a loop that has not started is not; that in a folder that was removed is."""
    ring = bench.folder / folder / "none-yet"
    bench.session = Session(ring, bench.settings)
    bench.start()
    bench.step()
    report, gone = bench.report(), folder == "removed"
    assert report["recording"] is not gone
    assert report["error"] == (f"{ring}: cannot open it: No such file or directory" if gone else "")


def test_a_ring_that_is_removed_with_its_folder_is_recorded_while_ticks_come(bench):
    """Also where there is nothing new between two looks, as after an operating point."""
    (bench.folder / "run").mkdir()
    bench.ring_path = bench.folder / "run" / "ring"
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.session = bench.new_session()
    bench.start()
    bench.loop(10)
    bench.step()
    shutil.rmtree(bench.ring_path.parent)
    bench.step()
    bench.loop(5)
    bench.step()
    report = bench.report()
    assert (report["recording"], report["error"]) == (True, "")
    bench.ring.close()
    bench.step()
    report = bench.report()
    assert report["recording"] is False
    assert "ring" in report["error"]
    bench.stop()
    assert bench.recorded() == list(range(15))


RESTARTED = "the recorder was started again: tick 100 follows tick 99"


def test_messages_that_were_in_memory_only_are_written_by_the_next_recorder_once(bench):
    def message(what, number, **content):
        return {"do": what, "t_ns": START_NS + number, "content": content}

    last = [
        message("event", 0, kind="note", message="written", data={}),
        message("plan", 1, state="running", step="1"),
        message("event", 2, kind="note", message="in memory", data={}),
        message("operating_point", 3, **point_of(tick_block(100))),
        message("operating_point", 4, **point_of(tick_block(50, 100)) | {"index": 1}),
        message("plan", 5, state="running", step="2"),
    ]
    bench.start()
    bench.loop(100)
    for command in last[:2]:
        bench.do(**command)
    bench.step(1.1)
    for command in last[2:4]:
        bench.do(**command)
    bench.session = bench.new_session()
    bench.loop(60)
    bench.start(resume=True, last=last)
    bench.start(resume=True, last=last)  # asked for once more: it goes on
    bench.do(do="event", t_ns=START_NS + 6, content={"kind": "note", "message": "new"})
    bench.stop()
    runs = [open_run(file) for file in bench.files()]
    found = [event["message"] for event in bench.events()]
    assert found == ["written", RESTARTED, "in memory", "new"]  # after their ticks, in order
    assert [point["index"] for run in runs for point in run.operating_points()] == [0, 1]
    assert [plan["step"] for run in runs for plan in run.plan()] == ["1", "2"]
    assert bench.recorded() == list(range(160))


def test_messages_are_written_though_the_next_recorder_could_not_begin_at_once(bench):
    content = {"kind": "note", "message": "in memory", "data": {}}
    last = [{"do": "event", "t_ns": START_NS, "content": content}]
    bench.start()
    bench.loop(50)
    bench.step(1.1)
    bench.session = bench.new_session()
    FreeSpace.bytes = 0
    bench.start(resume=True, last=last)
    assert not bench.report()["recording"]
    FreeSpace.bytes = PLENTY
    for _ in range(3):
        bench.step(1.1)
    bench.stop()
    assert [event["message"] for event in bench.events()].count("in memory") == 1


def test_no_recording_is_given_up_for_a_message_that_is_none(bench):
    point = point_of(tick_block(10)) | {"state": {"of": "another package"}}
    last = [
        {"do": "event", "t_ns": 1 << 70, "content": {"kind": "note", "message": "when?"}},
        {"do": "event", "t_ns": START_NS, "content": {"kind": "note"}},
        {"do": "operating_point", "t_ns": START_NS, "content": point},
    ]
    bench.start()
    bench.loop(50)
    bench.step(1.1)
    for _ in range(2):
        bench.session = bench.new_session()
        bench.start(resume=True, last=last)
        assert bench.report()["recording"]
        bench.step(1.1)
    bench.stop()
    points = [point for file in bench.files() for point in open_run(file).operating_points()]
    assert [point["state"] for point in points] == [{"of": "another package"}]
