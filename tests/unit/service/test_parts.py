"""Small parts: words, priority, log, events, calls, set-point."""

import io
import logging
import os
import sys
import threading

import numpy as np
import pytest

from motord.api.descriptions import (
    TRIP_ACTION,
    TRIP_MEANING,
    trip_action,
    trip_names,
    trip_text,
)
from motord.api.errors import RpcError
from motord.api.replies import RpcReply, StateReply
from motord.api.requests import STOP, StopNow
from motord.control.types import SETPOINT
from motord.schema import Compensate, Request, Trip
from motord.sequencing import Induced
from motord.service.host import scheduling
from motord.service.host.events import KEPT, EventLog
from motord.service.host.log import log_to_stderr
from motord.service.rpc.dispatcher import Call, CallQueue, Dispatcher, Wait, handles
from motord.service.setpoint import UNSEEN_NS, Setpoint
from tests.support.patience import PATIENCE_S


def test_every_trip_has_a_meaning():
    assert set(TRIP_MEANING) == set(TRIP_ACTION) == set(Trip)
    everything = sum(Trip)
    assert trip_names(everything) == [trip.name for trip in Trip]
    assert all(meaning in trip_text(everything) for meaning in TRIP_MEANING.values())
    assert all(action in trip_action(everything) for action in TRIP_ACTION.values())
    assert trip_text(0) == "no cause"


def test_priority_rises_as_far_as_allowed(monkeypatch):
    asked = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *a: asked.append((a[1], a[2])))
    scheduling.raise_priority(80)
    scheduling.raise_priority(5)
    scheduling.raise_priority(1)
    assert [p.sched_priority for _, p in asked] == [10, 4, 1]
    assert all(policy & os.SCHED_RESET_ON_FORK for policy, _ in asked)
    scheduling.restore_priority()
    assert asked[-1][0] == os.SCHED_OTHER


def test_without_the_right_it_is_nice_and_without_that_it_is_normal(monkeypatch):
    def refuse(*arguments):
        raise PermissionError

    nice = []
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", lambda *arguments: nice.append(arguments[2]))
    scheduling.raise_priority(80)
    assert nice == [scheduling.NICE]
    monkeypatch.setattr(os, "setpriority", refuse)
    scheduling.raise_priority(80)


@pytest.mark.parametrize(
    ("policy", "nice", "expected"),
    [
        (os.SCHED_RR | os.SCHED_RESET_ON_FORK, 0, "SCHED_RR 7"),
        (os.SCHED_OTHER, -10, "nice -10"),
        (os.SCHED_OTHER, 0, "normal priority"),
    ],
)
def test_priority_texts(monkeypatch, policy, nice, expected):
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: policy)
    monkeypatch.setattr(os, "sched_getparam", lambda pid: os.sched_param(7))
    monkeypatch.setattr(os, "getpriority", lambda which, who: nice)
    assert scheduling.priority_text() == expected


def test_the_log_goes_to_stderr_and_is_put_back(monkeypatch):
    stderr = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stderr)
    logger = logging.getLogger("motord")
    before = list(logger.handlers)
    with log_to_stderr():
        EventLog(lambda: 0).emit("trip", "something")
    assert "ERROR trip: something" in stderr.getvalue()
    assert logger.handlers == before


class StuckTerminal(io.StringIO):
    """Takes nothing until it is let go."""

    def __init__(self):
        super().__init__()
        self.goes_on = threading.Event()

    def write(self, text):
        self.goes_on.wait()
        return super().write(text)


@pytest.mark.parametrize("for_good", [False, True])
def test_a_stuck_terminal_holds_up_nobody(monkeypatch, for_good):
    """One line is on its way to it, one is kept, the others are dropped; nobody waits."""
    terminal = StuckTerminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr("motord.service.host.log.CAPACITY", 1)
    monkeypatch.setattr("motord.service.host.log.STOP_S", 0.01 if for_good else PATIENCE_S)

    def warn():
        with log_to_stderr():
            for number in range(5):
                logging.getLogger("motord").warning("line %d", number)
            if not for_good:
                terminal.goes_on.set()

    speaker = threading.Thread(target=warn, daemon=True)
    speaker.start()
    speaker.join(PATIENCE_S)
    waited = speaker.is_alive()
    terminal.goes_on.set()
    assert not waited
    if for_good:
        return  # what it would have taken is lost
    lines = terminal.getvalue().splitlines()
    assert 1 <= len(lines) <= 2
    assert all(" WARNING line " in line for line in lines), "no error of the log itself"


def test_only_the_newest_events_are_kept_but_all_are_passed_on():
    log, received = EventLog(lambda: 42), []
    log.listeners.append(received.append)
    for number in range(KEPT + 3):
        log.emit("k", str(number))
    assert len(received) == KEPT + 3
    assert [e.message for e in log.recent()] == [str(n) for n in range(3, KEPT + 3)]
    assert received[0].t_ns == 42


def test_calls_are_refused_when_too_many_wait():
    calls = CallQueue()
    for _ in range(CallQueue.CAPACITY):
        calls.put(Call("stop", StopNow()))
    with pytest.raises(RpcError) as caught:
        calls.put(Call("stop", StopNow()))
    assert caught.value.code == "busy"
    assert len(calls.take()) == CallQueue.CAPACITY
    assert calls.take() == []


def test_only_the_first_answer_counts():
    call = Call("stop", StopNow())
    with pytest.raises(RpcError, match="no answer"):
        call.wait(0)
    call.reply(StateReply(state="OFF"))
    call.reply(RpcError("busy", "too late"))
    assert call.wait(0) == StateReply(state="OFF")


def test_a_wait_ends_with_its_condition_or_its_time():
    seen = []

    class Waits:
        @handles(STOP)
        def stop(self, request, context):
            return Wait(lambda: RpcReply() if seen else None, 1.0, lambda: "too slow")

    dispatcher = Dispatcher(None, Waits())
    late, right = Call("stop", StopNow()), Call("stop", StopNow())
    dispatcher.handle(late, 0)
    dispatcher.step(1_000_000_000)
    with pytest.raises(RpcError, match="too slow"):
        late.wait(0)
    dispatcher.handle(right, 0)
    seen.append(1)
    dispatcher.step(1)
    assert right.wait(0) == RpcReply()


class Mailbox:
    def __init__(self):
        self.written = []

    def write(self, setpoint):
        assert setpoint.dtype == SETPOINT
        self.written.append(setpoint.copy()[0])


def test_the_next_request_waits_until_the_one_before_was_seen():
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint.request(Request.ENABLE)
    setpoint.request(Request.DISABLE)
    setpoint.write(0, 0)
    setpoint.write(1, 0)
    assert mailbox.written[-1]["request"] == Request.ENABLE
    setpoint.write(2, seen_seq=1)
    assert mailbox.written[-1]["request"] == Request.DISABLE


def test_a_request_that_nobody_sees_makes_room():
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint.request(Request.ENABLE)
    setpoint.request(Request.DISABLE)
    setpoint.write(0, 0)
    setpoint.write(UNSEEN_NS, 0)
    assert mailbox.written[-1]["request"] == Request.ENABLE
    setpoint.write(UNSEEN_NS + 1, 0)
    assert mailbox.written[-1]["request"] == Request.DISABLE


@pytest.mark.parametrize("seq", [0, 0x80000000])  # the latter after 248 days
def test_a_stop_goes_first_and_the_rest_is_forgotten(seq):
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint._record["seq"] = seq
    setpoint.request(Request.ENABLE)
    setpoint.write(0, seq)
    setpoint.request(Request.DISABLE)
    setpoint.request(Request.STOP)
    setpoint.write(1, seq)
    setpoint.write(2, seq + 2)
    setpoint.write(3, seq + 3)
    assert [int(w["request"]) for w in mailbox.written] == [1, 3, 3, 3]
    assert [int(w["request_seq"]) for w in mailbox.written] == [1, 2, 2, 2]


def test_the_numbers_of_set_points_run_over():
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint._record["seq"] = 0xFFFFFFFE
    setpoint.request(Request.ENABLE)
    for now_ns, seen in enumerate((0xFFFFFFFE, 0xFFFFFFFF, 0, 1)):
        setpoint.write(now_ns, seen)
    assert [int(w["seq"]) for w in mailbox.written] == [0xFFFFFFFF, 0, 1, 2]


def test_what_the_mailbox_holds():
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint.torque_Nm, setpoint.speed_Hz, setpoint.brake = 1.5, 0.5, 0.25
    setpoint.drive_Hz, setpoint.plan_point = -1.0, 3
    setpoint.compensate = Compensate.COGGING
    setpoint.write(0, 0)
    record = mailbox.written[-1]
    assert (record["torque_Nm"], record["brake"], record["plan_point"]) == (1.5, 0.25, 3)
    assert record["speed_rad_s"] == pytest.approx(np.pi)
    assert record["drive_rad_s"] == pytest.approx(-2 * np.pi)
    assert record["compensate"] == 2
    assert setpoint.view().compensate == "cogging"
    setpoint.rest()
    setpoint.write(1, 1)
    assert mailbox.written[-1]["torque_Nm"] == mailbox.written[-1]["drive_rad_s"] == 0.0
    assert mailbox.written[-1]["plan_point"] == -1


@pytest.mark.parametrize(
    ("name", "value", "field", "written"),
    [
        ("torque_Nm", 1.5, "torque_Nm", 1.5),
        ("speed_Hz", 0.5, "speed_rad_s", np.float32(np.pi)),
        ("brake", 0.25, "brake", 0.25),
        ("drive_Hz", -1.0, "drive_rad_s", np.float32(-2 * np.pi)),
        ("brake_temperature_C", 81.5, "brake_temperature_C", 81.5),
        ("channels_beyond", 2, "channels_beyond", 2),
        ("i2t_derating", 0.75, "i2t_derating", 0.75),
        ("plan_point", 7, "plan_point", 7),
        ("compensate", Compensate.CURRENTS, "compensate", int(Compensate.CURRENTS)),
    ],
)
def test_whatever_changes_alone_is_in_the_mailbox_with_the_next_write(name, value, field, written):
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint.write(0, 0)
    setpoint.write(1, 0)
    setattr(setpoint, name, value)
    setpoint.write(2, 0)
    setpoint.write(3, 0)
    assert [bool(w[field] == written) for w in mailbox.written] == [False, False, True, True]


def test_induced_errors_are_in_the_mailbox_until_the_bench_rests():
    mailbox = Mailbox()
    setpoint = Setpoint(mailbox)
    setpoint.write(0, 0)
    for induced in (Induced((1.0, 1.1, 0.9), (2.0, -1.0, -1.0), 1.5), Induced(cogging=0.5)):
        setpoint.induced = induced
        for now_ns in (1, 2):
            setpoint.write(now_ns, 0)
    setpoint.rest()
    setpoint.write(3, 0)
    first, *_, last = written = mailbox.written
    assert [float(w["induced_cogging"]) for w in written] == [0.0, 0.5, 0.5, -0.5, -0.5, 0.0]
    assert written[2]["induced_gain"] == pytest.approx([0.0, 0.1, -0.1])
    assert written[2]["induced_offset_A"].tolist() == [2.0, -1.0, -1.0]
    for each in (first, written[3], last):
        assert not each["induced_gain"].any()
        assert not each["induced_offset_A"].any()


def test_threads_that_share_the_interpreter_are_lifted(monkeypatch):
    given = []
    monkeypatch.setattr(os, "setpriority", lambda which, tid, nice: given.append((tid, nice)))
    go_on = threading.Event()
    thread = threading.Thread(target=go_on.wait)
    thread.start()
    scheduling.raise_threads()
    monkeypatch.setattr(os, "setpriority", Refuses())
    scheduling.raise_threads()  # without the right to: nothing happens
    go_on.set()
    thread.join()
    assert {
        (threading.get_native_id(), scheduling.NICE),
        (thread.native_id, scheduling.NICE),
    } <= set(given)


class Refuses:
    """A system that allows nothing."""

    def __call__(self, *arguments):
        raise PermissionError
