"""What a recording receives of the loop's punctuality, through the pipe to its recorder."""

import json
import os

import numpy as np
import pytest
from typer.testing import CliRunner

from motord import config
from motord.cli.record.commands import app
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE, State
from motord.service.host.events import EventLog
from motord.service.recording import session
from motord.service.recording.control import NO_TICKS, RecordingControl
from motord.service.recording.logs import EVERY_NS
from motord.shm.time_count import count_time
from motord.shm.timing import Timing, TimingSummary, total

START_NS = 1_700_000_000_000_000_000


class Recorder:
    """The other ends of a recorder's pipes, and the process that the supervisor sees."""

    def __init__(self, pid):
        self.pid = pid
        self.code = None
        commands, self._stdin = os.pipe()
        self._stdout, reports = os.pipe()
        self.stdin = os.fdopen(self._stdin, "wb", buffering=0)
        self.stdout = os.fdopen(self._stdout, "rb", buffering=0)
        self.commands = os.fdopen(commands, "rb", buffering=0)
        self.reports = os.fdopen(reports, "wb", buffering=0)
        os.set_blocking(commands, False)

    def poll(self):
        return self.code

    def say(self, **report):
        self.reports.write(json.dumps(report).encode() + b"\n")

    def received(self):
        """The commands since the last call: what to do and, of events, their kind."""
        lines = (self.commands.read() or b"").splitlines()
        commands = [json.loads(line) for line in lines]
        return [c | {"kind": c.get("content", {}).get("kind", c["do"])} for c in commands]

    def close(self):
        for end in (self.stdin, self.stdout, self.commands, self.reports):
            end.close()


class Children:
    """Has one recorder at a time."""

    def __init__(self):
        self.running = None
        self.stopped = 0

    def start(self, _name, _now_ns):
        pass

    def process(self, _name):
        return self.running

    def count(self, _name, _bad, _dropped):
        pass

    def poll(self, _now_ns):
        if self.running is not None and self.running.code is not None:
            self.running = None
        return []

    def stop(self, _name, _timeout_s):
        self.stopped += 1


class Bench:
    """A recording with a loop that counts, a recorder that receives, and a clock."""

    def __init__(self, folder):
        self.now_ns = START_NS
        self.path = folder / "timing"
        self.children = Children()
        self.recorders = []
        self.events = events = EventLog(lambda: self.now_ns)
        self.recording = RecordingControl(
            config.load(), "", self.children, events, lambda: self.now_ns, self.path
        )
        self.ring_s = config.load().loop.ring_s

    def next_recorder(self):
        self.children.running = Recorder(len(self.recorders))
        self.recorders.append(self.children.running)
        self.recording.step(0)
        return self.children.running

    def power_on(self):
        tick = np.zeros(1, TICK_DTYPE)
        tick["state"] = State.ENABLED
        self.recording.take_ticks(tick)
        self.recording.step(0)
        self.recording.take_ticks(NO_TICKS)

    def loop(self):
        self.live = Timing.create(self.path)
        return self.live

    def close(self):
        for recorder in self.recorders:
            recorder.close()


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path)
    yield made
    made.close()


def timings(commands):
    return [TimingSummary.model_validate(c["content"]["data"]) for c in commands
            if c["kind"] == "timing"]  # fmt: skip


def test_a_recording_gets_what_was_counted_while_it_was_made(bench):
    recorder, live = bench.next_recorder(), bench.loop()
    count_time(live.work.cells, 1_000)
    bench.power_on()
    count_time(live.work.cells, 5_000)
    count_time(live.wake_late.cells, 70)
    live.record["missed"] = 3
    bench.recording.end("over")
    commands = recorder.received()
    assert [command["kind"] for command in commands] == ["start", "timing", "stop"]
    [part] = timings(commands)
    assert (part.missed, part.work.samples, part.wake_late.samples) == (3, 1, 1)
    assert 5.0 <= part.work.max_us < 5.2
    assert commands[1]["content"]["data"]["t_start_ns"] == START_NS
    assert "3 missed of 4" in commands[1]["content"]["message"]


def test_it_is_reported_every_minute_and_the_parts_add_up(bench):
    recorder, live = bench.next_recorder(), bench.loop()
    bench.power_on()
    for minute in range(3):
        count_time(live.work.cells, 1_000 * (minute + 1))
        live.record["missed"] += 1
        bench.now_ns += EVERY_NS
        bench.recording.step(0)
        bench.recording.step(0)
    count_time(live.work.cells, 9_000)
    bench.recording.end("the loop ended")
    parts = timings(recorder.received())
    assert [(part.missed, part.work.samples) for part in parts] == [(1, 1)] * 3 + [(0, 1)]
    whole = total(parts)
    assert (whole.missed, whole.work.samples) == (3, 4)
    assert whole.work.bins == live.summary().work.bins


def test_the_next_recording_begins_to_count_where_the_one_before_ended(bench):
    recorder, live = bench.next_recorder(), bench.loop()
    bench.power_on()
    count_time(live.work.cells, 1_000)
    bench.recording.end("first")
    bench.power_on()
    count_time(live.work.cells, 2_000)
    count_time(live.work.cells, 2_000)
    bench.recording.end("over")
    commands = recorder.received()
    assert [c["kind"] for c in commands] == ["start", "timing", "stop"] * 2
    assert [part.work.samples for part in timings(commands)] == [1, 2]


def test_nothing_is_lost_while_there_is_no_recorder(bench):
    recorder, live = bench.next_recorder(), bench.loop()
    bench.power_on()
    count_time(live.work.cells, 1_000)
    bench.children.running = None
    bench.now_ns += 2 * EVERY_NS
    bench.recording.step(0)
    count_time(live.work.cells, 2_000)
    second = bench.next_recorder()
    bench.recording.end("over")
    assert timings(recorder.received()) == []
    commands = second.received()
    assert (commands[0]["do"], commands[0]["resume"]) == ("start", True)
    assert sum(part.work.samples for part in timings(commands)) == 2


@pytest.mark.parametrize("known", [True, False])
def test_a_recording_that_ends_as_its_recorder_has_died_is_finished_with_it(bench, known):
    """Whether that is known by then or not: the pipe takes it, and nobody reads it."""
    bench.next_recorder()
    live = bench.loop()
    bench.power_on()
    count_time(live.work.cells, 1_000)
    if known:
        bench.children.running = None
        bench.recording.step(0)
    bench.recording.end("over")
    [finish] = bench.next_recorder().received()
    assert finish["do"] == "finish"
    [event] = finish["last"]
    assert TimingSummary.model_validate(event["content"]["data"]).work.samples == 1
    bench.now_ns += 1_000_000
    bench.power_on()
    assert [command["kind"] for command in bench.recorders[-1].received()] == ["start"]


def test_without_a_loop_that_counts_there_is_no_such_event(bench):
    recorder = bench.next_recorder()
    bench.power_on()
    bench.recording.end("over")
    assert [command["kind"] for command in recorder.received()] == ["start", "stop"]


def test_at_the_end_the_recorder_gets_the_time_to_write_it(bench):
    recorder, live = bench.next_recorder(), bench.loop()
    bench.power_on()
    count_time(live.work.cells, 1_000)
    recorder.say(recording=True, file="run-000.mcap", error="")
    bench.recording.step(0)
    closed = str(bench.recording.recorder.task.stem)
    recorder.say(recording=False, file="run-000.mcap", closed=[closed], error="")
    bench.recording.close()
    bench.recording.recorder.stop()
    commands = [command["kind"] for command in recorder.received()]
    assert commands == ["start", "timing", "stop"]
    assert bench.children.stopped == 1
    assert bench.events.recent() == []
    assert not bench.recording.view().recording


@pytest.mark.parametrize("left_s", ["UP_S", "CLOSE_S"])
def test_a_recorder_that_closes_nothing_is_waited_for_no_longer_than_that(
    bench, monkeypatch, left_s
):
    """A successor that does not come, or one that hangs."""
    monkeypatch.setattr(session, left_s, 0.0)
    recorder = bench.next_recorder()
    bench.power_on()
    recorder.say(recording=True, file="run-000.mcap", error="")
    bench.recording.step(0)
    if left_s == "UP_S":
        recorder.code = -9
        bench.children.poll(0)
        bench.recording.step(0)
    name = bench.recording.recorder.task.stem.name
    bench.recording.close()
    bench.recording.recorder.stop()
    assert bench.children.stopped == 1
    messages = [event.message for event in bench.events.recent()]
    assert messages == [f"{name} was not closed: its last ticks may be missing"]


def test_what_ended_longer_ago_than_the_ring_reaches_is_not_finished(bench):
    first = bench.next_recorder()
    bench.power_on()
    ended = bench.recording.recorder.task.stem.name
    first.code = -9
    bench.children.poll(0)
    bench.recording.step(0)
    bench.recording.end("over")
    second = bench.next_recorder()
    assert [command["do"] for command in second.received()] == ["finish"]
    bench.now_ns += round(bench.ring_s * 1e9) + 1
    third = bench.next_recorder()
    assert third.received() == []
    [event] = bench.events.recent()
    assert event.message == f"{ended} was not closed: its last ticks may be missing"


def test_record_info_adds_up_what_a_file_recorded(tmp_path):
    path, live = tmp_path / "run.mcap", Timing()
    with RunWriter(path, {"bench": "sim"}) as writer:
        for missed in (1, 2):
            part = Timing()
            count_time(part.wake_late.cells, 40 * missed)
            count_time(part.work.cells, 5_000 * missed)
            part.record["missed"] = missed
            live.merge(part)
            summary = part.summary()
            data = summary.model_dump(mode="json")
            writer.event(START_NS + missed, "timing", summary.line(), data)
        writer.event(START_NS + 3, "state", "OFF -> READY", {})
    result = CliRunner().invoke(app, ["info", str(path)])
    assert f"timing:           {live.summary().line()}" in result.output
    result = CliRunner().invoke(app, ["info", str(path), "--json"])
    timing = json.loads(result.output)["timing"]
    assert (timing["missed"], timing["work"]["samples"]) == (3, 2)
