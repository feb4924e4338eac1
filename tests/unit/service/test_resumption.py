"""Plans that go on after the daemon has died, on the virtual bench."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from motord.api.errors import RpcError
from motord.api.requests import PLAN_RESUME, parse
from motord.config import ChannelConfig, Config, load
from motord.config.experiments import plan_kinds
from motord.experiments.plans import build
from motord.recording.file_names import part_of
from motord.recording.writer import RunWriter
from motord.schema import Compensate, Request
from motord.service.build import show_interrupted_plan
from motord.service.plans import recorded_points
from motord.service.plans.journal import JournalSegment
from motord.service.plans.journal_file import Journal
from motord.service.plans.recorded_points import recorded
from motord.service.plans.resume import MAY_CHANGE, bench_parts
from motord.service.rpc.dispatcher import Call
from tests.unit.recording.runs import METADATA, START_NS, tick_block
from tests.unit.service.virtual_service import VirtualService

SHORT = {
    "torques_Nm": [2.0], "speeds_Hz": [1.8, 1.9, 2.0], "turns": 2, "settle_s": 0.1,
    "gain_steps": [],
}  # fmt: skip


class Days:
    """One daemon after the other with the same journal."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "sim.jsonl"

    def daemon(self, calibration_id="", **changes):
        journal = Journal(self.path)
        service = VirtualService(journal=journal, **changes)
        service.calibration_id = calibration_id
        show_interrupted_plan(journal, service.resumption, service.bench)
        return service

    def crash(self, service):
        """What the daemon did so far is on the disk; it does no more."""
        service.journal.settle()


@pytest.fixture
def days(tmp_path):
    return Days(tmp_path)


def start(service, token, **more):
    return service.ask("plan/start", token=token, name="calibrate", settings=SHORT, **more)


def until(service, token, condition, limit_s=120.0):
    for _ in range(round(limit_s / 0.1)):
        if condition():
            return
        service.run_s(0.1, token)
    raise AssertionError(f"not reached: {service.bench.plans.view}")


def interrupted(days, points=1, **changes):
    """Let a daemon take `points` of three points and die."""
    service = days.daemon(**changes)
    token = service.acquire()
    start(service, token, notes="by night", serial="sim-1")
    until(service, token, lambda: len(service.sink.points) == points)
    days.crash(service)
    return service


def refused(service, name, /, **arguments):
    with pytest.raises(RpcError) as caught:
        service.ask(name, **arguments)
    assert caught.value.code == "refused"
    return caught.value.message


def run_to_end(service, token):
    until(service, token, lambda: service.bench.plans.concluded)
    return service.bench.plans.view


def test_a_plan_goes_on_with_what_is_missing(days):
    first = interrupted(days)
    first.journal.point({**first.sink.points[0], "index": 1, "quality": "noisy"})
    days.crash(first)
    again = days.daemon()
    view = again.bench.plans.view
    assert (view.state, view.over, view.points_done, view.points) == ("interrupted", True, 1, 3)
    assert view.serial == "sim-1"
    assert "interrupted with 1 of 3 points taken; motord plan resume" in again.messages()[-1]
    assert view.run_id == first.bench.plans.view.run_id != ""
    assert [p.state for p in again.bench.plans.mesh.points] == ["done", "planned", "planned"]
    token = again.acquire()
    answer = again.ask("plan/resume", token=token)
    assert (answer["state"], answer["points_done"], answer["points"]) == ("running", 1, 3)
    first_error = first.sink.points[0]["rms_error_percent"]
    shown = again.bench.plans.mesh.points
    assert [p.state for p in shown] == ["done", "planned", "planned"]
    assert (shown[0].takes, shown[0].rms_error_percent) == (1, first_error)
    assert [(p.takes, p.quality) for p in shown[1:]] == [(1, "noisy"), (0, "")]
    view = run_to_end(again, token)
    assert (view.state, view.points_done, view.points) == ("done", 3, 3)
    assert [p.state for p in again.bench.plans.mesh.points] == ["done"] * 3
    assert again.bench.plans.mesh.run_id == view.run_id
    assert [p["index"] for p in [*first.sink.points, *again.sink.points]] == [0, 1, 2]
    assert view.run_id == first.bench.plans.view.run_id
    [(plan, started, notes)] = again.sink.started
    assert [point.index for point in plan.points] == [1, 2]
    assert (started.continues, started.serial, notes) == (
        *("/runs/calibrate.mcap", "sim-1", "by night"),
    )
    again.journal.settle()
    third = days.daemon()
    assert third.bench.plans.view is None
    start(third, third.acquire())


def test_it_may_be_interrupted_more_than_once(days):
    taken = [interrupted(days).sink.points]
    for _ in range(2):
        service = days.daemon()
        token = service.acquire()
        service.ask("plan/resume", token=token, detach=True)
        assert service.bench.plans.detached
        until(service, token, lambda s=service: s.sink.points)
        days.crash(service)
        taken.append(service.sink.points[:1])
    assert [[p["index"] for p in points] for points in taken] == [[0], [1], [2]]


def test_with_an_interrupted_plan_no_other_begins_until_it_is_discarded(days):
    interrupted(days)
    service = days.daemon()
    token = service.acquire()
    message = refused(
        service, "plan/start", token=token, name="calibrate", settings=SHORT
    )  # fmt: skip
    assert "1 of 3 points taken; motord plan resume takes the rest, motord plan discard" in message
    assert service.ask("plan/start", name="calibrate", settings=SHORT, dry_run=True)
    assert service.ask("plan/discard", token=token) == {"plan": "calibrate"}
    assert service.bench.plans.view is None
    assert service.bench.plans.mesh is None
    assert "interrupted" in refused(service, "plan/resume", token=token)
    assert "no interrupted plan" in refused(service, "plan/discard", token=token)
    days.crash(service)
    service = days.daemon()
    assert service.bench.plans.view is None
    token = service.acquire()
    start(service, token)
    with pytest.raises(RpcError, match="abort it first"):
        service.ask("plan/discard", token=token)


@pytest.mark.parametrize("how", ["plan/abort", "stop"])
def test_a_plan_that_was_aborted_can_go_on_too_but_stands_in_nobodys_way(days, how):
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: service.sink.points)
    service.ask(how, **({"token": token} if how == "plan/abort" else {}))
    run_to_end(service, token)
    service.run_s(1.0, token)
    assert not service.resumption.interrupted
    service.ask("plan/resume", token=token)
    assert run_to_end(service, token).state == "done"
    assert [p["index"] for p in service.sink.points] == [0, 1, 2]


def test_a_daemon_that_was_shut_down_over_a_plan_says_how_it_can_go_on(days):
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: service.sink.points)
    service.bench.stop("the daemon shut down")
    days.crash(service)
    again = days.daemon()
    view = again.bench.plans.view
    assert (view.state, view.points_done) == ("aborted", 1)
    assert view.message.startswith(
        "calibrate was aborted (the daemon shut down) with 1 of 3 points taken; motord plan resume"
    )
    token = again.acquire()
    start(again, token)  # it stands in nobody's way


def test_commands_need_the_lease(days):
    interrupted(days)
    service = days.daemon()
    for name in ("plan/resume", "plan/discard"):
        with pytest.raises(RpcError) as caught:
            service.ask(name, token="guess")
        assert caught.value.code == "no_lease"
    assert service.resumption.interrupted


def test_on_another_bench_it_does_not_go_on_and_the_change_is_named(days):
    interrupted(days)
    service = days.daemon(limits={"trip_current_A": 41.0}, plans={})
    message = refused(service, "plan/resume", token=service.acquire())
    assert "[limits] of the bench file changed" in message
    faster = days.daemon(loop={"rate_Hz": 2000})
    assert "[loop]" in refused(faster, "plan/resume", token=faster.acquire())
    sensor = ChannelConfig.model_validate(
        {"name": "winding_C", "unit": "degC", "source": {"driver": "simulated"}}
    )
    measured = days.daemon(bench_config=load().model_copy(update={"channels": (sensor,)}))
    assert "[channels]" in refused(measured, "plan/resume", token=measured.acquire())


def test_what_does_not_matter_to_a_plan_may_change(days):
    interrupted(days)
    service = days.daemon(bench={"notes": "new"}, recording={"chunk_s": 0.5}, zenoh={"lease_s": 3})
    service.ask("plan/resume", token=service.acquire())


def test_with_another_calibration_it_does_not_go_on(days):
    interrupted(days)
    service = days.daemon(calibration_id="c2")
    message = refused(service, "plan/resume", token=service.acquire())
    assert "began with calibration none, and c2 is in force; discard the plan" in message
    service.calibration_id = ""
    service.ask("plan/resume", token=service.acquire("ben", force=True))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"name": "dance"}, "no plan 'dance'"),
        ({"points_digest": "x"}, "other points"),
        ({"settings": {"dance": 1}}, "setting dance"),
    ],
)
def test_a_plan_that_this_version_makes_otherwise_does_not_go_on(days, change, expected):
    interrupted(days)
    service = days.daemon()
    log = service.journal.log
    service.journal.log = replace(log, plan=log.plan.model_copy(update=change))
    assert expected in refused(service, "plan/resume", token=service.acquire())


def test_a_bench_that_is_not_free_is_not_given_to_it(days):
    interrupted(days)
    service = days.daemon()
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.run_s(1.5, token)
    assert "torque_Nm = 0 first" in refused(service, "plan/resume", token=token)
    assert service.resumption.interrupted


def test_a_plan_of_which_nothing_is_missing_is_done(days):
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: len(service.sink.points) == 3)
    days.crash(service)
    again = days.daemon()
    token = again.acquire()
    answer = again.ask("plan/resume", token=token)
    assert (answer["state"], answer["points_done"]) == ("done", 3)
    assert again.sink.started == []
    start(again, token)


def test_what_was_found_in_the_requests_thread_is_used(days):
    interrupted(days)
    service = days.daemon()
    _, rest = service.plans.read_remaining(b'{"token": "t"}')
    assert [point.index for point in rest.plan.points] == [1, 2]
    token = service.acquire()
    service.ask("plan/resume", token=token)
    assert service.plans.read_remaining(b'{"token": "t"}')[1] is None


def test_a_disk_that_stays_full_is_reported_with_each_plan(days, monkeypatch):
    def full(path, line, offset):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("motord.service.plans.journal_file._write", full)
    service = days.daemon()
    token = service.acquire()
    for plans in (1, 2):
        start(service, token)
        service.resumption.journal.settle()
        service.run_s(0.1, token)
        service.ask("plan/abort", token=token)
        run_to_end(service, token)
        reports = [event for event in service.bench.events.recent() if event.kind == "journal"]
        assert len(reports) == plans


@pytest.mark.parametrize("another", [False, True])
def test_what_was_read_of_a_plan_that_was_discarded_meanwhile_does_not_go_on(days, another):
    interrupted(days)
    service = days.daemon()
    token = service.acquire()
    call = service.prepare("plan/resume", token=token)
    service.ask("plan/discard", token=token)
    if another:
        start(service, token)
        service.ask("plan/abort", token=token)
        run_to_end(service, token)
    with pytest.raises(RpcError, match="was discarded or resumed meanwhile; ask again"):
        service.carry_out(call)
    assert service.bench.plans.concluded


def test_recordings_are_never_read_in_the_supervisors_loop(days):
    interrupted(days)
    service = days.daemon()
    payload = json.dumps({"token": service.acquire()}).encode()
    call = Call("plan/resume", parse(PLAN_RESUME, payload))  # a plan was under way a moment ago
    service.dispatcher.handle(call, service.now_ns)
    with pytest.raises(RpcError, match="has just ended; ask again") as caught:
        call.wait(0)
    assert caught.value.code == "busy"


def test_a_journal_that_cannot_be_written_is_reported_once_and_the_plan_goes_on(days, tmp_path):
    (tmp_path / "file").write_text("")
    days.path = tmp_path / "file" / "sim.jsonl"
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    service.journal.settle()
    service.run_s(1.0, token)
    reported = [m for m in service.messages() if m.startswith("journal: cannot write")]
    assert len(reported) == 1
    assert service.bench.plans.view.state == "running"


def test_a_journal_that_cannot_be_read_is_reported(days):
    days.path.mkdir()
    assert any("journal: cannot read" in m for m in days.daemon().messages())


@pytest.mark.parametrize("name", sorted(plan_kinds().keys() - {"thermal"}))
def test_every_plan_is_made_again_from_its_own_settings(name):
    plan = build(name, load())
    again = build(name, load(), plan.settings)
    assert again.points_digest == plan.points_digest
    assert again.part(again.points[:1]).points_digest != plan.points_digest
    assert again.settings == plan.settings


def test_a_journal_of_a_version_that_had_a_part_less_goes_on(days):
    interrupted(days)
    content = days.path.read_text()
    part = '"channels":"' + bench_parts(load())["channels"] + '"'
    assert part in content
    days.path.write_text(content.replace(part, '"of_a_later_one":"x"'))
    service = days.daemon()
    service.ask("plan/resume", token=service.acquire())


def test_the_parts_of_a_bench_are_distinguished():
    bench = load()
    parts = bench_parts(bench)
    assert not parts.keys() & MAY_CHANGE
    assert parts.keys() | MAY_CHANGE == Config.model_fields.keys()
    warmer = bench.limits.model_copy(update={"trip_temperature_C": 91.0})
    other = bench_parts(bench.model_copy(update={"limits": warmer}))
    assert [name for name in parts if parts[name] != other[name]] == ["limits"]


# --- what the recordings hold


def point(index, first, last, quality="ok", take=1):
    return {
        "index": index, "tick_start": first, "tick_end": last, "quality": quality, "take": take,
        "t_start_ns": START_NS, "t_end_ns": START_NS, "compensate": int(Compensate(0)),
        "torque_Nm": 1.0, "speed_Hz": 1.0,
    }  # fmt: skip


def record(path, points, first, count, *, finished=True):
    writer = RunWriter(path, METADATA)
    writer.ticks(tick_block(count, first))
    for taken in points:
        writer.operating_point(START_NS, taken)
    if finished:
        writer.close()
    else:
        writer.abandon()


def test_what_the_recording_holds_counts_and_not_what_the_journal_says(tmp_path):
    name = tmp_path / "a-000.mcap"
    segment = JournalSegment(str(name), (point(0, 10, 20), point(1, 30, 40)))
    assert recorded(segment) == {0, 1}  # no files: the journal is believed
    record(name, [point(0, 10, 20), point(7, 21, 29)], 0, 50)
    assert recorded(segment) == {0, 7}
    ended = JournalSegment(str(name), segment.points, state="aborted")
    assert recorded(ended) == {0, 1}
    assert recorded(JournalSegment("", segment.points)) == {0, 1}


def test_a_point_whose_last_ticks_were_lost_is_missing(tmp_path):
    name = tmp_path / "a-000.mcap"
    record(name, [point(0, 0, 10), point(1, 20, 49), point(2, 20, 50)], 0, 50, finished=False)
    assert part_of(name).exists()
    assert recorded(JournalSegment(str(name))) == {0, 1}


def test_all_files_of_a_recording_count_as_far_as_they_can_be_read(tmp_path):
    record(tmp_path / "a-000.mcap", [point(0, 0, 10), point(1, 10, 55)], 0, 50)
    (tmp_path / "a-001.mcap.part").write_bytes(b"")
    record(
        tmp_path / "a-002.mcap", [point(2, 57, 60, "noisy"), point(3, 60, 61, "noisy", 3)], 50, 20
    )
    assert recorded(JournalSegment(str(tmp_path / "a-000.mcap"))) == {0, 3}  # 1 lies in two files


def test_if_a_recorder_died_meanwhile_the_files_are_asked_even_after_an_orderly_end(tmp_path):
    name = tmp_path / "a-000.mcap"
    record(name, [point(0, 10, 20)], 0, 50)
    points = (point(0, 10, 20), point(1, 30, 40))
    assert recorded(JournalSegment(str(name), points, "failed")) == {0, 1}
    assert recorded(JournalSegment(str(name), points, "failed", complete=False)) == {0}


def test_a_plan_during_which_a_recorder_died_is_looked_at_again(days):
    service = days.daemon()
    service.resumption.recorder(None)  # no plan is under way
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: service.sink.points)
    service.resumption.recorder(None)
    service.resumption.recorder(object())
    view = run_to_end(service, token)
    assert (view.state, view.recorded) == ("failed", False)
    assert view.message.startswith("the recorder died meanwhile")
    assert f"plan: calibrate failed: {view.message}" in service.messages()
    log = service.journal.log
    assert (log.segments[-1].complete, log.state, log.segments[-1].message) == (
        *(False, "failed", view.message),
    )
    service.journal.settle()
    again = days.daemon()
    assert again.journal.log == log
    assert again.ask("plan/resume", token=again.acquire())["state"] == "done"


def test_what_is_missing_after_a_recorder_died_is_looked_for_once(days, monkeypatch):
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: service.sink.points)
    service.resumption.recorder(None)
    run_to_end(service, token)
    monkeypatch.setattr(recorded_points, "recorded", lambda segment: {0, 2})
    service.ask("plan/resume", token=token)
    assert run_to_end(service, token).state == "done"
    assert [p["index"] for p in service.sink.points] == [0, 1, 2, 1]
    assert "none was interrupted" in refused(service, "plan/resume", token=token)


def test_a_recording_without_ticks_has_no_points(tmp_path):
    record(tmp_path / "a-000.mcap", [point(0, 0, 10)], 0, 0)
    assert recorded(JournalSegment(str(tmp_path / "a-000.mcap"))) == set()


def test_a_plan_is_done_once_it_is_on_the_disk_and_else_taken_again(days):
    service = days.daemon()
    token = service.acquire()
    service.sink.missing = None  # the recorder has not said yet that its file is closed
    start(service, token)
    until(service, token, lambda: service.bench.plans.view.step == "closing the recording")
    service.run_s(1.0, token)
    service.bench.plans.abort("by the operator: there is nothing left to end")
    service.bench.plans.unrecorded("not recorded for 7.5 s")
    assert service.bench.plans.view.state == "ending"
    service.sink.missing = "no space left"
    service.run_s(0.1, token)
    view = service.bench.plans.view
    assert (view.state, view.recorded, view.points_done) == ("failed", False, 3)
    assert "not recorded in full: no space left; motord plan resume" in view.message
    [segment] = service.journal.log.segments
    assert (segment.complete, segment.written, segment.state) == (False, False, "failed")
    assert "some may not be recorded" in service.resumption.summary()
    service.sink.missing = ""
    service.ask("plan/resume", token=token)
    assert run_to_end(service, token).state == "done"
    assert [p["index"] for p in service.sink.points] == [0, 1, 2, 0, 1, 2]


def test_a_plan_that_is_ended_for_its_recording_is_taken_again(days):
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: service.sink.points)
    service.bench.plans.unrecorded("not recorded for 7.5 s")
    view = run_to_end(service, token)
    assert (view.state, view.message, view.recorded) == ("aborted", "not recorded for 7.5 s", False)
    service.ask("plan/resume", token=token)
    assert run_to_end(service, token).recorded
    assert [p["index"] for p in service.sink.points] == [0, 0, 1, 2]


def test_a_plan_that_is_aborted_while_it_is_not_recorded_is_taken_again(days):
    service = days.daemon()
    token = service.acquire()
    start(service, token)
    until(service, token, lambda: service.sink.points)
    service.sink.missing = "no space left"  # for less than half of the ring
    service.ask("plan/abort", token=token)
    view = run_to_end(service, token)
    assert (view.state, view.recorded) == ("aborted", False)
    assert "anna; not recorded in full: no space left; motord plan resume" in view.message
    service.sink.missing = ""
    [segment] = service.journal.log.segments
    assert (segment.complete, segment.written) == (False, False)
    service.ask("plan/resume", token=token)
    run_to_end(service, token)
    assert [p["index"] for p in service.sink.points] == [0, 0, 1, 2]


ENDS = {
    "stop": ("aborted", lambda service, token: service.ask("stop", by="ben")),
    "abort": ("aborted", lambda service, token: service.ask("plan/abort", token=token)),
    "loop": ("failed", lambda service, token: service.bench.loop_down("the loop ended: killed")),
    "off": ("aborted", lambda service, token: service.bench.setpoint.request(Request.STOP)),
    "error": ("failed", lambda service, token: service.bench.fault_stop("here", ValueError())),
    "done": ("done", lambda service, token: run_until_closing(service, token)),
}  # fmt: skip
"""How plans end: the state that comes of it, and what brings it about."""


def run_until_closing(service, token):
    until(service, token, lambda: service.bench.plans.view.step == "closing the recording")


@pytest.mark.parametrize("found", ["", "no space left", "died"])
@pytest.mark.parametrize("how", ENDS)
def test_however_a_plan_ends_its_view_and_its_journal_agree(days, how, found):
    """It ends when the recorder has said what became of the file, and all say the same of it."""
    service = days.daemon(safe=True)
    token = service.acquire()
    service.sink.missing = None
    start(service, token)
    until(service, token, lambda: service.sink.points)
    state, end = ENDS[how]
    end(service, token)
    run_until_closing(service, token)
    service.run_s(0.2, token)
    view, plans = service.bench.plans.view, service.bench.plans
    assert (view.state, view.recorded) == ("ending", True)
    assert (plans.active, plans.closing) == (False, True)
    assert service.journal.log.state == ""
    torque_Nm = service.bench.setpoint.torque_Nm
    plans.pause()
    plans.resume()
    plans.abort("late")
    plans.end("late")
    assert (plans.view, service.bench.setpoint.torque_Nm, torque_Nm) == (view, 0.0, 0.0)
    if found == "died":
        service.resumption.recorder(None)
    service.sink.missing = "" if found == "died" else found
    plans.conclude()
    view, [segment] = plans.view, service.journal.log.segments
    assert plans.concluded
    assert view.state == ("failed" if found and state == "done" else state)
    assert (segment.state, segment.message) == (view.state, view.message)
    assert view.recorded is (not found)
    assert (segment.complete, segment.written) == (not found, found != "no space left")
    assert "late" not in view.message
    assert ("motord plan resume" in view.message) is bool(found)
    service.journal.settle()
    again = days.daemon().bench.plans.view
    assert (again.state if again else "done") == view.state
