"""Requests before they are read: size, lease, room; and how they are answered."""

import ctypes
import gc
import io
import json
import os
import pickle
import resource
import sys
import threading
import time
import weakref
from types import SimpleNamespace

import psutil
import pytest
import zenoh

from motord import config
from motord.api.endpoints import ENVELOPE_BYTES, client_config
from motord.api.errors import RpcError
from motord.api.replies import RpcReply
from motord.api.requests import (
    MAX_REQUEST_BYTES,
    PASSES,
    RPCS,
    UNPROVEN_BYTES,
    WithToken,
    max_calibration_bytes,
    max_request_bytes,
)
from motord.calibration import Calibration
from motord.learned import MAX_NODES, MAX_ORDERS, LearnedPoint, LearnedTorque, Verified
from motord.service.rpc import calibration_reader, intake, outstanding
from motord.service.rpc.calibration_reader import read_elsewhere
from motord.service.rpc.dispatcher import CallQueue
from motord.service.rpc.intake import Intake, Offloaded
from motord.service.rpc.outstanding import (
    ROOM,
    ROOM_IN_COMMAND,
    ROOM_OF_STOP,
    OutstandingQueries,
)
from tests.contract.peers import until
from tests.support.calibrations import calibration
from tests.support.panic import PanicError, panic
from tests.support.patience import PATIENCE_S
from tests.unit.service.live_service import live_service

TOKEN = b"0123456789abcdef"
LIMIT = 2 * MAX_REQUEST_BYTES
PIECE_BYTES = 64_000


class Query:
    """What is used of Zenoh's query."""

    def __init__(self, payload=b"", key="k"):
        self.payload = zenoh.ZBytes(payload)
        self.key_expr = key
        self.dropped = False
        self.code = self.content = None
        self.done = threading.Event()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.done.set()

    def drop(self):
        self.dropped = True

    def reply(self, key, payload, encoding):
        self.content = payload

    def reply_err(self, payload, encoding):
        self.code = json.loads(payload)["code"]

    def outcome(self):
        """Wait for the answer; return the code of the refusal, or the content."""
        assert self.done.wait(PATIENCE_S)
        return self.code or self.content


class Played:
    """An intake whose parsing is taken down; `slow` is a slow request that waits to go on."""

    def __init__(self, monkeypatch):
        self.parsed, self.refuse = [], True
        monkeypatch.setattr(intake, "parse", self._parse)
        self.calls, self.replies = CallQueue(), OutstandingQueries(4 * LIMIT)
        self.begun, self.go_on = threading.Semaphore(0), threading.Semaphore(0)
        self.quick = False
        slow = {
            "calibration/install": Offloaded(
                self._prepare, self._finish, LIMIT, at_once=lambda: self.quick
            )
        }
        self.intake = Intake(self.calls, self.replies, slow, lambda payload: TOKEN in payload)

    def _parse(self, rpc, payload):
        self.parsed.append((rpc.name, len(payload)))
        return WithToken(token="t")

    def _prepare(self, payload):
        self.begun.release()
        assert self.go_on.acquire(timeout=PATIENCE_S)
        if self.refuse:
            raise RpcError("failed", "prepared")
        return WithToken(token="t"), None

    def _finish(self, prepared, reply):
        return lambda: b"rendered"

    def bring(self, name, payload):
        query = Query(payload)
        self.intake.accept(name, "k", query)
        return query

    def __enter__(self):
        self.replies.open()
        self.intake.open()
        return self

    def __exit__(self, *error):
        self.calls.close("over")
        self.intake.close()
        self.replies.close()


@pytest.fixture
def played(monkeypatch):
    with Played(monkeypatch) as made:
        yield made


GUARDED = sorted(name for name in RPCS if RPCS[name].needs_lease)


def test_all_but_these_need_the_lease():
    assert set(RPCS) - set(GUARDED) == {
        "lease/acquire", "stop", "note", "plan/start", "plan/list", "config", "calibration/list",
        "calibration/show", "queue/list",
    }  # fmt: skip


@pytest.mark.parametrize("name", GUARDED)
def test_a_long_request_is_not_parsed_without_the_lease(played, name):
    long = b'{"token": "guess"' + b" " * UNPROVEN_BYTES
    assert played.bring(name, long).outcome() == "no_lease"
    assert played.parsed == []
    played.go_on.release()
    proven = played.bring(name, long + TOKEN)
    if name == "calibration/install":
        assert played.begun.acquire(timeout=PATIENCE_S)
    else:
        assert [call.name for call in played.calls.take()] == [name]
        assert played.parsed == [(name, UNPROVEN_BYTES + 17 + len(TOKEN))]
    assert not proven.dropped


@pytest.mark.parametrize("name", sorted(RPCS))
def test_a_request_that_is_too_long_is_not_parsed_with_it_either(played, name):
    limit = LIMIT if name == "calibration/install" else MAX_REQUEST_BYTES
    assert played.bring(name, TOKEN + b" " * (limit + 1 - len(TOKEN))).outcome() == "invalid"
    assert played.parsed == []


def test_what_takes_long_is_not_begun_without_the_lease(played):
    assert played.bring("calibration/install", b"{}").outcome() == "no_lease"
    assert played.parsed == [("calibration/install", 2)]  # short: it may be wrong in itself
    assert not played.begun.acquire(blocking=False)


def test_what_takes_long_is_done_one_after_the_other(played):
    first = played.bring("calibration/install", TOKEN)
    assert played.begun.acquire(timeout=PATIENCE_S)
    second = played.bring("calibration/install", TOKEN)
    assert played.bring("calibration/install", TOKEN).outcome() == "busy"
    played.go_on.release(2)
    assert (first.outcome(), second.outcome()) == ("failed", "failed")


@pytest.mark.parametrize(("took_s", "outcome"), [(31.9, "refused"), (32.1, "timeout")])
def test_what_is_prepared_too_late_to_be_answered_is_not_done(played, monkeypatch, took_s, outcome):
    monkeypatch.setattr(played, "refuse", False)
    now_s = time.monotonic()
    monkeypatch.setattr(outstanding.time, "monotonic", lambda: now_s)
    query = played.bring("calibration/install", TOKEN)
    assert played.begun.acquire(timeout=PATIENCE_S)
    monkeypatch.setattr(intake.time, "monotonic", lambda: now_s + took_s)
    played.go_on.release()
    if outcome == "refused":
        assert played.calls.wait(PATIENCE_S)
        played.calls.close("it was begun")
    assert query.outcome() == outcome
    assert played.calls.take() == []


def test_what_needs_no_lease_is_paced_and_neither_stop_nor_the_commander_is(played, monkeypatch):
    clock = SimpleNamespace(now_s=100.0, slept_s=[])
    monkeypatch.setattr(intake.time, "monotonic", lambda: clock.now_s)
    monkeypatch.setattr(intake.time, "sleep", clock.slept_s.append)
    queries = [played.bring("plan/list", b"{}") for _ in range(ROOM)]
    arrived = []
    while len(arrived) < ROOM:
        arrived += played.calls.take()
    assert not any(query.dropped for query in queries)
    assert len(clock.slept_s) == ROOM - intake.BURST
    assert clock.slept_s[-1] == pytest.approx((ROOM - intake.BURST) * intake.PACE_S)
    for name, payload in (("stop", b""), ("lease/renew", TOKEN)):
        played.bring(name, payload)
        assert [call.name for call in played.calls.take()] == [name]  # in this very thread


def test_an_error_in_taking_on_is_answered(played, monkeypatch):
    monkeypatch.setattr(intake, "parse", lambda rpc, payload: 1 / 0)
    assert played.bring("stop", b"").outcome() == "internal"


def test_a_panic_in_taking_on_is_answered_and_the_thread_goes_on(played, monkeypatch):
    monkeypatch.setattr(intake, "parse", panic)
    queries = [played.bring("plan/pause", b"x" * 100) for _ in range(intake.BURST + 2)]
    assert {query.outcome() for query in queries} == {"internal"}  # the last ones are paced


@pytest.mark.parametrize("error", [PanicError, SystemExit], ids=["panic", "sys.exit"])
def test_what_a_plan_or_a_library_raises_as_it_is_prepared_ends_no_thread(
    played, monkeypatch, error
):
    def prepare(payload):
        raise error("of a plan")

    slow = Offloaded(prepare, max_bytes=LIMIT)
    monkeypatch.setitem(played.intake._offloaded, "calibration/install", slow)
    for _ in range(3):
        assert played.bring("calibration/install", TOKEN).outcome() == "internal"


def test_a_plan_that_is_prepared_for_ever_does_not_hold_up_the_end(played, monkeypatch):
    monkeypatch.setattr(intake, "CLOSE_S", 0.01)
    queries = [played.bring("calibration/install", TOKEN)]
    assert played.begun.acquire(timeout=PATIENCE_S)
    queries.append(played.bring("calibration/install", TOKEN))  # its thread has no room for more
    played.calls.close("over")
    closing = threading.Thread(target=played.intake.close, daemon=True)
    closing.start()
    closing.join(PATIENCE_S)
    ended = not closing.is_alive()
    played.replies.close()
    assert [query.outcome() for query in queries] == ["refused", "refused"]
    played.go_on.release(2)
    assert ended


def test_a_reply_that_does_not_return_does_not_hold_up_the_end(monkeypatch):
    monkeypatch.setattr(outstanding, "CLOSE_S", 0.01)
    kept, query, go_on = OutstandingQueries(100), Query(), threading.Event()
    kept.open()
    kept.reply(kept.admit("a", "k", query, 0), go_on.wait)
    closing = threading.Thread(target=kept.close, daemon=True)
    closing.start()
    closing.join(PATIENCE_S)
    ended = not closing.is_alive()
    go_on.set()
    assert ended


def test_a_panic_in_replying_ends_no_thread(played, monkeypatch):
    for query in [Query() for _ in range(2 * outstanding.THREADS)]:
        query.reply_err = panic
        pending = played.replies.admit("a", "k", query, 0)
        played.replies.reply(pending, RpcError("busy", "so"))
        query.outcome()
    last = Query()
    played.replies.reply(played.replies.admit("b", "k", last, 0), RpcError("busy", "so"))
    assert last.outcome() == "busy"


def test_room_is_kept_for_whoever_is_in_command_and_for_stop(played):
    assert ROOM < ROOM_IN_COMMAND < ROOM_OF_STOP <= CallQueue.CAPACITY
    taken = [played.bring("lease/acquire", b"{}") for _ in range(ROOM)]
    assert played.bring("lease/acquire", b"{}").dropped
    taken += [played.bring("lease/renew", TOKEN) for _ in range(ROOM_IN_COMMAND - ROOM)]
    assert played.bring("lease/renew", TOKEN).dropped
    taken += [played.bring("stop", b"") for _ in range(ROOM_OF_STOP - ROOM_IN_COMMAND)]
    assert played.bring("stop", b"").dropped
    assert not any(query.dropped for query in taken)
    until_s = time.monotonic() + PATIENCE_S
    while not all(query.done.is_set() for query in taken) and time.monotonic() < until_s:
        for call in played.calls.take():
            call.reply(RpcReply())
    assert {query.outcome() for query in taken} == {b"{}"}
    assert not played.bring("lease/acquire", b"{}").dropped


def test_bytes_under_way_are_bounded(monkeypatch):
    kept = OutstandingQueries(100)  # not open: nothing is answered
    assert kept.admit("a", "k", Query(), 60) is not None
    late = Query()
    assert kept.admit("a", "k", late, 41) is None
    assert late.dropped
    assert kept.admit("a", "k", Query(), 40) is not None


def test_only_the_first_answer_counts_and_none_is_forgotten():
    kept, query, left = OutstandingQueries(100), Query(), Query()
    pending = kept.admit("a", "k", query, 0)
    kept.admit("b", "k", left, 0)
    kept.reply(pending, RpcError("busy", "first"))
    kept.reply(pending, RpcReply())
    kept.open()
    kept.close()
    assert (query.outcome(), query.content, left.outcome()) == ("busy", None, "refused")


@pytest.mark.parametrize(
    ("name", "payload"),
    [("calibration/install", TOKEN), ("plan/list", bytes(LIMIT + 1))],
    ids=["prepared", "paced"],
)
def test_nothing_is_kept_of_a_request_that_is_answered(played, name, payload):
    query = played.bring(name, payload)
    played.go_on.release()
    query.outcome()
    kept = weakref.ref(query)
    gc.disable()
    try:
        del query
        until(lambda: kept() is None)
    finally:
        gc.enable()


def test_what_payloads_left_in_the_heaps_goes_back_to_the_system():
    """Of pieces shorter than those that glibc maps, with a small one that stays after each."""
    libc = ctypes.CDLL(None)
    libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
    libc.free.argtypes = [ctypes.c_void_p]
    own, before = psutil.Process(), psutil.Process().memory_info().rss
    pieces = [(libc.malloc(PIECE_BYTES), libc.malloc(2000)) for _ in range(2000)]
    for piece, _ in pieces:
        ctypes.memset(piece, 1, PIECE_BYTES)
        libc.free(piece)
    kept = OutstandingQueries(2 * outstanding.FREE_BYTES)
    kept.reply(kept.admit("a", "k", Query(), outstanding.FREE_BYTES), RpcError("no_lease", "x"))
    kept.open()
    until(lambda: own.memory_info().rss - before < 1000 * PIECE_BYTES)
    kept.close()
    for _, small in pieces:
        libc.free(small)


def test_refusals_are_counted_in_the_log(monkeypatch, caplog):
    monkeypatch.setattr(outstanding, "LOG_S", 0.0)
    monkeypatch.setattr(outstanding, "CHECK_S", 0.0)
    kept, query = OutstandingQueries(0), Query()
    kept.admit("a", "k", Query(), 1)
    kept.reply(kept.admit("a", "k", query, 0), RpcError("no_lease", "x"))
    with caplog.at_level("WARNING", "motord"):
        kept.open()
        kept.close()
    assert "1 dropped, 1 no_lease" in caplog.text


def test_longer_messages_are_dropped_by_zenoh_and_the_session_goes_on(tmp_path, monkeypatch):
    sizes, admit = [], OutstandingQueries.admit

    def spy(self, name, key, query, size, room=ROOM):
        sizes.append(size)
        return admit(self, name, key, query, size, room)

    monkeypatch.setattr(OutstandingQueries, "admit", spy)
    with live_service(tmp_path) as live, zenoh.open(client_config(live.listen)) as session:
        longest = max_request_bytes(live.config.motor.counts)
        install, stop = (f"motord/live/rpc/{name}" for name in ("calibration/install", "stop"))
        for size in (longest + ENVELOPE_BYTES, 50_000_000):
            session.get(install, lambda reply: None, payload=bytes(size))
        [refused] = session.get(install, payload=bytes(longest + 1), timeout=PATIENCE_S)
        assert json.loads(refused.err.payload.to_bytes())["code"] == "invalid"
        [stopped] = session.get(stop, timeout=PATIENCE_S)
        assert stopped.ok is not None
    assert sizes == [longest + 1, 0]


def test_memory_shared_with_a_client_is_not_read(tmp_path, monkeypatch):
    """It could be changed, or cut off, in the midst of reading: by whoever shares it."""
    shared, admit = [], OutstandingQueries.admit

    def spy(self, name, key, query, size, room=ROOM):
        shared.append(query.payload.as_shm() is not None)
        return admit(self, name, key, query, size, room)

    monkeypatch.setattr(OutstandingQueries, "admit", spy)
    with live_service(tmp_path) as live:
        sharing = client_config(live.listen)
        sharing.insert_json5("transport/shared_memory/enabled", "true")
        sharing.insert_json5("transport/shared_memory/mode", '"init"')
        with zenoh.open(sharing) as session:
            for _ in range(10):
                list(session.get("motord/live/rpc/stop", payload=bytes(50_000), timeout=PATIENCE_S))
    assert shared == [False] * 10


def number(n):
    return -(1.1234567890123456 + n * 1e-9) * 1e-101


def largest(counts, motor):
    """Return the longest calibration that the schema takes for an encoder of `counts` counts."""
    numbers = tuple(number(n) for n in range(MAX_ORDERS))
    errors = tuple(-number(n) for n in range(PASSES))
    best = Verified(cos_Nm=numbers, sin_Nm=numbers, rms_percent=1.1e-101, stderr_percent=1.1e-101)
    point = LearnedPoint(
        cos_Nm=numbers, sin_Nm=numbers, gain=0.1234567890123456, best=best, history_percent=errors
    )
    nodes = tuple(1.1234567890123456 + n for n in range(MAX_NODES))
    learned = LearnedTorque(
        torques_Nm=nodes,
        speeds_Hz=nodes,
        orders=tuple(range(7, 7 * MAX_ORDERS + 1, 7)),
        points=(point,) * MAX_NODES**2,
    )
    made = calibration(motor=motor.model_copy(update={"counts": counts}),
                       tau_cog_Nm=tuple(map(number, range(counts))))  # fmt: skip
    return Calibration(**{**dict(made), "id": "", "learned": learned})


def test_the_longest_calibration_is_no_longer_than_allowed():
    made = largest(4096, calibration().motor)
    size = len(json.dumps(made.to_json(), indent=1))
    assert 0.8 * max_calibration_bytes(4096) < size < max_calibration_bytes(4096)


def test_a_calibration_is_read_in_another_process(monkeypatch):
    made = calibration()
    motor = config.load().motor
    payload = json.dumps({"token": "t", "calibration": made.to_json()}).encode()
    monkeypatch.setattr(calibration_reader, "parse", None)  # nothing is parsed here
    token, read = read_elsewhere(payload, motor)
    assert (token, read.id, read.motor) == ("t", made.id, made.motor)
    with pytest.raises(RpcError, match=r"Invalid JSON") as caught:
        read_elsewhere(b'{"token": "t", "calibration": {' + b"[" * 1_000_000, motor)
    assert caught.value.code == "invalid"


@pytest.mark.parametrize(("inherited", "added"), [(-10, 10), (0, 0), (5, 0)])
def test_a_calibration_is_read_at_the_priority_of_ordinary_programs(monkeypatch, inherited, added):
    """Neither before the supervisor nor, on a busy computer, never."""
    increments, answers = [], io.BytesIO()
    monkeypatch.setattr(os, "getpriority", lambda which, who: inherited)
    monkeypatch.setattr(os, "nice", increments.append)
    monkeypatch.setattr(resource, "setrlimit", lambda *limits: None)
    payload = pickle.dumps(("request", (b"no request", config.load().motor)))
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(payload)))
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(buffer=answers))
    assert calibration_reader.main() == 0
    assert isinstance(pickle.loads(answers.getvalue()), RpcError)
    assert increments == [added]


def test_a_reply_may_come_as_what_renders_it(played, monkeypatch):
    monkeypatch.setattr(played, "refuse", False)
    query = played.bring("calibration/install", TOKEN)
    played.go_on.release()
    assert played.calls.wait(PATIENCE_S)
    for call in played.calls.take():
        call.reply(RpcReply())
    assert query.outcome() == b"rendered"


def test_what_takes_no_time_by_now_needs_no_thread_of_its_own(played, monkeypatch):
    monkeypatch.setattr(played, "refuse", False)
    played.quick = True
    played.go_on.release(2)
    queries = [played.bring("calibration/install", TOKEN) for _ in range(2)]
    calls = played.calls.take()  # at once: none waits for the one before
    calls[0].reply(RpcReply())
    calls[1].reply(RpcError("refused", "by the dispatcher"))
    assert [query.outcome() for query in queries] == [b"rendered", "refused"]


def test_a_request_that_takes_no_time_may_be_refused_before_it_is_queued(played):
    played.quick = True
    played.go_on.release()
    assert played.bring("calibration/install", TOKEN).outcome() == "failed"
    assert not played.calls.take()
