"""The queue of plans on the virtual bench."""

import json
import time

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.api.queue_messages import QueueWait
from motord.schema import TICK_DTYPE
from motord.service.build import channel_value, show_interrupted_plan
from motord.service.plans.journal_file import Journal
from motord.service.queue import attempt
from motord.service.queue.attempt import WaitFailedError, Waits, due
from motord.service.queue.plan_queue import PlanQueue
from motord.service.queue.queue_file import QueueFile
from tests.unit.service.virtual_service import VirtualService

SHORT = {
    "torques_Nm": [2.0], "speeds_Hz": [1.8, 2.0], "turns": 2, "settle_s": 0.1, "gain_steps": [],
}  # fmt: skip
GOOD = {"name": "calibrate", "settings": {**SHORT, "speeds_Hz": [1.0], "settle_s": 0.1}}
BAD = {"name": "calibrate", "settings": {**SHORT, "settle_timeout_s": 0.05}}


@pytest.fixture
def service():
    return VirtualService()


def add(service, token, *plans):
    return service.ask("queue/add", token=token, plans=plans)["added"]


def until(service, token, condition, limit_s=120.0):
    for _ in range(round(limit_s / 0.1)):
        if condition():
            return
        service.run_s(0.1, token)
    raise AssertionError(f"not reached: {service.bench.queue} {service.bench.plans.view}")


def paused(service, token):
    until(service, token, lambda: not service.bench.queue.active)
    return service.bench.queue


def runs(service):
    return [(run.id, run.state, run.kept) for run in service.queue.queue.history]


def refused(service, name, /, **arguments):
    with pytest.raises(RpcError) as caught:
        service.ask(name, **arguments)
    return caught.value


def test_plans_run_one_after_the_other_and_the_queue_is_paused_in_the_end(service):
    token = service.acquire()
    assert add(service, token, GOOD, {**GOOD, "notes": "second"}) == [1, 2]
    answer = service.ask("queue/start", token=token, detach=True)
    assert (answer["queue"]["state"], answer["queue"]["length"]) == ("waiting", 2)
    until(service, token, lambda: service.bench.plans.active)
    view = service.bench.queue
    assert (view.state, view.running, view.next, view.next_plan) == ("running", 1, 2, "calibrate")
    assert 0 < view.eta_s < 60
    assert service.bench.plans.detached
    end = paused(service, token)
    assert (end.message, end.length, end.done, end.failed) == ("all plans have been run", 0, 2, 0)
    assert runs(service) == [(1, "done", False), (2, "done", False)]
    [first, second] = service.queue.queue.history
    assert first.recording == "/runs/calibrate.mcap"
    assert first.began_ns < first.ended_ns <= second.began_ns
    assert [notes for _, _, notes in service.sink.started] == ["", "second"]
    assert "queue: started by anna, detached" in service.messages()


@pytest.mark.parametrize(
    ("policy", "expected", "left"),
    [
        ({"on_failure": "stop"}, [(1, "done", False), (2, "failed", True)], [2, 3]),
        ({"on_failure": "skip"},
         [(1, "done", False), (2, "failed", False), (3, "done", False)], []),
        ({"on_failure": "retry", "retries": 2},
         [(1, "done", False), *[(2, "failed", True)] * 3], [2, 3]),
    ],
)  # fmt: skip
def test_what_happens_after_a_failure(service, policy, expected, left):
    token = service.acquire()
    add(service, token, GOOD, {**BAD, **policy}, GOOD)
    service.ask("queue/start", token=token)
    end = paused(service, token)
    assert runs(service) == expected
    assert [item.id for item in service.queue.queue.items] == left
    assert ("the speed was still" in end.message) == bool(left)
    assert end.failed == sum(state == "failed" for _, state, _ in expected)


def test_a_run_that_failed_goes_on_with_the_rest_if_it_is_tried_again(service):
    token = service.acquire()
    add(service, token, {"name": "calibrate", "settings": SHORT})
    service.ask("queue/start", token=token)
    until(service, token, lambda: len(service.sink.points) == 1)
    service.ask("plan/abort", token=token)
    end = paused(service, token)
    assert end.message == "1 (calibrate) aborted: aborted by anna"
    service.ask("queue/start", token=token)
    paused(service, token)
    assert runs(service) == [(1, "aborted", True), (1, "done", False)]
    assert [point["index"] for point in service.sink.points] == [0, 1]
    service.ask("queue/list")


@pytest.mark.parametrize("how", ["stop", "trip", "lease"])
def test_what_is_no_failure_of_the_plan_pauses_the_queue_whatever_its_policy(service, how):
    token = service.acquire()
    add(service, token, {**GOOD, "on_failure": "skip"}, GOOD)
    service.ask("queue/start", token=token)
    until(service, token, lambda: service.bench.plans.active)
    service.run_s(1.0, token)
    if how == "stop":
        service.ask("stop", by="ben")
    elif how == "trip":
        service.loop.virtual._tables[0]["bus_V_min"] = 29.0
        service.run_s(1.0, token)
    else:
        service.ask("lease/release", token=token)
    service.run_s(5.0)
    assert not service.bench.queue.active
    assert not service.bench.plans.active
    assert [item.id for item in service.queue.queue.items] == [1, 2]
    assert len(service.sink.started) == 1
    if how == "trip":
        assert refused(service, "queue/start", token=service.acquire()).code == "tripped"


def test_a_queue_that_waits_is_ended_by_stop_and_by_the_loss_of_the_lease(service):
    for how in ("stop", "lease"):
        token = service.acquire("anna", force=True)
        service.channels["winding"] = 60.0
        add(service, token, {**GOOD, "wait": [{"channel": "winding", "below": 40}]})
        service.ask("queue/start", token=token)
        service.run_s(1.0, token)
        assert service.bench.queue.message == "waits for winding below 40; it is 60"
        if how == "stop":
            service.ask("stop")
        service.run_s(0.2 if how == "stop" else 5.0)  # and the lease has run out
        assert not service.bench.queue.active
    assert not service.sink.started


def test_a_detached_queue_waits_without_a_lease_and_keeps_others_off(service):
    token = service.acquire()
    service.channels["winding"] = 60.0
    add(service, token, {**GOOD, "wait": [{"channel": "winding", "below": 40}]})
    service.ask("queue/start", token=token, detach=True)
    service.ask("lease/release", token=token)
    service.run_s(1.0)
    assert service.bench.commander(service.now_ns) == "queue"
    ben = service.acquire("ben")
    for name, arguments in (("enable", {}), ("set", {"torque_Nm": 1.0}), ("plan/start", GOOD)):
        error = refused(service, name, token=ben, **arguments)
        assert error.code == "plan_running"
        assert "motord queue pause" in error.message
    service.ask("lease/release", token=ben)
    service.channels["winding"] = 39.0
    service.run_s(0.5)
    assert service.bench.plans.detached
    until(service, None, lambda: not service.bench.queue.active)
    assert runs(service) == [(1, "done", False)]


def test_a_channel_without_a_value_is_named_and_fails_the_wait(service):
    token = service.acquire()
    plan = {**GOOD, "wait": [{"channel": "winding", "below": 40}]}
    error = refused(service, "queue/add", token=token, plans=[GOOD, plan])
    assert error.message.startswith("plan 2, calibrate: channel 'winding' has no valid value")
    assert service.bench.queue.length == 0
    service.channels["winding"] = 60.0
    add(service, token, plan)
    service.ask("queue/start", token=token)
    service.run_s(1.0, token)
    del service.channels["winding"]
    service.run_s(9.0, token)
    assert service.bench.queue.active
    end = (service.run_s(3.0, token), service.bench.queue)[1]
    assert not end.active
    assert "failed: channel 'winding' has no valid value" in end.message


@pytest.mark.parametrize(
    ("serial", "expected"),
    [
        ("other", "plan 1, calibrate: [motor] serial of the bench file is 'sim-1', not 'other'"),
        ("sim\n1", "serial: the serial number has characters that cannot be printed"),
        ("", "serial: the serial number is empty"),
    ],
)
def test_a_serial_number_that_cannot_be_is_not_added(service, serial, expected):
    plans = [{**GOOD, "serial": serial}]
    error = refused(service, "queue/add", token=service.acquire(), plans=plans)
    assert expected in error.message
    assert service.bench.queue.length == 0


def test_a_plan_for_a_motor_that_the_bench_file_no_longer_names_does_not_begin(service):
    token, bench = service.acquire(), service.bench
    add(service, token, {**GOOD, "serial": "sim-1"})
    other = bench.config.motor.model_copy(update={"serial": "sim-2"})
    bench.config = bench.config.model_copy(update={"motor": other})
    service.ask("queue/start", token=token)
    end = paused(service, token)
    assert "1 (calibrate) was not started: [motor] serial of the bench file" in end.message
    assert not service.sink.started


def test_plans_are_checked_whole_before_any_is_added(service):
    token = service.acquire()
    beyond = {"name": "calibrate", "settings": {"torques_Nm": [400.0]}}
    error = refused(service, "queue/add", token=token, plans=[GOOD, beyond])
    assert error.message.startswith("plan 2, calibrate: ")
    assert error.message.endswith("nothing was added")
    error = refused(service, "queue/add", token=token, plans=[{"name": "verify"}])
    assert "no calibration is installed" in error.message
    assert service.bench.queue.length == 0


def test_pause_lets_the_plan_end_and_pause_now_does_not(service):
    token = service.acquire()
    add(service, token, GOOD, GOOD, GOOD)
    service.ask("queue/start", token=token)
    until(service, token, lambda: service.bench.plans.active)
    assert service.ask("queue/pause", token=token)["queue"]["state"] == "pausing"
    assert paused(service, token).message == "by anna"
    assert runs(service) == [(1, "done", False)]
    service.ask("queue/start", token=token)
    until(service, token, lambda: service.bench.plans.active)
    answer = service.ask("queue/pause", token=token, now=True)
    assert (answer["queue"]["state"], answer["queue"]["running"]) == ("paused", 2)
    until(service, token, lambda: service.bench.plans.view.state == "paused")
    assert refused(service, "queue/remove", token=token, ids=[2]).code == "refused"
    service.ask("queue/start", token=token)
    paused(service, token)
    assert runs(service)[1:] == [(2, "done", False), (3, "done", False)]
    assert len(service.sink.started) == 3


def test_a_queue_is_not_started_on_a_bench_that_is_enabled_and_stops_what_turns(service):
    token = service.enabled()
    add(service, token, GOOD)
    error = refused(service, "queue/start", token=token)
    assert error.message.startswith("disable the bench first")
    service.ask("disable", token=token)
    service.bench.setpoint.drive_Hz = 0.5
    service.ask("queue/start", token=token)
    assert service.bench.setpoint.drive_Hz == 0.0


def test_a_queue_that_is_started_again_detached_goes_on_without_the_lease(service):
    token = service.acquire()
    add(service, token, GOOD)
    service.ask("queue/start", token=token)
    until(service, token, lambda: service.bench.plans.active)
    service.ask("queue/pause", token=token, now=True)
    service.ask("queue/start", token=token, detach=True)
    service.ask("queue/start", token=token)  # to follow it
    service.ask("lease/release", token=token)
    until(service, None, lambda: not service.bench.queue.active)
    assert runs(service) == [(1, "done", False)]


def test_the_queue_is_edited_while_it_runs_but_for_the_item_under_way(service):
    token = service.acquire()
    add(service, token, GOOD, GOOD, GOOD, GOOD)
    service.ask("queue/start", token=token)
    until(service, token, lambda: service.bench.plans.active)
    items = service.ask("queue/move", token=token, id=4, position=1)["items"]
    assert [item["id"] for item in items] == [1, 4, 2, 3]
    service.ask("queue/remove", token=token, ids=[2, 3])
    for name, arguments in (("move", {"id": 1, "position": 2}), ("remove", {"ids": [1]})):
        error = refused(service, f"queue/{name}", token=token, **arguments)
        assert "1: calibrate is under way" in error.message
    assert refused(service, "queue/remove", token=token, ids=[9]).message == "not in the queue: 9"
    paused(service, token)
    assert runs(service) == [(1, "done", False), (4, "done", False)]


def test_editing_needs_the_lease_and_looking_does_not(service):
    for name, arguments in (
        ("add", {"plans": [GOOD]}), ("move", {"id": 1, "position": 1}), ("remove", {"ids": [1]}),
        ("start", {}), ("pause", {}),
    ):  # fmt: skip
        assert refused(service, f"queue/{name}", token="x", **arguments).code == "no_lease"
    token = service.acquire()
    assert refused(service, "queue/start", token=token).message.startswith("the queue is empty")
    assert service.ask("queue/list")["items"] == []


def test_a_start_that_is_refused_for_long_pauses_the_queue_and_loses_nothing(service, monkeypatch):
    monkeypatch.setattr(attempt, "REFUSED_NS", 5_000_000_000)
    token = service.acquire()
    service.plans.unrecordable = lambda: "the disk is full"
    add(service, token, {**GOOD, "on_failure": "skip"})
    service.ask("queue/start", token=token)
    service.run_s(4.5, token)
    assert "waits for its start: it could not be recorded" in service.bench.queue.message
    service.plans.unrecordable = str
    until(service, token, lambda: service.bench.plans.active)
    service.ask("plan/abort", token=token)
    paused(service, token)
    service.plans.unrecordable = lambda: "the disk is full"
    service.ask("queue/start", token=token)
    service.run_s(6.5, token)
    end = service.bench.queue
    assert not end.active
    assert "was not started: it could not be recorded: the disk is full" in end.message
    assert [item.state for item in service.queue.queue.items] == ["aborted"]


class Days:
    """One daemon after the other with the same queue and the same journal."""

    def __init__(self, folder):
        self.queue, self.journal = folder / "sim.queue.json", folder / "sim.jsonl"

    def daemon(self):
        journal = Journal(self.journal)
        service = VirtualService(journal=journal, queue_file=QueueFile(self.queue))
        show_interrupted_plan(journal, service.resumption, service.bench)
        service.queue.load()
        return service

    def crash(self, service):
        service.journal.settle()
        service.queue.file.settle()


def test_after_a_crash_the_queue_is_paused_and_goes_on_with_what_is_missing(tmp_path):
    days = Days(tmp_path)
    first = days.daemon()
    token = first.acquire()
    add(first, token, {"name": "calibrate", "settings": SHORT}, {**GOOD, "serial": "sim-1"})
    first.ask("queue/start", token=token, detach=True)
    until(first, token, lambda: len(first.sink.points) == 1)
    days.crash(first)
    again = days.daemon()
    again.run_s(0.5)
    queue = again.bench.queue
    assert (queue.state, queue.length, queue.next) == ("paused", 2, 1)
    assert not again.sink.started
    assert [item.state for item in again.queue.queue.items] == ["interrupted", "queued"]
    token = again.acquire()
    again.ask("queue/start", token=token)
    paused(again, token)
    assert runs(again) == [(1, "interrupted", True), (1, "done", False), (2, "done", False)]
    assert [point["index"] for point in again.sink.points] == [1, 0]
    assert again.bench.plans.view.serial == "sim-1"  # of the second
    days.crash(again)
    assert days.daemon().bench.queue.length == 0


def test_a_plan_that_is_interrupted_and_not_the_first_of_the_queue_comes_first(tmp_path):
    days = Days(tmp_path)
    first = days.daemon()
    token = first.acquire()
    add(first, token, {"name": "calibrate", "settings": SHORT}, GOOD)
    first.ask("queue/start", token=token)
    until(first, token, lambda: len(first.sink.points) == 1)
    days.crash(first)
    again = days.daemon()
    token = again.acquire()
    again.ask("queue/move", token=token, id=1, position=2)
    error = refused(again, "queue/start", token=token)
    assert "motord plan discard" in error.message
    again.ask("plan/discard", token=token)
    again.ask("queue/start", token=token)
    paused(again, token)
    assert "1 (calibrate) is run from its beginning" in "".join(again.messages())
    assert runs(again)[1:] == [(2, "done", False), (1, "done", False)]


@pytest.mark.parametrize(
    "content",
    [
        b"", b'{"format": 1, "items": [', b"\xff\xfe", b'{"format": 2}', b"[]",
        b'{"next_id": 1, "items": [{"id": 5, "plan": {"name": "x"}, "estimate_s": 1}]}',
    ],
)  # fmt: skip
def test_a_file_that_makes_no_sense_is_set_aside_and_named(tmp_path, content):
    days = Days(tmp_path)
    days.queue.write_bytes(content)
    service = days.daemon()
    [aside] = tmp_path.glob("sim.queue.json.unreadable-*")
    assert aside.read_bytes() == content
    assert f"was set aside as {aside.name}" in "".join(service.messages())
    token = service.acquire()
    assert add(service, token, GOOD) == [1]
    days.crash(service)
    assert days.daemon().bench.queue.length == 1


def test_what_the_disk_does_not_hold_is_not_added_and_not_begun(tmp_path):
    days = Days(tmp_path)
    service = days.daemon()
    token = service.acquire()
    add(service, token, GOOD)
    days.crash(service)
    before = days.queue.read_bytes()
    days.queue.unlink()
    days.queue.mkdir()
    (days.queue / "in the way").touch()
    error = refused(service, "queue/add", token=token, plans=[GOOD])
    assert error.code == "failed"
    assert error.message.startswith("nothing was added: ")
    assert service.events.recent()[-1].message == error.message
    service.queue.file.settle()
    service.step()
    assert service.bench.queue.length == 1
    service.ask("queue/start", token=token)
    for _ in range(10):
        service.queue.file.settle()
        service.run_s(0.1, token)
    assert "the queue cannot be written" in service.bench.queue.message
    assert not service.sink.started
    (days.queue / "in the way").unlink()
    days.queue.rmdir()
    days.queue.write_bytes(before)
    assert days.daemon().bench.queue.length == 1


def test_a_queue_of_this_format_stays_readable():
    old = {
        "format": 1, "next_id": 4, "items": [
            {"id": 2, "plan": {"name": "calibrate", "wait": [{"until": "06:00"}]},
             "estimate_s": 60.0, "state": "interrupted", "run_id": "r"},
        ],
        "history": [{"id": 1, "plan": "cogging", "state": "done", "ended_ns": 7}],
    }  # fmt: skip
    queue = PlanQueue.model_validate_json(json.dumps(old))
    assert (queue.items[0].plan.wait[0].until, queue.history[0].state) == ("06:00", "done")


@pytest.fixture
def central_europe(monkeypatch):
    monkeypatch.setenv("TZ", "Europe/Zurich")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


HOUR_NS = 3_600_000_000_000
MIDNIGHT_NS = 1_767_222_000 * 1_000_000_000  # 2026-01-01 00:00 in Zurich


@pytest.mark.parametrize(
    ("until", "hour", "expected"),
    [("06:00", 5.0, 6.0), ("06:00", 6.0, 30.0), ("06:00", 7.5, 30.0), ("00:00", 23.9, 24.0)],
)
def test_a_time_of_day_is_the_next_one(central_europe, until, hour, expected):
    turn_ns = MIDNIGHT_NS + round(hour * HOUR_NS)
    assert due(until, turn_ns) == MIDNIGHT_NS + round(expected * HOUR_NS)


def test_waits_come_one_after_the_other_each_with_its_limit(central_europe):
    value = {"winding": 50.0}
    waits = (
        QueueWait(channel="winding", below=40.0, limit_s=100.0),
        QueueWait(until="06:00"),
        QueueWait(channel="winding", above=30.0, limit_s=10.0),
    )
    begun_ns = MIDNIGHT_NS + 5 * HOUR_NS
    waiting = Waits(waits, begun_ns)

    def over(seconds):
        return waiting.over(round(seconds * 1e9), begun_ns + round(seconds * 1e9), value.get)

    assert not over(0.0)
    assert waiting.message == "waits for winding below 40; it is 50"
    assert waiting.left_s(begun_ns) == 3600.0
    assert not over(99.9)
    value["winding"] = 20.0
    assert not over(99.95)
    assert waiting.message == "waits until Thu 01 Jan 06:00"
    assert not over(3600.0 - 1e-3)
    assert not over(3600.0)
    assert not over(3609.9)
    with pytest.raises(WaitFailedError, match=r"waited 10 s in vain: waits for winding above 30"):
        over(3610.0)


@pytest.mark.parametrize(
    "wait",
    [
        {}, {"channel": "w"}, {"below": 1.0}, {"channel": "w", "below": 1.0, "above": 0.0},
        {"until": "6:00"}, {"until": "24:00"}, {"until": "06:00", "channel": "w", "below": 1.0},
        {"until": "06:00", "limit_s": 0.0}, {"channel": "w", "below": float("nan")},
    ],
)  # fmt: skip
def test_a_wait_has_one_condition(wait):
    with pytest.raises(ValueError):
        QueueWait.model_validate(wait)


def test_the_queue_waits_for_temperatures_of_the_tick_too(service):
    value_of = channel_value(service.bench)
    service.bench.monitor.last = None
    assert value_of("temperature_C") is None
    service.bench.monitor.last = tick = np.zeros(1, TICK_DTYPE)[0]
    tick["temperature_C"], tick["brake_temperature_C"] = 41.5, np.nan
    assert value_of("temperature_C") == 41.5
    assert value_of("brake_temperature_C") is None
    assert value_of("winding_C") is None
