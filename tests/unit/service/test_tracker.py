"""Tracking of the calibration in force: its process, and the supervisor's end."""

import json
import os
import signal
import threading
import time
from concurrent.futures import Future
from functools import partial

import pytest
from pydantic import ValidationError

from motord.calibration import CalibrationError, load
from motord.config import load as load_bench
from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity
from motord.recorder.pipe_lines import LineReader, LineWriter
from motord.service.bench.calibrations import CalibrationStore
from motord.service.host import scheduling
from motord.service.host.events import EventLog
from motord.service.tracker import process
from motord.service.tracker.link import (
    ENDED,
    NO_TURNS,
    NOT_IN_FORCE,
    NOT_WRITTEN,
    NOTHING_YET,
    REPORTLESS_MAX_NS,
    SHUTTING_DOWN,
    TRACKER,
    Departures,
    TrackerLink,
)
from motord.service.tracker.protocol import TrackerReport
from motord.shm.ring import RingWriter
from tests.support.calibrations import calibration, put_in_force
from tests.support.counting_tracker import CountingTracker
from tests.support.patience import PATIENCE_S
from tests.support.played_process import PlayedProcess
from tests.unit.service import linked_process
from tests.unit.service.linked_process import LinkedProcess

COUNTING = "tests.support.counting_tracker:CountingTracker"


@pytest.fixture
def store(tmp_path):
    return CalibrationStore(load_bench(), tmp_path / "state")


def publish(ring, count, missed=0):
    for _ in range(count):
        slot = ring.slot()[0]
        slot["tick"], slot["t_ns"], slot["missed"] = ring.head, ring.head, missed
        ring.publish()


# --- the process' work, in this one


class Worked:
    """Tracking on the ring of a test, at a time that only steps."""

    def __init__(self, run_dir, file):
        reader, writer = os.pipe()
        os.set_blocking(reader, False)
        self.ends = reader, writer
        self._reader, self.file, self.now_ns = LineReader(reader), file, 0
        settings = load_bench().model_copy(deep=True)
        reports = LineWriter(writer, 1 << 20)
        self.tracking = process.Tracking(settings, run_dir, reports, lambda: self.now_ns)

    def handle(self, **command):
        self.tracking.handle(json.dumps(command).encode())
        return self.reports()

    def start(self, tracker=COUNTING):
        self.handle(do="start", tracker=tracker, calibration=str(self.file))

    def follow(self, seconds=0.0):
        self.now_ns += round(seconds * 1e9)
        more = self.tracking.follow()
        return more, self.reports()

    def reports(self):
        return [TrackerReport.model_validate_json(line) for line in self._reader.read()]


@pytest.fixture
def worked(run_dir, store):
    made = Worked(run_dir, put_in_force(store, calibration()))
    yield made
    for end in made.ends:
        os.close(end)


def test_it_tracks_from_now_on_and_reports_every_few_seconds(worked, ring, store):
    publish(ring, 20)  # perhaps of the calibration before
    worked.start()
    _, [first] = worked.follow()
    assert first.tracked is None
    publish(ring, 7)
    assert worked.follow(2.9) == (False, [])
    _, [report] = worked.follow(0.2)
    seen = report.tracked
    assert (seen.calibration, seen.turns, seen.t_ns) == (store.current.id, 7, 26)
    assert seen.memory_s == load_bench().tracking.memory_s
    [alpha] = seen.quantities
    assert (alpha.value, alpha.half_width, alpha.departed) == (1.000007, 1e-5, False)
    assert seen.unseen == ("the offset",)  # infinitely wide


def test_ticks_that_are_overwritten_it_does_without(worked, ring):
    worked.start()
    publish(ring, 100)
    worked.follow()
    publish(ring, 5)
    _, [report] = worked.follow(10.0)
    assert report.tracked.turns == 63 + 5


def test_it_reads_a_bounded_piece_at_once(worked, ring, monkeypatch):
    monkeypatch.setattr(process, "READ_AT_ONCE", 10)
    worked.start()
    publish(ring, 25)
    assert [worked.follow(10.0)[0] for _ in range(4)] == [True, True, False, False]


def test_it_goes_on_with_the_ring_of_a_loop_that_was_started_again(worked, ring, run_dir):
    worked.start()
    publish(ring, 5)
    worked.follow()
    successor = RingWriter(run_dir.ring, 64)
    publish(successor, 3)
    worked.follow()
    _, [report] = worked.follow(10.0)
    assert report.tracked.turns == 8


def test_without_a_ring_it_waits_for_one(worked, run_dir):
    worked.start()
    _, [report] = worked.follow()
    assert report.tracked is None
    publish(RingWriter(run_dir.ring, 64), 4)
    assert worked.follow(10.0)[1][0].tracked.turns == 4


def test_what_it_would_adopt_is_written_when_it_is_asked(worked, ring, run_dir, store):
    worked.start()
    [few] = worked.handle(do="adopt", number=1)
    assert (few.adopted.number, few.adopted.obstacle) == (1, "0 turns are too few")
    assert not run_dir.adopted.exists()
    publish(ring, 30)
    worked.follow()
    [done] = worked.handle(do="adopt", number=2)
    assert (done.adopted.number, done.adopted.obstacle) == (2, "")
    written = load(run_dir.adopted)
    assert written.alpha == (1.00003, *store.current.alpha[1:])


def test_a_tracker_that_fails_is_reported_and_ends_the_process(worked, ring):
    worked.start()
    publish(ring, 1, missed=99)
    with pytest.raises(ValueError, match="no such tick"):
        worked.follow()
    [failed] = worked.reports()
    assert failed.obstacle == "the tracker failed: ValueError: no such tick"


def test_a_calibration_that_is_gone_is_reported(worked):
    worked.file.unlink()
    with pytest.raises(CalibrationError):
        worked.start()
    [failed] = worked.reports()
    assert "cannot read it" in failed.obstacle


# --- the supervisor's end


class Played(PlayedProcess):
    """A tracker process that the test plays."""

    def begun(self):
        """Return the command to start."""
        [start] = self.received()
        return start

    def report(self, tracked=None, **more):
        self.say(json.dumps({"tracked": tracked, **more}).encode())

    def track(self, calibration_id, *departed, turns=9, **more):
        """Report alpha_a, alpha_b and alpha_c, of which some have departed."""
        quantities = [
            {"name": f"alpha_{phase}", "meaning": f"the gain of phase {phase}", "unit": "",
             "value": 1.02, "half_width": 0.004, "in_force": 1.0, "in_force_half_width": 0.005,
             "departed": phase in departed}
            for phase in "abc"
        ]  # fmt: skip
        tracked = {"calibration": calibration_id, "t_ns": 1, "turns": turns, "memory_s": 300.0,
                   "quantities": quantities, "unseen": [], "obstacle": "", **more}  # fmt: skip
        self.report(tracked=tracked)


class Linked(LinkedProcess):
    """The tracker's link, and the processes that it has started."""

    def __init__(self, store, start=lambda row: Played()):
        self.store = store
        super().__init__(TRACKER, partial(TrackerLink, store, implementation=COUNTING), start)

    def installed(self, **changes):
        """Install a calibration; return its id and its process."""
        path = put_in_force(self.store, calibration(**changes))
        assert self.step() == []
        played = self.started[-1]
        assert played.begun() == {"do": "start", "tracker": COUNTING, "calibration": str(path)}
        return path.stem, played


@pytest.fixture
def linked(store):
    made = Linked(store)
    yield made
    made.close()


def test_nothing_runs_without_a_calibration(linked):
    assert linked.step() == []
    assert (linked.started, linked.link.view, linked.children.views()) == ([], None, {})


def test_a_calibration_is_tracked_once_it_is_on_disk(linked, store):
    store.current = calibration()  # not yet written
    linked.step()
    view = linked.link.view
    assert linked.started == []
    assert (view.calibration, view.obstacle) == (store.current_id(), NOT_WRITTEN)
    thread = Asked(linked.link)
    until(linked, lambda: not thread.is_alive())
    assert thread.answer.obstacle == NOT_WRITTEN
    name, played = linked.installed()
    assert (linked.link.view.calibration, linked.link.view.obstacle) == (name, NOTHING_YET)
    played.track(name, turns=17)
    linked.step()
    view = linked.link.view
    assert (view.turns, len(view.quantities), view.obstacle) == (17, 3, "")
    assert linked.children.views()[TRACKER].running
    assert linked.events.recent() == []


def test_a_tracker_that_has_seen_no_turns_says_so(linked):
    _, played = linked.installed()
    played.report(tracked=None)
    linked.step()
    assert (linked.link.view.turns, linked.link.view.obstacle) == (0, NO_TURNS)


def test_another_calibration_has_another_process_and_nothing_of_the_one_before(linked):
    name, first = linked.installed()
    first.track(name, "a")
    linked.step()
    other, second = linked.installed(alpha=(0.9, 1.05, 1.05))
    assert first.code == -signal.SIGKILL
    assert linked.link.view.turns == 0
    second.track(name, "b")  # of another calibration
    linked.step()
    assert (linked.link.view.calibration, linked.link.view.obstacle) == (other, NOTHING_YET)
    second.track(other, "a")
    linked.step()
    assert len(linked.messages("calibration_departed")) == 2
    assert linked.step(1.0) == []


@pytest.mark.parametrize("sig", [signal.SIGKILL, signal.SIGSEGV])
def test_a_process_that_dies_is_started_again_and_begins_anew(linked, sig):
    name, played = linked.installed()
    played.track(name)
    linked.step()
    played.code = -sig
    assert linked.step() == [(f"killed by {sig.name}", 0.1)]
    assert (linked.link.view.turns, linked.link.view.obstacle) == (0, ENDED)
    linked.step(0.2)
    assert len(linked.started) == 2
    assert linked.link.view.obstacle == NOTHING_YET
    linked.started[1].begun()
    linked.started[1].track(name, turns=1)
    linked.step()
    assert linked.link.view.turns == 1


def test_one_that_always_fails_is_started_ever_more_seldom(linked):
    _, played = linked.installed()
    pauses_s = []
    while len(pauses_s) < 12:
        played.report(obstacle="the tracker failed: because")
        linked.step()
        played.code = 1
        pauses_s += [again_s for _, again_s in linked.step()]
        assert linked.link.view.obstacle == "the tracker failed: because"
        linked.step(pauses_s[-1] + 0.01)
        played = linked.started[-1]
        played.begun()
    assert pauses_s == sorted(pauses_s)
    assert (pauses_s[0], pauses_s[-1]) == (0.1, 60.0)


def test_one_that_is_to_be_started_again_is_not_if_nothing_is_in_force_any_more(linked, store):
    _, played = linked.installed()
    played.code = 1
    linked.step()
    store.current = None
    assert linked.step(1.0) == []
    assert (len(linked.started), linked.link.view, linked.children.views()) == (1, None, {})


def test_one_that_cannot_be_started_is_tried_again(linked, store):
    linked.why = OSError(12, "Cannot allocate memory")
    put_in_force(store, calibration())
    ends = linked.step(1.0)
    assert ends[0] == ("it cannot be started: Cannot allocate memory", 0.1)
    assert linked.link.view.obstacle == NOTHING_YET
    linked.why = None
    linked.step(1.0)
    assert len(linked.started) == 1


def test_one_that_is_stopped_is_ended_with_an_event(linked):
    _, played = linked.installed()
    linked.step(REPORTLESS_MAX_NS / 1e9)
    assert played.code is None
    linked.step()
    assert played.code == -signal.SIGKILL
    [said] = linked.messages("process")
    assert said == "tracker has sent nothing for 300 s since it was started; it is ended"
    assert linked.step(0.5) == [("killed by SIGKILL", 0.1)]
    assert len(linked.started) == 2


def quantity(**changes):
    usual = {"name": "alpha_a", "meaning": "m", "unit": "", "value": 1.0, "half_width": 0.1,
             "in_force": 1.0, "in_force_half_width": 0.1, "departed": False}  # fmt: skip
    return json.dumps({**usual, **changes})


def tracked_line(*quantities, unseen="[]", more=""):
    return (
        '{"tracked":{"calibration":"C","t_ns":1,"turns":5,"memory_s":1.0,"quantities":['
        + ",".join(quantities) + f'],"unseen":{unseen},"obstacle":""{more}}}}}'
    ).encode()  # fmt: skip


def test_the_line_that_garbage_is_made_of_is_good():
    assert TrackerReport.model_validate_json(tracked_line(quantity())).tracked.turns == 5


@pytest.mark.parametrize(
    "garbage",
    [
        b"{}",
        tracked_line(quantity(value=float("nan"))),
        tracked_line(quantity(value=float("inf"))),
        tracked_line(quantity(half_width=-0.1)),
        tracked_line(quantity(half_width="0.1")),
        tracked_line(quantity(departed=1)),
        tracked_line(quantity(more=1)),
        tracked_line(quantity(name="x" * 201)),
        tracked_line(*[quantity()] * 257),
        tracked_line(quantity(), unseen=json.dumps(["x"] * 257)),
        tracked_line(quantity(), more=',"more":1'),
        tracked_line(quantity()).replace(b'"turns":5', b'"turns":-1'),
        tracked_line(quantity()).replace(b'"memory_s":1.0', b'"memory_s":NaN'),
        tracked_line(quantity()).replace(b'"obstacle":""', b'"obstacle":"' + b"x" * 1001 + b'"'),
        b'{"tracked":null,"adopted":{"number":1,"obstacle":"","path":"/etc/passwd"}}',
    ],
    ids=range(15),
)  # fmt: skip
def test_garbage_is_no_report(garbage):
    with pytest.raises(ValidationError):
        TrackerReport.model_validate_json(garbage)


# --- departures


MINUTE_NS = 60_000_000_000


class Seen:
    """What is tracked, every 3 s, of phases of which some have departed."""

    def __init__(self):
        self.events, self.now_ns = EventLog(lambda: 0), 0
        self.departures = Departures(self.events)

    def see(self, departed="", seconds=3, phases="abc", fixed=""):
        """Let them be seen for so long; return the messages of departures and returns so far."""
        quantities = tuple(
            TrackedQuantity(
                name=f"alpha-{phase}", meaning=f"the gain of phase {phase}", unit="1", value=1.02,
                half_width=0.004, in_force=1.0, in_force_half_width=0.005,
                departed=phase in departed, adoptable=phase not in fixed,
            )
            for phase in phases
        )  # fmt: skip
        view = TrackedCalibration(calibration="C", turns=9, memory_s=60.0, quantities=quantities)
        for _ in range(seconds // 3):
            self.now_ns += 3_000_000_000
            self.departures.step(view, self.now_ns)
        return self.messages("calibration_departed"), self.messages("calibration")

    def messages(self, kind):
        return [event.message for event in self.events.recent() if event.kind == kind]


def test_each_departure_is_an_event_once_and_once_that_all_are_back():
    seen = Seen()
    assert seen.see(seconds=90) == ([], [])
    [first], _ = seen.see("a", 30)
    assert first.startswith("the gain of phase a: 1.0200 +- 0.0040, in force 1.0000 +- 0.0050. ")
    assert "`motord plan start check-calibration`" in first
    assert "`motord calibration adopt`" in first
    (_, second), _ = seen.see("ac", 30)
    assert second.startswith("the gain of phase c: ")
    assert len(seen.see("c", 90)[0]) == 2
    assert len(seen.see("ac", 30)[0]) == 2
    assert seen.see(seconds=60)[1] == []
    events, back = seen.see()
    assert (len(events), back) == (2, ["C: what is tracked is back within its intervals"])
    assert len(seen.see(seconds=90)[1]) == 1
    assert len(seen.see("a", 30)[0]) == 3
    kinds = [event for event in seen.events.recent() if event.kind == "calibration_departed"]
    assert [event.data["departed"] for event in kinds] == [["alpha-a"], ["alpha-c"], ["alpha-a"]]


def test_a_value_at_its_limit_is_one_event_however_long_it_stays_there():
    seen = Seen()
    for _ in range(60):
        seen.see("a", 6)
        seen.see("", 54)
    assert (len(seen.events.recent()), seen.now_ns) == (1, 60 * MINUTE_NS)


@pytest.mark.parametrize("phases", ["", "bc"])
def test_what_is_not_seen_any_more_is_not_back(phases):
    seen = Seen()
    seen.see("a", 30)
    assert len(seen.see("", 600, phases=phases)[1]) == 0
    assert len(seen.see("", 60)[1]) == 0  # since it is seen again, no memory has passed
    assert len(seen.see("", 3)[1]) == 1


def test_events_that_follow_close_upon_each_other_are_one():
    seen = Seen()
    seen.see("a")
    assert len(seen.see("ab")[0]) == len(seen.see("abc")[0]) == 1
    _, later = seen.see("abc", 6)[0]
    assert later.startswith("the gain of phase b: ")
    assert "the gain of phase c: " in later


def test_what_cannot_be_adopted_is_not_to_be_adopted():
    [said], _ = Seen().see("a", fixed="a")
    assert "motord calibration adopt" not in said
    assert said.endswith(" tests it, alpha-a cannot be adopted: calibrate again")
    [both], _ = Seen().see("ab", fixed="a")
    assert "`motord calibration adopt` puts the tracked values in force" in both
    assert both.endswith("alpha-a cannot be adopted: calibrate again")


def test_tracking_that_begins_anew_is_no_return(linked):
    name, played = linked.installed()
    played.track(name, "a", memory_s=1.0)
    linked.step()
    played.track(name, memory_s=1.0)
    linked.step()
    played.code = -signal.SIGKILL
    linked.step(11.0)
    again = linked.started[-1]
    again.begun()
    again.report()
    linked.step()
    again.track(name, memory_s=1.0)
    linked.step(1.1)
    assert linked.messages("calibration") == []
    again.track(name, memory_s=1.0)
    linked.step()
    assert len(linked.messages("calibration")) == 1


# --- adoption


class Asked(threading.Thread):
    """Asks in a thread of its own, as the intake does."""

    def __init__(self, link, timeout_s=PATIENCE_S):
        super().__init__()
        self.link, self.timeout_s, self.answer = link, timeout_s, None
        self.start()

    def run(self):
        try:
            self.answer = self.link.adopt(self.timeout_s)
        except TimeoutError:
            self.answer = "late"


def until(linked, condition):
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        linked.step()
        time.sleep(0.001)


def asked(linked, played):
    """Ask; return the thread and the number of the command that the process received."""
    thread, received = Asked(linked.link), []
    until(linked, lambda: received.extend(played.received()) or received)
    [command] = received
    assert command["do"] == "adopt"
    return thread, command["number"]


def test_the_process_is_asked_to_adopt_and_answers(linked):
    _, played = linked.installed()
    thread, number = asked(linked, played)
    played.report(adopted={"number": number - 1, "obstacle": "of the one before"})
    played.report(adopted={"number": number, "obstacle": ""})
    until(linked, lambda: not thread.is_alive())
    assert thread.answer.obstacle == ""


def test_a_process_that_dies_answers_what_it_was_asked(linked):
    _, played = linked.installed()
    thread, _ = asked(linked, played)
    played.code = -signal.SIGKILL
    until(linked, lambda: not thread.is_alive())
    assert thread.answer.obstacle == ENDED


def test_without_a_process_the_answer_comes_at_once(linked, store):
    thread = Asked(linked.link)
    until(linked, lambda: not thread.is_alive())
    assert thread.answer.obstacle == NOT_IN_FORCE
    linked.why = OSError(12, "Cannot allocate memory")
    put_in_force(store, calibration())
    linked.step()
    thread = Asked(linked.link)
    until(linked, lambda: not thread.is_alive())
    assert thread.answer.obstacle == NOTHING_YET


def test_who_asks_a_stopped_process_waits_no_longer_than_it_says(linked):
    _, played = linked.installed()
    thread = Asked(linked.link, 0.01)
    until(linked, lambda: not thread.is_alive())
    assert thread.answer == "late"
    linked.step()
    assert len(played.received()) == 1
    thread, number = asked(linked, played)
    played.report(adopted={"number": number, "obstacle": ""})
    until(linked, lambda: not thread.is_alive())
    assert thread.answer.obstacle == ""


def test_who_asks_when_the_daemon_ends_is_answered_at_once(linked):
    linked.installed()
    before = Future()
    linked.link._requests.put(before)
    linked.link.stop()
    assert before.result(0).obstacle == SHUTTING_DOWN
    after = Asked(linked.link)
    after.join(PATIENCE_S / 2)
    assert after.answer.obstacle == SHUTTING_DOWN


# --- the process


@pytest.fixture
def running(store, run_dir):
    made = Linked(store, partial(linked_process.running, run_dir))
    yield made
    made.close()


@pytest.mark.system
def test_the_process_tracks_steps_back_and_ends_with_the_calibration(running, store, ring):
    file = put_in_force(store, calibration())
    running.until(lambda: running.link.view and running.link.view.obstacle == NO_TURNS)
    [tracker] = running.started

    def seen():
        publish(ring, 1)
        return running.link.view.turns

    running.until(seen)
    assert running.link.view.calibration == file.stem
    assert os.getpriority(os.PRIO_PROCESS, tracker.pid) == scheduling.BACKGROUND_NICE
    os.kill(tracker.pid, signal.SIGSTOP)
    store.current = None
    running.until(lambda: tracker.poll() is not None)
    assert (running.link.view, running.messages("process")) == (None, [])


def test_the_fake_is_a_tracker():
    tracker: process.Tracker = CountingTracker(None, calibration(), 1.0)
    assert tracker.tracked() is None
