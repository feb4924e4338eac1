"""What is recorded: a bench while it is powered, and each plan in a recording of its own."""

import json
import signal
from pathlib import Path

import pytest

from motord.api.errors import RpcError
from motord.config.sections import LoopConfig
from motord.recorder.main import DRAIN_S, REPORT_S
from motord.schema import State
from motord.service.recording import session
from tests.unit.service.played_daemon import PlayedDaemon, end_after


def test_a_bench_that_is_not_powered_is_not_recorded(played):
    played.step()
    assert played.state()["fault"] == "the loop is not up yet"
    played.up()
    assert played.state()["fault"] == ""
    assert played.supervisor.recording.settled
    played.wait_s(3.0)
    played.step(50, State.READY)
    assert played.recorders[0].received("start") == []
    assert not played.state()["recording"]["recording"]


def test_a_bench_is_recorded_from_before_it_was_enabled_until_after_it_no_longer_is(played):
    played.up()
    played.wait_s(3.0)
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
    played.wait_s(1.95, State.TRIPPED)  # a trip is no end of interest
    assert played.recorders[0].received("stop") == []
    played.step(1, State.ENABLED)
    played.wait_s(1.95, State.OFF)
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
    played.wait_s(3.0)
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
    played.wait_s(2.1, State.READY)
    assert len(played.recorders[0].received("stop")) == 1


def test_everything_is_recorded_always_if_the_bench_file_says_so(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": "always"})
    played.up()
    [start] = played.recorders[0].received("start")
    assert start["first_tick"] == 0
    played.wait_s(3.0)
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate")
    played.step(2)
    played.ask("stop")
    played.wait_s(3.0)
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


def test_power_in_ticks_that_come_while_the_daemon_ends_is_recorded(played):
    played.up()
    played.step(5)
    loop = played.loops[0]
    loop.wait = lambda timeout=None: loop.tick(State.ENABLED, 20) or 0
    played.supervisor.take_down()
    assert len(played.recorders[0].received("start")) == 1


def test_a_publisher_that_fails_keeps_no_last_ticks_from_the_recording(played, monkeypatch):
    played.up()
    played.step(5)
    loop = played.loops[0]
    loop.wait = lambda timeout=None: loop.tick(State.ENABLED, 20) or 0

    def fail(*_):
        raise OSError("the session is gone")

    monkeypatch.setattr(played.supervisor.publisher, "step", fail)
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
    played.wait_s(8.0)
    token = played.ask("lease/acquire", holder="anna")["token"]
    with pytest.raises(RpcError, match="has not reported for 8 s"):
        played.ask("plan/start", token=token, name="calibrate")


@pytest.mark.parametrize("ring_s", [15.0, 120.0])
def test_the_state_says_that_a_recorder_is_silent(tmp_path, monkeypatch, ring_s):
    """One that was stopped, or whose disk hangs, said last that it records."""
    played = PlayedDaemon(tmp_path, monkeypatch, loop={"ring_s": ring_s})
    played.up()
    played.step(2, State.ENABLED)
    recorder = played.recorders[0]
    recorder.report(ticks=3)
    played.step(12, State.ENABLED)
    assert played.state()["recording"]["error"] == ""
    played.wait_s(8.0, State.ENABLED)
    said = played.state()["recording"]["error"]
    assert said == "the recorder has not reported for 8 s: does the disk answer?"
    recorder.report(ticks=4)
    played.step(12, State.ENABLED)
    assert played.state()["recording"]["error"] == ""
    played.close()


@pytest.mark.parametrize(("ring_s", "silent_s"), [(15.0, 10.0), (8.0, 6.0), (2.0, 4.0)])
def test_a_recorder_that_is_silent_is_ended_while_the_ring_has_what_it_missed(
    tmp_path, monkeypatch, ring_s, silent_s
):
    """With a ring of less than 5 s it is not: one that waits for its disk has 4 s to say so."""
    played = PlayedDaemon(tmp_path, monkeypatch, loop={"ring_s": ring_s})
    played.up()
    played.step(2, State.ENABLED)
    first = played.recorders[0]
    first.report(ticks=3)
    played.wait_s(silent_s - 0.1, State.ENABLED)
    assert first.code is None
    played.step(20, State.ENABLED)
    assert first.code == -signal.SIGKILL
    played.step(20, State.ENABLED)
    assert played.recorders[1].received("start")[0]["resume"]
    assert f"recorder has sent nothing for {silent_s:g} s; it is ended" in played.messages()
    played.close()


def test_a_recorder_that_waits_for_its_disk_is_not_ended(played):
    """It has in memory what the ring may not have any more; it is not relied on, either."""
    played.up()
    played.step(2, State.ENABLED)
    played.recorders[0].report(ticks=3)
    for _ in range(15):
        played.wait_s(1.0, State.ENABLED)
        played.recorders[0].send({"recording": False, "blocked": True})
    assert played.recorders[0].code is None
    view = played.supervisor.recording.view()
    assert view.error == "the recorder has not reported for 15 s: does the disk answer?"
    assert (view.recording, view.detail) == (True, {"ticks": 3})


def started_again(played):
    """Have the recorder end and another one start."""
    played.up()
    played.step(2, State.ENABLED)
    played.recorders[0].report(ticks=3)
    played.step(2, State.ENABLED)
    played.recorders[0].code = -9
    played.step(20, State.ENABLED)


def test_one_that_waits_for_its_disk_since_it_was_started_is_said_too(played):
    started_again(played)
    assert played.state()["recording"]["error"] == ""
    for _ in range(8):
        played.recorders[1].send({"recording": False, "blocked": True})
        played.wait_s(1.0, State.ENABLED)
    said = played.state()["recording"]["error"]
    assert said == "the recorder has not reported for 8 s: does the disk answer?"


def test_one_that_starts_is_not_silent(played):
    started_again(played)
    played.wait_s(8.0, State.ENABLED)
    assert len(played.recorders) == 2
    assert played.state()["recording"]["error"] == ""


def test_a_plan_may_go_unrecorded_if_the_bench_file_says_so(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, recording={"required": False})
    played.up()
    played.recorders[0].report(recording=False, obstacle="/runs: cannot write there")
    played.step(2)
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate", detach=True)
    for _ in range(12):
        played.recorders[0].report(recording=False, error="/runs: cannot write there")
        played.wait_s(1.0)
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
        played.wait_s(1.4, State.ENABLED)
    played.recorders[0].report(file=f"{start['out']}-000.mcap")
    played.step(1, State.ENABLED)
    if reports:
        played.recorders[0].report(recording=False, error="/runs: gone")
    played.wait_s(1.45, State.ENABLED)
    played.step(4, State.ENABLED)
    assert played.supervisor.bench.plans.view.message == ""
    played.step(4, State.ENABLED)
    view = played.supervisor.bench.plans.view
    assert "not recorded for 1.5 s" in view.message
    assert ("/runs: gone" in view.message) is reports
    played.close()


def test_with_the_shortest_ring_a_recorder_reports_often_enough(tmp_path, monkeypatch):
    shortest_s = LoopConfig.model_json_schema()["properties"]["ring_s"]["minimum"]
    played = PlayedDaemon(tmp_path, monkeypatch, loop={"ring_s": shortest_s})
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate", detach=True)
    [start] = played.recorders[0].received("start")
    for _ in range(8):
        played.recorders[0].report(file=f"{start['out']}-000.mcap")
        played.wait_s(REPORT_S + DRAIN_S, State.ENABLED)
    assert played.supervisor.bench.plans.view.message == ""
    played.close()


def _suspended_in_a_plan(played):
    """Start a plan that is recorded, and let nothing run for longer than its ring reaches back."""
    played.up()
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.ask("plan/start", token=token, name="calibrate", detach=True)
    [start] = played.recorders[0].received("start")
    played.recorders[0].report(file=f"{start['out']}-000.mcap")
    played.step(2, State.ENABLED)
    played.now_ns += round(1e9 * played.config.loop.ring_s)


def test_a_plan_is_not_ended_for_a_recorder_that_was_not_listened_to(played):
    """As after Ctrl-Z and fg: what the plan ends by is that the bench was not commanded."""
    _suspended_in_a_plan(played)
    played.step(2, State.ENABLED)
    assert played.supervisor.bench.plans.view.recorded
    assert played.supervisor.bench.plans.view.message == ""
    assert played.state()["recording"]["error"] == ""
    gap = f"the supervisor did not run for {played.config.loop.ring_s:.1f} s"
    assert f"{gap}: without it the loop takes the current away" in played.messages()
    played.step(2, State.READY)
    said = played.supervisor.bench.plans.view.message
    assert said == "the bench was disabled or stopped"


def test_a_recorder_that_does_not_report_after_a_suspension_either_ends_the_plan(played):
    _suspended_in_a_plan(played)
    played.wait_s(played.config.loop.ring_s / 2 + 1.1, State.ENABLED)
    assert "not recorded for" in played.supervisor.bench.plans.view.message


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
