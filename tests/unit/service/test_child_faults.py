"""Children that send nonsense, a system without descriptors: reported, and the bench goes on."""

import errno
import os
import random
import resource
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from motord.process.ending_threads import NO_THREAD
from motord.schema import Request, State
from motord.service.bench import guard
from motord.service.host.children import NOT_ENDED, Children, Process, spawn
from motord.service.host.descriptors import (
    LEAST,
    DescriptorReserve,
    DescriptorsError,
    raise_limit,
)
from motord.shm.shared_records import SharedFileError
from tests.support.nonsense import random_line
from tests.unit.service.played_daemon import PlayedDaemon


@pytest.fixture
def played(tmp_path, monkeypatch):
    daemon = PlayedDaemon(tmp_path, monkeypatch)
    daemon.up()
    yield daemon
    daemon.close()


def heartbeats(daemon):
    """Return the number of the set-point in the mailbox, and the request next to it."""
    record = np.zeros(1, daemon.supervisor.bench.setpoint._record.dtype)
    daemon.loops[0].mailbox.read(record)
    return int(record["seq"][0]), int(record["request"][0])


def test_10_000_random_lines_of_the_recorder_stop_nothing_and_it_is_started_again(played):
    chance, recorder = random.Random(11), played.recorders[0]
    os.set_blocking(recorder._reports.fileno(), False)
    before, sent, steps = heartbeats(played)[0], 0, 0
    while sent < 10_000 and recorder.code is None:
        try:
            recorder._reports.write(random_line(chance) + b"\n")
            sent += 1
        except BlockingIOError:
            pass
        played.step(state=State.ENABLED)
        steps += 1
    assert heartbeats(played)[0] - before == steps
    assert recorder.code == -9
    played.step(30, State.ENABLED)
    assert len(played.recorders) == 2
    played.recorders[1].report(ticks=5)
    played.step(12, State.ENABLED)
    assert played.supervisor.recording.view().detail == {"ticks": 5}
    state = played.state()
    assert state["processes"]["recorder"]["bad_messages"] > 500
    assert state["state"] == "ENABLED"
    assert state["faults"] == {}
    reported = [m for m in played.messages() if "no messages" in m or "more than can be meant" in m]
    assert 2 <= len(reported) <= 2 + steps * 0.01 / 10


def test_a_line_that_is_no_report_is_reported_and_counted(played):
    played.recorders[0]._reports.write(b"Traceback (most recent call last):\n")
    played.step(12)
    assert any("recorder sent 1 lines that are no messages" in m for m in played.messages())
    assert played.state()["processes"]["recorder"]["bad_messages"] == 1
    assert len(played.recorders) == 1


def test_a_recorder_that_takes_no_commands_is_commanded_anew(played):
    start = played.record()
    for number in range(400):
        played.supervisor.bench.events.emit("note", "x" * 20_000, n=number)
    played.step(12, State.ENABLED)
    assert played.state()["processes"]["recorder"]["dropped_messages"] > 100
    assert any("did not take its commands in time" in m for m in played.messages())
    again = []
    for _ in range(100):
        again += played.recorders[0].received("start")
        played.step(1, State.ENABLED)
    assert [(c["out"], c["resume"]) for c in again] == [(start["out"], True)]


def test_a_status_of_the_loop_that_makes_no_sense_is_reported(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.supervisor.loop.start(played.now_ns)
    for content in (b"[" * 10_000, b'{"phase": 7}', b"\xff", b"x" * (2 << 20)):
        played.run_dir.loop_status.write_bytes(content)
        played.step()
        assert "is no status of a loop" in played.state()["faults"]["loop link"] or (
            "longer than any status" in played.state()["faults"]["loop link"]
        )
    assert len([m for m in played.messages() if "loop link" in m]) == 1
    played.loops[-1].ready()
    played.step(2)
    assert played.state()["faults"] == {}
    assert played.supervisor.loop.phase == "up"
    played.close()


def test_a_ring_that_cannot_be_opened_yet_is_tried_again(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.supervisor.loop.start(played.now_ns)
    played.loops[-1].ready()
    with monkeypatch.context() as patch:

        def no_descriptors(path, start):
            raise SharedFileError(f"{path}: cannot open it: Too many open files")

        patch.setattr("motord.service.host.loop_link.RingReader", no_descriptors)
        played.step(2)
        assert "Too many open files" in played.state()["faults"]["loop link"]
    played.step(2)
    assert played.supervisor.loop.phase == "up"
    played.close()


def test_a_recorder_that_cannot_be_started_is_reported_and_tried_again(played):
    start, tries = played.spawn["recorder"], []

    def without_descriptors(command):
        tries.append(played.now_ns)
        if len(tries) < 4:
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        return start(command)

    played.spawn["recorder"] = without_descriptors
    played.recorders[0].code = -9
    played.wait_s(2.0, State.ENABLED)
    assert len(tries) == 4
    assert len(played.recorders) == 2
    reported = [m for m in played.messages() if "cannot be started: Too many open files" in m]
    assert len(reported) == 3
    assert "; again in 0.2 s" in reported[0]
    assert played.state()["state"] == "ENABLED"
    assert played.state()["processes"]["recorder"]["running"]


@pytest.mark.parametrize(
    ("number", "why"),
    [(errno.ENOMEM, "Cannot allocate memory"), (errno.EAGAIN, NO_THREAD)],
)
def test_a_loop_that_cannot_be_started_says_so(tmp_path, monkeypatch, number, why):
    played = PlayedDaemon(tmp_path, monkeypatch)

    def refused(command):
        raise OSError(number, os.strerror(number))

    played.spawn["loop"] = refused
    played.supervisor.loop.start(played.now_ns)
    assert not played.supervisor.wait_for_loop(lambda: False)
    assert f"cannot be started: {why}" in played.supervisor.bench.loop.fault
    played.close()


@contextmanager
def no_descriptors_left():
    """Use up all descriptors that there may be; let go of them at the end."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = max(int(path.name) for path in Path("/proc/self/fd").iterdir())
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 40, hard))
    held = []
    try:
        with suppress(OSError):
            while True:
                held.append(os.open(os.devnull, os.O_RDONLY))
        assert held  # else there was nothing left before
        yield
    finally:
        for descriptor in held:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize(("size", "starts"), [(0, False), (12, True)])
def test_the_reserve_starts_a_child_when_there_are_no_descriptors_left(size, starts):
    command = (sys.executable, "-c", "")
    row = Process("recorder", "motord.absent", spawn, "always", "", 5.0)
    children = Children([row], lambda row: spawn(command), DescriptorReserve(size))
    with no_descriptors_left():
        children.start("recorder", 0)
        assert (children.process("recorder") is not None) is starts
        ends = children.poll(0)
        assert starts or "Too many open files" in ends[0].how
    if starts:
        children.process("recorder").wait()


PERIPHERAL = {
    "loop link": "loop.follow",
    "processes": "children.poll",
    "requests": "dispatcher.take",
    "estimator": "estimator.step",
    "queue": "queue.step",
    "answers": "dispatcher.step",
    "recording": "recording.step",
    "publisher": "publisher.step",
    "service manager": "notifier.progress",
}
"""What of the supervisor is called for each part; those not on every bench are below."""


def test_every_part_that_may_fail_has_a_case_here():
    assert PERIPHERAL.keys() | {"channels", "gateway", "tracker"} == guard.PARTS.keys()


def failing(played, monkeypatch, part, error):
    owner, method = PERIPHERAL[part].split(".")

    def fail(*arguments):
        raise error

    monkeypatch.setattr(getattr(played.supervisor, owner), method, fail)


@pytest.mark.parametrize("part", PERIPHERAL)
@pytest.mark.parametrize(
    "error", [OSError(errno.EMFILE, "Too many open files"), MemoryError()], ids=["EMFILE", "memory"]
)
def test_what_the_world_does_to_a_part_is_reported_and_the_bench_goes_on(
    played, monkeypatch, part, error
):
    before = heartbeats(played)[0]
    with monkeypatch.context() as patch:
        failing(played, patch, part, error)
        played.step(100, State.ENABLED)
        assert heartbeats(played) == (before + 100, Request.NONE)
        assert played.supervisor.bench.state is State.ENABLED
        assert part in played.supervisor.guard.faults
        assert len([m for m in played.messages() if m.startswith(f"{part}: ")]) == 1
    played.step(2, State.ENABLED)
    assert played.supervisor.guard.faults == {}


@pytest.mark.parametrize("part", PERIPHERAL)
def test_an_error_of_the_program_in_a_part_stops_the_bench_and_the_daemon_goes_on(
    played, monkeypatch, part
):
    played.step(5, State.ENABLED)
    with monkeypatch.context() as patch:
        failing(played, patch, part, ZeroDivisionError("of a bug"))
        played.step(3, State.ENABLED)
        assert heartbeats(played)[1] == Request.STOP
        assert "ZeroDivisionError: of a bug" in played.supervisor.guard.faults[part]
    assert any("of a bug; stopped" in m for m in played.messages())


def test_an_error_in_the_bench_itself_is_not_kept_quiet(played, monkeypatch):
    def fail(*arguments):
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(played.supervisor.bench.setpoint, "write", fail)
    with pytest.raises(OSError, match="Too many"):
        played.step()


def test_a_listener_that_errs_keeps_an_event_from_nobody(played, caplog):
    came = []
    listeners = played.supervisor.bench.events.listeners
    listeners[:0] = [lambda event: 1 / 0]
    listeners.append(came.append)
    for _ in range(3):
        played.supervisor.bench.events.emit("note", "x")
    assert len(came) == 3
    assert len([r for r in caplog.records if r.exc_info]) == 1


def test_the_end_of_the_daemon_says_which_process_could_not_be_ended(played, monkeypatch):
    def wait(timeout):  # without a limit it would be for ever
        raise subprocess.TimeoutExpired("loop", timeout)

    monkeypatch.setattr(played.loops[0], "wait", wait)
    played.supervisor.take_down()
    [said] = [message for message in played.messages() if "not ended" in message]
    assert said == f"loop (pid {played.loops[0].pid}) is {NOT_ENDED}"


@pytest.mark.parametrize(("hard", "enough"), [(LEAST - 1, False), (LEAST, True), (-1, True)])
def test_a_daemon_that_nobody_could_connect_to_is_refused(monkeypatch, hard, enough):
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (hard, hard))
    if enough:
        assert raise_limit() == hard
    else:
        with pytest.raises(DescriptorsError, match="only 127 files may be open at a time"):
            raise_limit()
