"""What ended without its recorder is finished up to its end: a tick is in one file, or counted."""

from collections.abc import Iterator

import numpy as np
import pytest

from motord.recorder.finishing import RunMessage, messages_missing
from motord.recorder.rolling_file import ASKED_TO_STOP
from motord.recording.file_names import file_name, part_of
from motord.recording.mcap import chunk_source
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import State
from motord.shm.ring import RingWriter
from tests.unit.recorder.lives import CAPACITY as ALL
from tests.unit.recorder.lives import Bench as Lives
from tests.unit.recorder.recorder_bench import CAPACITY, Bench
from tests.unit.recorder.test_killed_anywhere import PLAN, VIEW
from tests.unit.recording.runs import METADATA, START_NS, tick_block


@pytest.fixture
def bench(tmp_path) -> Bench:
    return Bench(tmp_path)


def died_after(bench: Bench, ticks: int) -> None:
    """Let a recorder die that has `ticks` on the disk."""
    bench.start()
    bench.loop(ticks)
    bench.step(1.1)
    bench.session = bench.new_session()


def test_it_ends_with_the_tick_with_which_it_ended(bench):
    died_after(bench, 100)
    bench.loop(200 - 100)
    bench.finish(last_tick=149)
    assert bench.recorded() == list(range(150))
    assert bench.report()["closed"] == [str(bench.stem)]
    assert bench.report()["lost"] == 0


def test_one_that_ended_with_its_loop_has_all_that_the_loop_published(bench):
    died_after(bench, 100)
    bench.loop(50)
    bench.finish(last_tick=119, to_end=True)
    assert bench.recorded() == list(range(150))


def test_a_file_that_has_more_than_that_is_only_closed(bench):
    died_after(bench, 100)
    bench.loop(50)
    bench.finish(last_tick=89)
    assert bench.recorded() == list(range(100))
    assert (bench.report()["closed"], bench.report()["lost"]) == ([str(bench.stem)], 0)


@pytest.mark.parametrize("to_end", [False, True])
def test_the_ring_of_another_loop_has_nothing_of_it(bench, to_end):
    died_after(bench, 100)
    bench.ring.close()
    bench.ring_path.unlink()
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    block = tick_block(200, 0)
    block["t_ns"] += 10**12
    block["missed"] = 0
    for row in block:
        bench.ring.slot()[0] = row
        bench.ring.publish()
    bench.finish(last_tick=149, to_end=to_end)
    assert bench.recorded() == list(range(100))
    assert bench.report()["lost"] == 50
    assert [event["kind"] for event in bench.events()] == ["ring_lost"]
    assert bench.events()[0]["t_ns"] > START_NS


def test_without_a_ring_all_that_is_missing_is_lost(bench):
    died_after(bench, 100)
    bench.published = 130
    bench.ring_path.unlink()
    bench.finish()
    assert (bench.recorded(), bench.report()["lost"]) == (list(range(100)), 30)


def test_what_the_ring_has_no_more_of_it_is_counted(bench):
    died_after(bench, 100)
    bench.loop(CAPACITY)
    bench.finish()
    recorded = bench.recorded()
    assert recorded[-1] == bench.published - 1
    assert bench.report()["lost"] == bench.published - len(recorded) > 0


def test_ticks_that_the_next_recording_has_are_not_recorded_twice(bench):
    died_after(bench, 100)
    bench.loop(100)
    with RunWriter(file_name(bench.stem.with_name("later"), 0), METADATA) as writer:
        writer.ticks(tick_block(80, 120))
    bench.finish()
    assert [int(t) for t in open_run(bench.files()[1]).ticks()["tick"]] == list(range(100, 120))


def test_one_of_which_there_is_no_file_begins_with_its_first_tick(bench):
    bench.loop(100)
    bench.finish(last_tick=79, first_tick=60)
    assert bench.recorded() == list(range(60, 80))


def test_its_last_events_are_written_once(bench):
    """Some of them may have been written before the recorder died."""
    bench.start()
    bench.loop(100)
    known = {"kind": "note", "message": "before", "data": {}}
    bench.do(do="event", t_ns=START_NS, content=known)
    bench.step(1.1)
    bench.session = bench.new_session()
    last = {"kind": "timing", "message": "at the end", "data": {"missed": 3}}
    contents = enumerate((known, last), START_NS)
    events = [{"do": "event", "t_ns": t_ns, "content": content} for t_ns, content in contents]
    bench.finish(last=events)
    bench.finish(last=events)
    written = [(e["t_ns"], e["message"], e["data"]) for e in bench.events() if e["kind"] != "gap"]
    assert written == [(START_NS, "before", {}), (START_NS + 1, "at the end", {"missed": 3})]


def test_only_what_was_written_since_the_first_of_its_last_messages_is_read(tmp_path, monkeypatch):
    read: list[object] = []
    decode = chunk_source.decode
    monkeypatch.setattr(chunk_source, "decode", lambda *a: read.append(a) or decode(*a))
    ticks = tick_block(10_000)  # 40 chunks
    since_ns = int(ticks["t_ns"][-300])
    events = [
        RunMessage("event", {"t_ns": since_ns + n, "kind": "note", "message": str(n), "data": {}})
        for n in range(2)
    ]
    writer = RunWriter(file_name(tmp_path / "day", 0), METADATA)
    writer.ticks(ticks[:-100])
    events[0].write(writer)
    writer.ticks(ticks[-100:])
    writer.abandon()
    assert part_of(writer.path).exists()
    assert messages_missing(tmp_path / "day", events) == events[1:]
    assert len(read) <= 4


def test_last_events_are_not_written_again_however_many_files_have_begun_since(tmp_path):
    bench = Bench(tmp_path, file_max_s=0.05)
    bench.start()
    bench.loop(20)
    known = {"kind": "note", "message": "before", "data": {}}
    bench.do(do="event", t_ns=START_NS, content=known)
    for _ in range(8):
        bench.step()
        bench.loop(50)
    bench.step(1.1)
    assert len(bench.files()) > 3
    bench.session = bench.new_session()
    bench.finish(last=[{"do": "event", "t_ns": START_NS, "content": known}])
    assert [event["message"] for event in bench.events()].count("before") == 1


def test_a_file_closed_for_want_of_space_is_not_the_end_of_its_recording(bench):
    bench.start()
    bench.loop(100)
    bench.step()
    recording = bench.session._recording
    bench.session._disk.do(lambda: recording._end_for_space("1 MB free"))
    bench.session.settle()
    bench.loop(50)
    bench.session = bench.new_session()
    bench.finish()
    assert bench.recorded() == list(range(150))


def test_a_file_closed_by_a_process_that_was_ended_is_not_the_end_of_its_recording(bench):
    """It went on for a while, and so did its events, before the next recorder was up."""
    bench.start()
    bench.loop(100)
    bench.step()
    bench.session.close(ASKED_TO_STOP, bench.now_s, over=False)
    assert "closed" not in bench.report()
    bench.loop(50)
    bench.session = bench.new_session()
    content = {"kind": "note", "message": "meanwhile", "data": {}}
    bench.finish(last=[{"do": "event", "t_ns": START_NS + 200, "content": content}])
    assert bench.recorded() == list(range(150))
    assert [e["message"] for e in bench.events() if e["kind"] == "note"] == ["meanwhile"]
    assert bench.report()["closed"] == [str(bench.stem)]


def test_one_that_was_closed_so_and_lacks_nothing_gets_no_further_file(bench):
    bench.start()
    bench.loop(100)
    content = {"kind": "note", "message": "before", "data": {}}
    event = {"do": "event", "t_ns": START_NS, "content": content}
    bench.do(**event)
    bench.session.close(ASKED_TO_STOP, bench.now_s, over=False)
    bench.session = bench.new_session()
    for _ in range(2):
        bench.finish(last=[event])
        assert [file.name for file in bench.files()] == ["day-000.mcap"]
        assert bench.report()["closed"] == [str(bench.stem)]


def test_one_that_goes_on_again_is_not_reported_as_closed(bench):
    bench.start()
    bench.loop(10)
    bench.stop()
    assert bench.report()["closed"] == [str(bench.stem)]
    bench.start(resume=True)
    assert "closed" not in bench.report()


# --- with the supervisor's side


@pytest.fixture
def lives(tmp_path) -> Iterator[Lives]:
    with pytest.MonkeyPatch.context() as patch:
        bench = Lives(tmp_path, patch, away_steps=6)
        yield bench
        bench.close()


def recorded_once(lives: Lives) -> dict[str, np.ndarray]:
    """Return the recordings, after a look whether a tick is in two of them."""
    recorded = lives.recorded()
    numbers = np.concatenate([block["tick"] for block in recorded.values()])
    assert len(np.unique(numbers)) == len(numbers)
    return recorded


def test_the_plan_that_followed_keeps_its_beginning(lives):
    """The recorder hangs as it closes what was before the plan, and is ended then."""
    lives.step(2)
    lives.enabled(5)
    lives.state = State.ENABLED
    lives.step()
    lives.control.plan_started(PLAN, VIEW, "")
    last = lives._tick
    for _ in range(6):  # it does nothing more
        lives.now_s += 0.1
        lives.control.take_ticks(lives._publish())
        lives.control.step(lives._now_ns())
    lives._kill()
    lives.step(16)
    lives.state = State.OFF
    lives.control.plan_closing(VIEW)
    lives.step(20)
    lives.end()
    by_hand, plan, _ = recorded_once(lives).values()
    assert by_hand["tick"][-1] == last
    assert np.array_equal(
        plan["tick"], lives.ticks["tick"][lives.ticks["tick"] > last][: len(plan)]
    )


def test_what_is_recorded_after_a_plan_begins_where_that_ended(lives):
    lives.step(2)
    lives.control.plan_started(PLAN, VIEW, "")
    lives.enabled(4)
    lives.state = State.ENABLED
    lives._kill()
    lives.step()
    last = lives._tick
    lives.control.plan_closing(VIEW)
    lives.enabled(14)
    lives.step(20)
    lives.end()
    plan, by_hand = recorded_once(lives).values()
    if plan["tick"][0] > by_hand["tick"][0]:
        plan, by_hand = by_hand, plan
    assert plan["tick"][-1] == last
    assert by_hand["tick"][0] > last


def test_a_new_loop_adds_nothing_to_what_ended_with_the_old_one(lives):
    lives.step(2)
    lives.enabled(5)
    lives.state = State.ENABLED
    lives.step()
    lives._kill()
    lives.step()
    last = lives._tick
    lives.control.loop_down()
    lives.control.end("the loop died")
    lives.disk.dead = False  # the loop's part of it is not
    lives._ring_path.unlink()
    lives._ring, lives._tick, lives._missed = RingWriter(lives._ring_path, ALL), -1, 0
    lives.disk.dead, lives.state = True, State.OFF
    lives.step(12)
    lives.end()
    [only] = lives.recorded().values()
    assert only["tick"][-1] <= last
    assert (only["state"] == State.OFF).sum() == (only["tick"] < 20).sum()
