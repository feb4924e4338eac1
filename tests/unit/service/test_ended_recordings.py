"""Recordings that have ended: each is confirmed by a recorder, or given up with an event."""

import json
from types import SimpleNamespace

import pytest

from motord.api.messages import Event
from motord.recorder.launch import LAST_MAX_BYTES
from motord.service.recording import session
from motord.service.recording.ended import ENDED_MAX
from tests.unit.service.test_closed_recordings import FULL, VIEW, Closing
from tests.unit.service.test_timing_log import Bench

AGAIN_NS = session.FINISH_AGAIN_NS


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path)
    yield made
    made.close()


class PatchedClock:
    """The time of the session, in which each sleep passes at once; `meanwhile` happens in each."""

    def __init__(self, monkeypatch):
        self.now_s = 1000.0
        self.meanwhile = lambda: None
        clock = {"monotonic": lambda: self.now_s, "sleep": self._sleep}
        clock["monotonic_ns"] = lambda: round(self.now_s * 1e9)
        monkeypatch.setattr(session, "time", SimpleNamespace(**clock))

    def _sleep(self, seconds):
        self.now_s += seconds
        self.meanwhile()


@pytest.fixture
def clock(monkeypatch):
    return PatchedClock(monkeypatch)


def ended(bench, count=1, died=True):
    """Let recordings end; return their stems. With `died`, the recorder dies over the first."""
    stems = []
    for _ in range(count):
        bench.now_ns += 1_000_000  # names are by time
        bench.power_on()
        stems.append(str(bench.recording.recorder.task.stem))
        if died and bench.children.running is not None:
            bench.children.running.code = -9
            bench.children.poll(0)
            bench.recording.step(0)
        bench.recording.end("over")
    return stems


def finished(recorder):
    return [command["out"] for command in recorder.received() if command["do"] == "finish"]


def messages(bench):
    return [event.message for event in bench.events.recent()]


def test_more_than_are_kept_are_given_up_with_an_event(bench):
    stems = ended(bench, ENDED_MAX + 2)
    names = [stem.rsplit("/", 1)[1] for stem in stems]
    said = [f"{name} was not closed: its last ticks may be missing" for name in names[:2]]
    assert messages(bench) == said
    assert finished(bench.next_recorder()) == stems[2:]


def test_one_that_is_not_closed_is_kept_though_a_later_one_is(bench):
    first, second = ended(bench, 2)
    recorder = bench.next_recorder()
    recorder.say(recording=False, closed=[second])
    bench.recording.step(0)
    recorder.received()
    assert finished(bench.next_recorder()) == [first]


def test_both_that_are_closed_between_two_reports_are_confirmed(tmp_path):
    closing = Closing(tmp_path, auto="always")
    closing.control._loop_up = True
    closing.ended()
    manual = str(closing.recorder.task.stem)
    closing.control.end("over")
    assert closing.at(1.0, recording=False, closed=[closing.stem, manual]) == ""
    assert len(closing.recorder.ended) == 0


def test_what_was_confirmed_stays_so_when_the_recorder_dies(tmp_path):
    closing = Closing(tmp_path).ended()
    closing.recorder.link.sent = []
    closing.recorder.ended.take(SimpleNamespace(closed=[closing.stem], leftovers={}))
    closing.recorder.report = session.NO_REPORT
    assert closing.at(1.0) == ""


def test_why_it_could_not_be_finished_is_said(tmp_path):
    closing = Closing(tmp_path).ended()
    closing.recorder.report = session.NO_REPORT
    closing.recorder.pid = 2
    assert closing.at(1.0, recording=False, error=FULL) is None
    late_s = closing.limit_s + 1.1
    assert closing.at(late_s) == f"not closed within {closing.limit_s:g} s: {FULL}"


def test_one_that_ended_with_an_error_is_not_finished_again(bench):
    recorder = bench.next_recorder()
    [stem] = ended(bench, died=False)
    part = f"{stem}-000.mcap.part"
    recorder.say(recording=False, file=f"{stem}-000.mcap", error=FULL, leftovers={part: FULL})
    bench.recording.step(0)
    assert finished(bench.next_recorder()) == []
    assert any(FULL in message for message in messages(bench))


def test_one_that_could_not_be_finished_is_tried_again(bench):
    [stem] = ended(bench)
    recorder = bench.next_recorder()
    recorder.say(recording=False, error=FULL)
    bench.recording.step(AGAIN_NS // 2)
    assert finished(recorder) == [stem]
    bench.recording.step(AGAIN_NS)
    assert finished(recorder) == [stem]
    bench.recording.step(AGAIN_NS + 1)
    recorder.say(recording=False, closed=[stem])
    bench.recording.step(AGAIN_NS + 2)
    bench.recording.step(3 * AGAIN_NS)
    assert finished(recorder) == []
    assert not any("not closed" in message for message in messages(bench))


def test_it_is_tried_again_though_the_next_one_cannot_begin_either(bench, monkeypatch):
    monkeypatch.setattr(session, "FINISH_AGAIN_NS", 100)  # while the next one is wanted
    [stem] = ended(bench)
    bench.now_ns += 1_000_000
    bench.power_on()
    recorder = bench.next_recorder()
    recorder.say(recording=False, error=FULL)
    bench.recording.step(99)
    recorder.received()
    bench.recording.step(100)
    task = str(bench.recording.recorder.task.stem)
    commands = [(command["do"], command["out"]) for command in recorder.received()]
    assert commands == [("finish", stem), ("start", task)]
    recorder.say(recording=True, file=f"{task}-000.mcap")
    bench.recording.step(150)
    bench.recording.step(500)
    assert finished(recorder) == []


def test_what_the_recorder_closes_as_it_is_ended_is_closed(bench, monkeypatch):
    monkeypatch.setattr(session, "CLOSE_S", 0.0)
    recorder = bench.next_recorder()
    recorder.say(recording=True)
    bench.recording.step(0)
    [stem] = ended(bench, died=False)
    bench.children.stop = lambda *_: recorder.say(recording=False, closed=[stem])
    bench.recording.close()
    bench.recording.recorder.stop()
    assert messages(bench) == []


def test_commands_that_were_dropped_are_sent_again_for_what_has_ended_too(bench):
    recorder = bench.next_recorder()
    [stem] = ended(bench, died=False)
    bench.power_on()
    task = str(bench.recording.recorder.task.stem)
    recorder.received()
    bench.recording.recorder.link.commands.dropped += 1
    bench.recording.step(0)
    commands = [(command["do"], command.get("out")) for command in recorder.received()]
    assert commands == [("finish", stem), ("start", task)]


def test_the_end_of_a_recording_is_part_of_what_is_asked(bench):
    bench.next_recorder()
    ended(bench)
    [command] = bench.next_recorder().received()
    assert command["newest"] == {"tick": 0, "t_ns": 0, "missed": 0}
    assert command["to_end"] is False
    bench.power_on()
    bench.recording.loop_down()
    bench.recording.end("the loop died")
    *_, command = bench.next_recorder().received()
    assert command["to_end"] is True


def test_an_error_of_before_does_not_end_the_waiting(bench, clock):
    recorder = bench.next_recorder()
    recorder.say(recording=False, error="of before")
    bench.recording.step(0)
    [stem] = ended(bench, died=False)
    clock.meanwhile = lambda: recorder.say(recording=False, closed=[stem], error="of before")
    bench.recording.recorder.await_closed()
    assert len(bench.recording.recorder.ended) == 0


def test_an_error_that_comes_meanwhile_ends_it(bench, clock):
    recorder = bench.next_recorder()
    recorder.say(recording=False)
    bench.recording.step(0)
    ended(bench, died=False)
    clock.meanwhile = lambda: recorder.say(recording=False, error=FULL)
    bench.recording.recorder.await_closed()
    assert clock.now_s < 1000.0 + session.CLOSE_S


def test_what_the_ring_does_not_reach_back_to_is_not_waited_for(bench, clock):
    [stem] = ended(bench)
    bench.now_ns += round(bench.ring_s * 1e9) + 1
    bench.recording.close()
    bench.recording.recorder.stop()
    assert clock.now_s == 1000.0
    assert f"{stem.rsplit('/', 1)[1]} was not closed" in messages(bench)[-1]


def test_recorders_that_die_one_after_the_other_hold_up_the_end_for_a_bounded_time(bench, clock):
    stopped = []
    bench.children.stop = lambda _name, timeout_s: stopped.append((clock.now_s, timeout_s))
    bench.next_recorder()
    ended(bench)

    def another():
        before = bench.children.running
        if before is None or clock.now_s - another.since_s > session.CLOSE_S / 2:
            running = bench.recorders[0].__class__(1000 + len(bench.recorders))
            bench.recorders.append(running)
            bench.children.running, another.since_s = running, clock.now_s
            running.say(recording=False)

    another.since_s = clock.now_s
    clock.meanwhile = another
    bench.recording.close()
    bench.recording.recorder.stop()
    [(at_s, timeout_s)] = stopped
    assert at_s + timeout_s <= 1000.0 + session.STOP_S + session.KILL_S


def test_a_plan_is_recorded_up_to_its_end_and_what_follows_begins_after_it(tmp_path):
    closing = Closing(tmp_path, auto="always")
    closing.control._loop_up = True
    closing.recorder.newest = session.Mark(tick=41, t_ns=1, missed=0)
    closing.control.plan_closing(VIEW)
    assert closing.recorder.task.first_tick == 42


@pytest.mark.parametrize("over", [False, True], ids=["resumed", "finished"])
def test_the_next_recorder_gets_the_last_messages_however_long_ago_they_were_sent(bench, over):
    bench.next_recorder()
    bench.power_on()
    recorder, sent_ns = bench.recording.recorder, bench.now_ns
    recorder.record("operating_point", sent_ns, {"index": 3})
    bench.children.running = None
    bench.recording.step(0)
    recorder.event(Event(t_ns=sent_ns, kind="daemon", message="shutting down"))
    recorder.record("operating_point", sent_ns, {"index": 4})
    bench.now_ns += round(2 * session.EVENTS_BEFORE_S * 1e9)
    if over:
        bench.recording.end("over")
    [command] = bench.next_recorder().received()
    assert command["do"] == ("finish" if over else "start")
    sent = [(m["do"], m["content"].get("index")) for m in command["last"] if m["t_ns"] == sent_ns]
    assert sent == [("operating_point", 3), ("event", None), ("operating_point", 4)]


def test_of_large_messages_the_newest_are_sent_again(bench):
    """A command that the pipe's backlog does not take would begin nothing."""
    bench.next_recorder()
    bench.power_on()
    for number in range(300):
        event = {"kind": "note", "message": "x" * 20_000, "number": number}
        bench.recording.recorder.record("event", number, event)
    bench.children.running = None
    bench.recording.step(0)
    successor, sent = bench.next_recorder(), b""
    while not sent.endswith(b"\n"):
        bench.recording.step(0)
        sent += successor.commands.read() or b""
    numbers = [message["content"]["number"] for message in json.loads(sent)["last"]]
    assert numbers == list(range(300 - LAST_MAX_BYTES // 20_100, 300))


def test_events_of_long_before_a_recording_are_not_part_of_it(bench):
    recorder = bench.next_recorder()
    session_, before_ns = bench.recording.recorder, round(session.EVENTS_BEFORE_S * 1e9)
    for t_ns, message in ((bench.now_ns - before_ns - 1, "old"), (bench.now_ns, "new")):
        session_.event(Event(t_ns=t_ns, kind="note", message=message))
    bench.power_on()
    events = [c["content"] for c in recorder.received() if c["do"] == "event"]
    assert [event["message"] for event in events if event["kind"] == "note"] == ["new"]


def test_what_a_recorder_that_records_has_written_by_now_is_not_sent_to_the_next(bench):
    recorder = bench.next_recorder()
    bench.power_on()
    session_, stem = bench.recording.recorder, bench.recording.recorder.task.stem.name
    session_.record("operating_point", bench.now_ns, {"index": 1})
    bench.now_ns += round(session.LAST_S * 1e9)
    session_.record("operating_point", bench.now_ns, {"index": 2})
    bench.now_ns += 1
    recorder.say(recording=True, file=f"{stem}-000.mcap")
    bench.recording.step(0)
    [command] = bench.next_recorder().received()
    assert [message["content"].get("index") for message in command["last"]] == [2]
