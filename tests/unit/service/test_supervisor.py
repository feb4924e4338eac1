"""The whole daemon but for its processes, which are played by the test, and for Zenoh."""

import json
import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.api.errors import RpcError
from motord.api.requests import RPCS, parse
from motord.loop.rt_setup import RealtimeStatus
from motord.loop.status import LoopPhase, LoopStatus
from motord.schema import State
from motord.sequencing.settings import COMPENSATE
from motord.service import build as service
from motord.service.host.systemd import Notifier
from motord.service.processes import PROCESSES
from motord.service.recording import session
from motord.service.rpc.dispatcher import Call
from motord.service.rpc.plans import PlanControl
from motord.shm.mailbox import MailboxReader
from motord.shm.ring import RingWriter, capacity_for
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesReader
from motord.unix_clock import Clock
from tests.support import early_end
from tests.unit.service.test_installation import calibration, put_in_force


class Played:
    """A process that the test plays."""

    pid = 4711

    def __init__(self):
        self.code = None
        self.signals = []

    def poll(self):
        return self.code

    def wait(self, timeout=None):
        return self.code

    def send_signal(self, sig):
        self.signals.append(sig)
        self.code = -sig


class PlayedLoop(Played):
    """Publishes ticks on command."""

    def __init__(self, run_dir, bench_config):
        super().__init__()
        self.run_dir = run_dir
        self.ring = RingWriter(run_dir.ring, capacity_for(bench_config.loop))
        self.mailbox = MailboxReader(run_dir.setpoint)
        self.tables = TablesReader(run_dir.tables)
        self.number = 0

    def ready(self):
        status = RealtimeStatus(
            items=[], kernel="k", preemption="p", rt_runtime_us=0, rt_period_us=0, isolated_cpus=""
        )
        LoopStatus(phase=LoopPhase.READY, pid=1, realtime=status).write(self.run_dir.loop_status)

    def fail(self, error):
        LoopStatus(phase=LoopPhase.FAILED, pid=1, error=error).write(self.run_dir.loop_status)
        self.code = 1

    def tick(self, state=State.OFF, count=1):
        self.tables.poll()
        for _ in range(count):
            slot = self.ring.slot()[0]
            slot["tick"], slot["state"] = self.number, state
            slot["plan_point"] = -1
            self.number += 1
            self.ring.publish()


class PlayedPipes(Played):
    """A child behind pipes; `received` returns its commands."""

    def __init__(self, pid):
        super().__init__()
        self.pid = pid
        commands, self._into = os.pipe()
        self._out_of, reports = os.pipe()
        self.stdin, self.stdout = os.fdopen(self._into, "wb", 0), os.fdopen(self._out_of, "rb", 0)
        self._commands, self._reports = os.fdopen(commands, "rb", 0), os.fdopen(reports, "wb", 0)
        os.set_blocking(commands, False)
        self._rest = b""

    def received(self, do=None):
        return [c for c in self._whole_lines() if do in (None, c["do"])]

    def _whole_lines(self):
        *lines, self._rest = (self._rest + (self._commands.read() or b"")).split(b"\n")
        return [json.loads(line) for line in lines]

    def send(self, message):
        self._reports.write(json.dumps(message).encode() + b"\n")

    def close(self):
        for pipe in (self._commands, self._reports, self.stdin, self.stdout):
            pipe.close()


class PlayedRecorder(PlayedPipes):
    """A recorder."""

    def report(self, **report):
        self.send({"recording": True, "error": "", **report})


class PlayedDaemon:
    """An assembled daemon whose time the test steps."""

    def __init__(self, folder, monkeypatch, **changes):
        base = config.load().model_dump()
        base["bench"].update(name="played")
        for section, values in changes.items():
            base[section].update(values)
        self.config = config.Config.model_validate(base)
        self.folder = folder
        self.run_dir = RunDir("played", folder)
        self.run_dir.create()
        self.loops, self.recorders, self.estimators, self.trackers = [], [], [], []
        self.spawn = {
            "loop": self._spawn_loop,
            "recorder": self._spawn_recorder,
            "estimator": self._spawn_estimator,
            "tracker": self._spawn_tracker,
        }
        played = [
            replace(row, spawn=lambda command, name=row.name: self.spawn[name](command))
            for row in PROCESSES
        ]
        monkeypatch.setattr(service, "PROCESSES", played)
        monkeypatch.chdir(folder)
        self.supervisor = service.build(
            self.config, "the text", Path("/bench.toml"), self.run_dir, folder, Clock(0), Notifier()
        ).supervisor
        self.now_ns = 1_000_000_000_000
        self.supervisor.clock_ns = lambda: self.now_ns

    def _spawn_loop(self, command):
        self.loops.append(PlayedLoop(self.run_dir, self.config))
        return self.loops[-1]

    def _spawn_recorder(self, command):
        self.recorders.append(PlayedRecorder(100 + len(self.recorders)))
        return self.recorders[-1]

    def _spawn_estimator(self, command):
        self.estimators.append(PlayedPipes(200 + len(self.estimators)))
        return self.estimators[-1]

    def _spawn_tracker(self, command):
        self.trackers.append(PlayedPipes(300 + len(self.trackers)))
        return self.trackers[-1]

    def up(self):
        self.supervisor.start()
        self.loops[-1].ready()
        self.step()
        self.recorders[-1].report(recording=False)
        self.step()

    def begin_plan(self):
        """Begin a plan that is recorded; return the token and the recorder's command to start."""
        self.up()
        token = self.ask("lease/acquire", holder="anna")["token"]
        self.ask("plan/start", token=token, name="calibrate")
        [start] = self.recorders[0].received("start")
        self.recorders[0].report(file=f"{start['out']}-000.mcap")
        self.step(2)
        return token, start

    def record(self):
        """Be enabled, so that it is recorded; return the recorder's command to start."""
        self.step(2, State.ENABLED)
        [start] = self.recorders[-1].received("start")
        self.recorders[-1].report(file=f"{start['out']}-000.mcap")
        return start

    def step(self, steps=1, state=State.OFF):
        for _ in range(steps):
            self.now_ns += 10_000_000
            if self.loops and self.loops[-1].code is None:
                self.loops[-1].tick(state, 20)
            self.supervisor.step()

    def bring(self, name, /, **arguments):
        payload, prepared = json.dumps(arguments).encode(), None
        if name == "plan/start":  # a thread of the intake makes the plan
            bench = self.supervisor.bench
            _, prepared = PlanControl(bench, bench.plans).make(payload)
        call = Call(name, parse(RPCS[name], payload), prepared)
        self.supervisor.dispatcher.calls.put(call)
        return call

    def ask(self, name, /, **arguments):
        call = self.bring(name, **arguments)
        self.step(2)
        return call.wait(0).content()

    def messages(self):
        return [e.message for e in self.supervisor.bench.events.recent()]

    def state(self):
        return json.loads(self.supervisor.publisher.documents["state"]())

    def close(self):
        for child in self.recorders + self.estimators + self.trackers:
            child.close()


@pytest.fixture
def played(tmp_path, monkeypatch):
    daemon = PlayedDaemon(tmp_path, monkeypatch)
    yield daemon
    daemon.close()


def test_every_rpc_has_a_handler(played):
    assert played.supervisor.dispatcher.handlers.keys() == RPCS.keys()


def test_a_bench_that_is_not_powered_is_not_recorded(played):
    played.step()
    assert played.state()["fault"] == "the loop is not up yet"
    played.up()
    assert played.state()["fault"] == ""
    assert played.supervisor.recording.settled
    played.step(300)
    played.step(50, State.READY)
    assert played.recorders[0].received("start") == []
    assert not played.state()["recording"]["recording"]


def test_a_bench_is_recorded_from_before_it_was_enabled_until_after_it_no_longer_is(played):
    played.up()
    played.step(300)
    enabled_at = played.loops[0].number
    played.step(1, State.ENABLED)
    [start] = played.recorders[0].received("start")
    assert start["first_tick"] == enabled_at - 2 * played.config.loop.rate_Hz
    assert start["resume"] is False
    assert Path(start["out"]).parent == played.folder / "runs"
    assert Path(start["out"]).name.startswith("played-1970")
    assert start["metadata"]["config"] == "the text"
    assert start["metadata"]["realtime"]["kernel"] == "k"
    assert not played.supervisor.recording.settled
    name = f"{start['out']}-000.mcap"
    played.recorders[0].report(file=name, path=f"{name}.part", ticks=3)
    played.step(12, State.ENABLED)
    view = played.supervisor.recording.view()
    assert played.supervisor.recording.settled
    assert (view.path, view.final_path) == (f"{name}.part", name)
    assert view.detail == {"ticks": 3}
    played.step(195, State.TRIPPED)  # a trip is no end of interest
    assert played.recorders[0].received("stop") == []
    played.step(1, State.ENABLED)
    played.step(195, State.OFF)
    assert played.recorders[0].received("stop") == []
    played.step(10, State.OFF)
    assert len(played.recorders[0].received("stop")) == 1
    assert played.recorders[0].received("start") == []


def test_a_note_goes_into_the_file_that_is_being_recorded(played):
    played.up()
    assert played.ask("note", text="before")["recording"] == ""
    played.step(2, State.ENABLED)
    [start] = played.recorders[0].received("start")
    name = f"{start['out']}-000.mcap"
    assert played.ask("note", text="first")["recording"] == name
    later = f"{start['out']}-001.mcap"
    played.recorders[0].report(file=later)
    played.step(1, State.ENABLED)
    assert played.ask("note", text="second")["recording"] == later
    notes = [e["content"] for e in played.recorders[0].received("event")]
    assert [n["message"] for n in notes if n["kind"] == "note"] == ["first", "second"]
    played.recorders[0].report(recording=False, error="the disk is full")
    played.step(1, State.ENABLED)
    assert played.ask("note", text="third")["recording"] == ""


def test_the_state_by_name_goes_into_every_file_from_its_beginning(played):
    played.up()
    played.step(300)
    played.step(2, State.ENABLED)
    recorder = played.recorders[0]
    commands = recorder.received()
    [start] = [c for c in commands if c["do"] == "start"]
    states = [(c["t_ns"], c["content"]["state"]) for c in commands if c["do"] == "state"]
    assert [name for _, name in states] == ["OFF", "ENABLED"]
    seconds = (states[1][0] - states[0][0]) / 1e9
    assert 0.0 < seconds < 10.0  # the played loop has no clock
    token = played.ask("lease/acquire", holder="anna")["token"]
    assert recorder.received("state")[-1]["content"]["holder"] == "anna"
    played.step(2, State.ENABLED)
    assert recorder.received("state")
    recorder.report(file=f"{start['out']}-000.mcap")
    played.step(5, State.ENABLED)
    assert recorder.received("state") == []
    recorder.report(file=f"{start['out']}-001.mcap")
    played.step(2, State.ENABLED)
    [again] = recorder.received("state")
    assert (again["content"]["state"], again["content"]["holder"]) == ("ENABLED", "anna")
    played.ask("lease/release", token=token)
    assert recorder.received("state")[-1]["content"]["holder"] == ""


def test_a_bench_that_an_external_drive_turns_is_recorded(played):
    played.up()
    played.step(5, State.READY)
    played.supervisor.bench.setpoint.drive_Hz = 1.0
    played.step(1, State.READY)
    assert len(played.recorders[0].received("start")) == 1
    played.supervisor.bench.setpoint.drive_Hz = 0.0
    played.step(210, State.READY)
    assert len(played.recorders[0].received("stop")) == 1


def test_everything_is_recorded_always_if_the_bench_file_says_so(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": "always"})
    played.up()
    [start] = played.recorders[0].received("start")
    assert start["first_tick"] == 0
    played.step(300)
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate")
    played.step(2)
    played.ask("stop")
    played.step(300)
    commands = [c for c in played.recorders[0].received() if c["do"] in ("start", "stop")]
    assert ["calibrate" in c.get("out", "no stop is meant") for c in commands] == [True, False]
    played.close()


def test_a_loop_that_is_gone_begins_no_recording_with_its_last_ticks(tmp_path, monkeypatch):
    """One that began so would wait for the numbers of that loop among those of the next."""
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": "always"})
    played.up()
    played.step(5)
    played.loops[0].tick(State.OFF, 20)
    played.loops[0].code = -9
    played.step()
    played.step(3)
    commands = [c["do"] for c in played.recorders[0].received() if c["do"] in ("start", "stop")]
    assert commands == ["start", "stop"]
    assert played.supervisor.recording.settled
    played.close()


def test_power_in_the_last_ticks_of_a_loop_alone_is_recorded(played):
    played.up()
    played.step(5)
    played.loops[0].tick(State.ENABLED, 20)
    played.loops[0].code = -9
    played.step()
    commands = [c["do"] for c in played.recorders[0].received() if c["do"] in ("start", "stop")]
    assert commands == ["start", "stop"]
    assert played.supervisor.recording.settled


def end_after(loop, state):
    """Let a loop publish ticks after the supervisor saw it running, and then end."""

    def poll():
        if loop.code is None:
            loop.tick(state, 20)
            loop.code = -9
        return loop.code

    loop.poll = poll


def test_power_in_ticks_between_the_last_look_at_the_ring_and_the_end_is_recorded(played):
    played.up()
    played.step(5)
    powered = played.loops[0].number + 20  # `step` publishes as many before it looks
    end_after(played.loops[0], State.ENABLED)
    played.step()
    start, stop = (c for c in played.recorders[0].received() if c["do"] in ("start", "stop"))
    before = 2 * played.config.loop.rate_Hz
    assert (start["do"], start["first_tick"]) == ("start", max(0, powered - before))
    assert stop["do"] == "stop"


def test_a_trip_in_the_last_ticks_of_a_loop_is_reported_and_nothing_of_them_stays(played):
    played.up()
    played.step(5)
    end_after(played.loops[0], State.TRIPPED)
    played.step()
    trip, fault = played.messages()[-2:]
    assert "TRIPPED" in trip
    assert fault == "the loop ended: killed by SIGKILL"
    assert played.supervisor.bench.monitor.last is None


def test_power_in_ticks_that_come_while_the_daemon_ends_is_recorded(played):
    played.up()
    played.step(5)
    loop = played.loops[0]
    loop.wait = lambda timeout=None: loop.tick(State.ENABLED, 20) or 0
    played.supervisor.take_down()
    assert len(played.recorders[0].received("start")) == 1


def test_without_auto_only_plans_are_recorded(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": False})
    played.up()
    played.step(5, State.ENABLED)
    played.step(5, State.OFF)
    assert played.recorders[0].received("start") == []
    assert played.supervisor.recording.settled
    token = played.ask("lease/acquire", holder="anna")["token"]
    answer = played.ask("plan/start", token=token, name="calibrate", notes="by night")
    commands = played.recorders[0].received()
    start = next(c for c in commands if c["do"] == "start")
    assert answer["recording"] == f"{start['out']}-000.mcap"
    assert start["metadata"]["plan"]["started_by"] == "anna"
    assert start["metadata"]["notes"].endswith("by night")
    assert "lease" in {c["content"]["kind"] for c in commands if c["do"] == "event"}
    assert next(c["content"]["state"] for c in commands if c["do"] == "plan") == "running"
    played.ask("stop")
    assert "stopped" in next(
        c["content"]["message"] for c in played.recorders[0].received("plan")
    )  # fmt: skip
    played.close()


def test_the_recording_of_a_plan_has_the_serial_number_it_was_started_with(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": False}, motor={"serial": ""})
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate", serial="47/1")
    [start] = played.recorders[0].received("start")
    motor = played.config.motor.model_dump(mode="json", exclude_none=True)
    assert start["metadata"]["motor"] == {**motor, "serial": "47/1"}
    assert played.supervisor.bench.plans.view.serial == "47/1"
    played.close()


def test_a_plan_has_a_recording_of_its_own_between_two_others_while_it_is_powered(played):
    played.up()
    first = played.record()
    played.step(5)
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate")
    played.step(5, State.ENABLED)
    call = played.bring("stop")
    played.step(2, State.ENABLED)  # the loop has not seen it yet
    played.step(2)
    call.wait(0)
    commands = played.recorders[0].received()
    stems = [Path(c["out"]).name for c in commands if c["do"] == "start"]
    assert [("calibrate" in stem) for stem in stems] == [True, False]
    assert len({*stems, Path(first["out"]).name}) == 3
    assert [c for c in commands if c["do"] == "stop"] == []


def test_the_recording_of_a_plan_ends_with_it(played):
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate")
    played.step(5)
    played.ask("stop")
    commands = [c["do"] for c in played.recorders[0].received() if c["do"] in ("start", "stop")]
    assert commands == ["start", "stop"]


def test_the_last_power_of_a_plan_begins_no_recording_after_it(played):
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate")
    played.step(5, State.ENABLED)
    played.bring("plan/abort", token=token)
    while played.supervisor.bench.plans.active:
        played.loops[0].tick(State.ENABLED, 10)  # in one block with the end
        played.step(1, State.READY)
    played.step(5, State.READY)
    assert len(played.recorders[0].received("start")) == 1


@pytest.mark.parametrize(
    ("report", "why"),
    [
        (None, "the recorder is not up"),
        ({"recording": False, "obstacle": "/runs: cannot write there: No such device"}, "/runs"),
    ],
)
def test_a_plan_that_cannot_be_recorded_is_refused_before_anything_is_powered(played, report, why):
    played.up()
    if report is None:
        played.recorders[0].code = -9
    else:
        played.recorders[0].report(**report)
    played.step(2)
    token = played.ask("lease/acquire", holder="anna")["token"]
    with pytest.raises(RpcError, match=why) as caught:
        played.ask("plan/start", token=token, name="calibrate")
    assert "required = false" in caught.value.message
    assert played.supervisor.bench.plans.view is None
    assert played.ask("plan/start", name="calibrate", dry_run=True)["points"]


def test_a_recorder_that_is_silent_is_not_relied_on(played):
    played.up()
    played.step(800)
    token = played.ask("lease/acquire", holder="anna")["token"]
    with pytest.raises(RpcError, match="has not reported for 8 s"):
        played.ask("plan/start", token=token, name="calibrate")


def test_a_plan_may_go_unrecorded_if_the_bench_file_says_so(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"required": False})
    played.up()
    played.recorders[0].report(recording=False, obstacle="/runs: cannot write there")
    played.step(2)
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate", detach=True)
    for _ in range(12):
        played.recorders[0].report(recording=False, error="/runs: cannot write there")
        played.step(100)
    assert played.supervisor.bench.plans.active
    played.close()


@pytest.mark.parametrize("reports", [True, False])
def test_a_plan_of_which_the_recording_dies_ramps_down_while_the_ring_has_it(
    tmp_path, monkeypatch, reports
):
    played = PlayedDaemon(tmp_path, monkeypatch, loop={"ring_s": 3.0})
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate", detach=True)
    [start] = played.recorders[0].received("start")
    for _ in range(5):  # the recorder ends and comes back, again and again
        played.recorders[0].report(file=f"{start['out']}-000.mcap")
        played.step(1, State.ENABLED)
        played.recorders[0].report(recording=False, error="")
        played.step(140, State.ENABLED)
    played.recorders[0].report(file=f"{start['out']}-000.mcap")
    played.step(1, State.ENABLED)
    if reports:
        played.recorders[0].report(recording=False, error="/runs: gone")
    played.step(149, State.ENABLED)
    assert played.supervisor.bench.plans.view.message == ""
    played.step(4, State.ENABLED)
    view = played.supervisor.bench.plans.view
    assert "not recorded for 1.5 s" in view.message
    assert ("/runs: gone" in view.message) is reports
    played.close()


def test_a_recorder_that_ends_is_started_again_where_it_left_off(played):
    played.up()
    first = played.record()
    played.recorders[0].code = -9
    played.step(1, State.ENABLED)
    assert any("recorder ended: killed by SIGKILL" in m for m in played.messages())
    played.step(30, State.ENABLED)
    [again] = played.recorders[1].received("start")
    assert (again["out"], again["resume"]) == (first["out"], True)
    assert again["first_tick"] == first["first_tick"]
    assert played.state()["processes"]["recorder"]["restarts"] == 1


def test_what_a_recorder_complains_of_is_an_event_once(played):
    played.up()
    for _ in range(3):
        played.recorders[0].report(error="disk full", recording=False)
        played.step()
    assert [m for m in played.messages() if "disk full" in m] == ["the recorder says: disk full"]
    assert played.supervisor.recording.settled


def test_a_loop_that_ends_is_a_fault_and_reset_brings_it_back_off(played):
    played.up()
    played.record()
    played.step(20, State.ENABLED)
    played.loops[0].code = -9
    played.step()
    state = played.state()
    assert state["state"] == "OFF"
    assert state["fault"] == "the loop ended: killed by SIGKILL"
    assert played.recorders[0].received("stop")
    token = played.ask("lease/acquire", holder="anna")["token"]
    resetting = played.bring("reset", token=token)
    played.step(2)
    assert len(played.loops) == 2
    with pytest.raises(RpcError):
        resetting.wait(0)
    assert played.recorders[0].received("start") == []
    played.loops[1].ready()
    played.step(3)
    assert resetting.wait(0).content() == {"state": "OFF"}
    played.step(1, State.ENABLED)
    assert played.recorders[0].received("start")
    played.step(12)
    assert played.state()["fault"] == ""


def test_a_loop_that_does_not_come_up_says_why(played):
    played.supervisor.loop.start(played.now_ns)
    played.loops[0].fail("[bridge] no such port")
    assert not played.supervisor.wait_for_loop(lambda: False)
    assert played.supervisor.bench.loop_fault == "the loop ended: [bridge] no such port"


def test_waiting_for_the_loop_ends_with_a_signal(played):
    played.supervisor.loop.start(played.now_ns)
    assert not played.supervisor.wait_for_loop(lambda: True)


def test_the_end_disables_and_answers_everybody(played):
    played.up()
    played.step(5, State.ENABLED)
    requests = []
    step = played.supervisor.step

    def play_the_loop():
        record = np.zeros(1, played.supervisor.bench.setpoint._record.dtype)
        played.loops[0].mailbox.read(record)
        requests.append(int(record["request"][0]))
        played.now_ns += 10_000_000
        played.loops[0].tick(State.ENABLED if 3 not in requests else State.OFF)
        step()

    played.supervisor.step = play_the_loop
    played.supervisor.ramp_down("SIGTERM")
    assert {2, 3} <= set(requests)
    with pytest.raises(RpcError, match="shutting down"):
        played.bring("enable", token="x")
    played.supervisor.take_down()
    with pytest.raises(RpcError, match="shutting down"):
        played.bring("stop")
    assert played.loops[0].signals == [signal.SIGTERM]
    assert played.recorders[0].signals == [signal.SIGTERM]
    assert "shutting down: SIGTERM" in played.messages()


def test_the_tick_by_which_a_plan_ends_is_part_of_its_recording(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": False})
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate")
    [start] = played.recorders[0].received("start")
    played.step(20)
    played.recorders[0].code = -signal.SIGKILL
    while not played.supervisor.bench.plans.closing:
        played.step(1, State.TRIPPED)
    tripped_at = played.loops[0].number - 1
    while len(played.recorders) == 1:
        played.step(1, State.TRIPPED)
    played.step(1, State.TRIPPED)
    [finish] = played.recorders[1].received("finish")
    assert (finish["out"], finish["newest"]["tick"]) == (start["out"], tripped_at)
    played.close()


def test_how_a_plan_ended_with_the_daemon_is_known_before_the_recorder_ends(played, monkeypatch):
    monkeypatch.setattr(session, "CLOSE_S", 0.0)
    supervisor, plans = played.supervisor, played.supervisor.bench.plans
    played.begin_plan()
    published, at_stop, stop = [], {}, supervisor.children.stop

    def stopped(name, *limit):
        at_stop[name] = plans.view.state
        return stop(name, *limit)

    supervisor.children.stop = stopped
    supervisor.publisher.telemetry.json = lambda name, text: published.append((name, text))
    supervisor.bench.stop("the daemon shut down")
    played.step()
    assert plans.closing
    supervisor.take_down()
    assert (at_stop["loop"], at_stop["recorder"]) == ("ending", "aborted")
    newest = [json.loads(text) for name, text in published if name == "plan"][-1]
    assert newest["state"] == "aborted"
    assert "the daemon shut down; not recorded in full: not closed" in newest["message"]


def test_the_end_waits_a_little_for_the_recording_of_a_plan_and_nobody_is_in_command(played):
    supervisor = played.supervisor
    token, start = played.begin_plan()
    step = supervisor.step

    def play_on():
        played.now_ns += 10_000_000
        played.loops[0].tick(State.OFF)
        if played.recorders[0].received("stop"):
            with pytest.raises(RpcError, match="shutting down"):
                played.bring("enable", token=token)
            played.recorders[0].report(recording=False, closed=[start["out"]])
        step()

    supervisor.step = play_on
    supervisor.ramp_down("SIGTERM")
    assert supervisor.bench.plans.concluded
    assert supervisor.bench.plans.view.state == "aborted"
    assert supervisor.bench.plans.view.recorded


def test_an_installed_calibration_is_in_force_from_the_start(tmp_path, monkeypatch):
    folder = tmp_path / "calibrations" / "played"
    folder.mkdir(parents=True)
    given = calibration()
    given.save(folder / "x.json")
    (folder / "installed").write_text("x.json\n")
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.up()
    assert played.state()["calibration"]["id"] == given.id
    assert played.loops[0].tables.current.parameters["alpha"][0] == pytest.approx(given.alpha)
    assert played.supervisor.bench.setpoint.compensate == COMPENSATE["on"]
    assert played.record()["metadata"]["calibration"] == given.id
    played.close()


def test_an_installed_calibration_that_is_broken_is_reported_and_left_out(tmp_path, monkeypatch):
    folder = tmp_path / "calibrations" / "played"
    folder.mkdir(parents=True)
    (folder / "installed").write_text("gone.json\n")
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.up()
    assert played.state()["calibration"] is None
    assert any("gone.json" in m for m in played.messages())
    played.close()


def test_the_heartbeat_goes_on_whatever_happens(played):
    played.up()
    record = np.zeros(1, played.supervisor.bench.setpoint._record.dtype)
    beats = []
    for _ in range(5):
        played.step()
        assert played.loops[0].mailbox.read(record)
        beats.append(int(record["seq"][0]))
    assert np.diff(beats).tolist() == [1, 1, 1, 1]


def test_a_request_between_two_steps_is_carried_out_at_once(played):
    """The clock stands still until the answer is there; the step is a minute away."""
    played.up()
    step_ns = played.now_ns + 60_000_000_000
    call = Call("config", parse(RPCS["config"], b""))
    call = replace(call, on_reply=lambda outcome: setattr(played, "now_ns", step_ns))
    threading.Timer(0.05, played.supervisor.dispatcher.calls.put, (call,)).start()
    played.supervisor._take_requests_until(step_ns)
    assert call.wait(0).content()["config"]


def test_the_estimator_of_a_plan_lasts_as_long_as_the_plan(played):
    played.up()
    bench = played.supervisor.bench
    assert played.estimators == []
    bench.plans.start(early_end.make(played.config, {}), "anna", "", detached=True)
    played.step(2)
    [estimator] = played.estimators
    [start] = estimator.received()
    assert start["estimator"] == "tests.support.early_end:Estimator"
    known = {"half_widths": {early_end.QUANTITY: 0.5}, "obstacle": "", "captures": 2}
    estimator.send({"run": start["run"], **known})
    played.step(20)
    plan = played.state()["plan"]
    assert (plan["precision"], plan["targets"]) == ({"x_percent": 0.5}, {"x_percent": 0.0})
    assert played.state()["processes"]["estimator"]["running"]
    bench.stop("by a test")
    played.step(20)
    assert estimator.signals == [signal.SIGKILL]
    assert "estimator" not in played.state()["processes"]
    assert not any("estimator" in said for said in played.messages())


def test_the_loss_of_an_estimator_is_an_event_and_the_plan_goes_on(played):
    played.up()
    bench = played.supervisor.bench
    bench.plans.start(early_end.make(played.config, {}), "anna", "", detached=True)
    played.step(2)
    played.estimators[0].code = -signal.SIGKILL
    played.step(20)
    assert (
        "estimator ended: killed by SIGKILL: the plan under way goes on and does not end early"
        in played.messages()
    )
    assert "has ended" in played.state()["plan"]["obstacle"]
    assert bench.plans.active
    assert len(played.estimators) == 1


def test_the_estimator_ends_with_the_daemon(played):
    played.up()
    played.supervisor.bench.plans.start(early_end.make(played.config, {}), "a", "", detached=True)
    played.step(2)
    played.supervisor.take_down()
    assert played.estimators[0].signals == [signal.SIGKILL]


def test_a_calibration_is_tracked_where_that_is_enabled(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, tracking={"enabled": True})
    played.up()
    played.step(20)
    assert (played.trackers, played.state()["tracking"]) == ([], None)
    in_force = played.supervisor.publisher.calibrations
    put_in_force(in_force, calibration())
    played.step(20)
    [tracker] = played.trackers
    [start] = tracker.received()
    assert start["calibration"] == str(in_force.path)
    tracker.send(
        {
            "tracked": {
                "calibration": in_force.current_id(), "t_ns": 1, "turns": 9, "memory_s": 300.0,
                "quantities": [], "unseen": [], "obstacle": "",
            }
        }
    )  # fmt: skip
    played.step(20)
    assert played.state()["tracking"]["turns"] == 9
    played.supervisor.take_down()
    assert tracker.signals == [signal.SIGKILL]
    played.close()


def test_a_calibration_is_not_tracked_unless_that_is_enabled(played):
    played.up()
    put_in_force(played.supervisor.publisher.calibrations, calibration())
    played.step(20)
    assert (played.trackers, played.state()["tracking"]) == ([], None)


def test_what_is_slow_to_load_is_loaded_while_the_loop_starts(tmp_path, monkeypatch):
    loaded = []
    monkeypatch.setattr("motord.service.supervisor.coverage_factor", lambda: loaded.append(1))
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.up()
    assert loaded == [1]
    played.close()
