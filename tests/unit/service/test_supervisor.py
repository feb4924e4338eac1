"""The supervisor: the end of its loop, its recorder or the daemon, requests and heartbeats."""

import signal
import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.api.requests import RPCS, parse
from motord.schema import Request, State
from motord.service.daemon import StopSignal, supervise
from motord.service.rpc.dispatcher import Call
from tests.unit.service.played_daemon import PlayedDaemon, end_after


def test_every_rpc_has_a_handler(played):
    assert played.supervisor.dispatcher.handlers.keys() == RPCS.keys()


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


def test_a_trip_in_the_last_ticks_of_a_loop_is_reported_and_nothing_of_them_stays(played):
    played.up()
    played.step(5)
    end_after(played.loops[0], State.TRIPPED)
    played.step()
    trip, fault = played.messages()[-2:]
    assert "TRIPPED" in trip
    assert fault == "the loop ended: killed by SIGKILL"
    assert played.supervisor.bench.monitor.last is None


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
    assert state["remedy"] == "`motord reset` starts the loop again"
    assert played.recorders[0].received("stop")
    token = played.ask("lease/acquire", holder="anna")["token"]
    resetting = played.bring("reset", token=token)
    played.step(2)
    assert len(played.loops) == 2
    assert played.state()["remedy"] == ""
    with pytest.raises(RpcError):
        resetting.wait(0)
    assert played.recorders[0].received("start") == []
    played.loops[1].ready()
    played.step(3)
    assert resetting.wait(0).content() == {"state": "OFF"}
    played.step(1, State.ENABLED)
    assert played.recorders[0].received("start")
    played.step(12)
    assert (played.state()["fault"], played.state()["remedy"]) == ("", "")


def test_a_loop_that_does_not_come_up_says_why(played):
    played.supervisor.loop.start(played.now_ns)
    played.loops[0].fail("[bridge] no such port")
    assert not played.supervisor.wait_for_loop(lambda: False)
    assert played.supervisor.bench.loop.fault == "the loop ended: [bridge] no such port"


def test_waiting_for_the_loop_ends_with_a_signal(played):
    played.supervisor.loop.start(played.now_ns)
    assert not played.supervisor.wait_for_loop(lambda: True)


def test_a_bench_is_ramped_down_also_if_no_recorder_has_come_up_yet(played):
    played.supervisor.start()
    played.loops[0].ready()
    played.step(5, State.ENABLED)
    requests = requests_of_a_loop_that_obeys(played)
    supervise(played.supervisor, StopSignal("SIGTERM"), pytest.fail)
    assert {Request.DISABLE, Request.STOP} <= set(requests)


def requests_of_a_loop_that_obeys(played):
    """Let the loop be played with each step; return the requests that it reads by then."""
    requests = []
    step = played.supervisor.step

    def play_the_loop():
        record = np.zeros(1, played.supervisor.bench.setpoint._record.dtype)
        played.loops[0].mailbox.read(record)
        requests.append(int(record["request"][0]))
        played.now_ns += 10_000_000
        played.loops[0].tick(State.ENABLED if Request.STOP not in requests else State.OFF)
        step()

    played.supervisor.step = play_the_loop
    return requests


def test_the_end_disables_and_answers_everybody(played):
    played.up()
    played.step(5, State.ENABLED)
    requests = requests_of_a_loop_that_obeys(played)
    played.supervisor.ramp_down("SIGTERM")
    assert {Request.DISABLE, Request.STOP} <= set(requests)
    with pytest.raises(RpcError, match="shutting down"):
        played.bring("enable", token="x")
    played.supervisor.take_down()
    with pytest.raises(RpcError, match="shutting down"):
        played.bring("stop")
    assert played.loops[0].signals == [signal.SIGTERM]
    assert played.recorders[0].signals == [signal.SIGTERM]
    assert "shutting down: SIGTERM" in played.messages()


def test_a_loop_that_does_not_ramp_down_is_not_waited_for_however_slow_ramps_are(
    tmp_path, monkeypatch
):
    """Down to zero they take a second at most, and the service manager gives the daemon 20 s."""
    daemon = PlayedDaemon(tmp_path, monkeypatch, limits={"torque_rate_Nm_per_s": 0.01})
    daemon.up()
    daemon.step(5, State.ENABLED)
    step = daemon.supervisor.step

    def play_a_loop_that_goes_on():
        daemon.now_ns += 10_000_000
        daemon.loops[0].tick(State.ENABLED)
        step()

    daemon.supervisor.step, begun_ns = play_a_loop_that_goes_on, daemon.now_ns
    daemon.supervisor.ramp_down("SIGTERM")
    assert daemon.now_ns - begun_ns < 10e9
    daemon.close()


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


def test_a_part_ends_errors_and_nothing_else(played):
    guard = played.supervisor.guard
    with pytest.raises(KeyboardInterrupt), guard.part("queue", 0):
        raise KeyboardInterrupt
    assert guard.faults == {}
    with guard.part("queue", 0):
        raise OSError("no disk")
    assert guard.faults["queue"].startswith("queue: no disk; ")
    with guard.part("queue", 0):
        pass
    assert guard.faults == {}


def test_a_daemon_loads_nothing_that_reads_or_writes_recordings():
    """Some 0.04 s of its start; the recorder does both, and a plan that is resumed reads."""
    heavy = {"mcap", "google.protobuf", "zstandard", "lz4"}
    script = f"import sys, motord.service.daemon\nprint({heavy} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


def test_a_daemon_needs_no_scipy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.special", None)  # 0.15 s of its start
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.up()
    played.close()
