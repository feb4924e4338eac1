"""A plan's estimator: ticks of captures out of the ring, its process, and the supervisor's end."""

import json
import math
import os
import select
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from pydantic import ValidationError

from motord.config import load
from motord.recorder.launch import spawn_piped
from motord.recorder.pipe_lines import LineReader, LineWriter
from motord.sequencing import Plan
from motord.sequencing.observation import Precision
from motord.service.estimator import process
from motord.service.estimator.link import ANSWER_MAX_NS, ENDED, ESTIMATOR, SILENT, EstimatorLink
from motord.service.estimator.process import CaptureTicks
from motord.service.estimator.protocol import PrecisionReport
from motord.service.host import scheduling
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from tests.support.patience import PATIENCE_S
from tests.support.played_process import PlayedProcess
from tests.unit.service import linked_process
from tests.unit.service.linked_process import CONFIG, LinkedProcess


class Counting:
    """Knows as much as it has counted: the ticks of the captures so far."""

    def __init__(self, config, targets, remark):
        self.targets, self.ticks, self.captures, self.remark = targets, 0, 0, remark

    def take(self, ticks):
        sys.stdout.write("an estimator may print\n")
        self.ticks += len(ticks)

    def captured(self, point):
        if point["index"] == 99:
            raise ValueError("no such point")
        self.captures += 1
        known = {"ticks": self.ticks, "not yet": float("nan"), "never": float("inf")}
        return Precision(self.captures, known, remark=self.remark)


OPTIONS = {"remark": "counted"}
COUNTING = f"{__name__}:Counting"


def plan(estimator=COUNTING):
    about = {"estimator_options": OPTIONS, "targets": {"ticks": 1.0}}
    return Plan("p", (), iter, float, {}, estimator=estimator, **about)


def publish(ring, first, points):
    """Publish a tick for each number of a point in `points`, from tick `first` on."""
    for number, point in enumerate(points):
        slot = ring.slot()[0]
        slot["tick"], slot["plan_point"] = first + number, point
        ring.publish()


def captured(first, last, index=0):
    return {"index": index, "tick_start": first, "tick_end": last}


def follow(run_dir, **bounds):
    return CaptureTicks(RingReader(run_dir.ring, "oldest"), **bounds)


# --- ticks of captures


def test_each_capture_has_its_ticks_though_the_next_one_has_begun(run_dir, ring):
    captures = follow(run_dir)
    publish(ring, 0, [-1] * 3 + [0] * 5 + [-1] * 2 + [1] * 4)
    captures.read()
    assert captures.of(captured(3, 7))["tick"].tolist() == [3, 4, 5, 6, 7]
    publish(ring, 14, [1] * 4)
    assert captures.of(captured(10, 17, 1))["tick"].tolist() == list(range(10, 18))


def test_ticks_are_not_those_of_an_attempt_before(run_dir, ring):
    captures = follow(run_dir)
    publish(ring, 0, [0] * 5 + [-1] * 2 + [0] * 4)
    assert captures.of(captured(7, 10))["tick"].tolist() == [7, 8, 9, 10]


@pytest.mark.parametrize(("first", "whole"), [(36, False), (37, True)])
def test_a_capture_is_whole_from_the_oldest_tick_that_the_ring_has(run_dir, ring, first, whole):
    publish(ring, 0, [0] * 100)  # the oldest that can be read is 37
    ticks = follow(run_dir).of(captured(first, 99))
    assert (ticks is not None) == whole


def test_a_capture_of_which_ticks_were_overwritten_is_none(run_dir, ring):
    captures = follow(run_dir)
    publish(ring, 0, [0] * 10)
    captures.read()
    publish(ring, 10, [0] * 90)
    assert captures.of(captured(0, 99)) is None
    publish(ring, 100, [-1] * 2 + [1] * 5)
    assert len(captures.of(captured(102, 106, 1))) == 5


def test_a_loss_between_captures_costs_none(run_dir, ring):
    captures = follow(run_dir)
    publish(ring, 0, [0] * 10)
    assert captures.of(captured(0, 9)) is not None
    publish(ring, 10, [-1] * 80 + [1] * 30)
    assert len(captures.of(captured(90, 119, 1))) == 30


def test_a_capture_that_the_ring_does_not_have_yet_is_none(run_dir, ring):
    captures = follow(run_dir)
    publish(ring, 0, [0] * 10)
    assert captures.of(captured(0, 10)) is None


def test_what_is_kept_is_bounded_and_a_pause_costs_nothing(run_dir, ring):
    captures = follow(run_dir, kept_max=20)
    for first in range(0, 100, 10):
        publish(ring, first, [0] * 10)
        captures.read()
    assert captures.of(captured(0, 99)) is None
    for first in range(100, 200, 10):
        publish(ring, first, [-1] * 10)
        captures.read()
    publish(ring, 200, [1] * 20)
    assert len(captures.of(captured(200, 219, 1))) == 20


# --- the process' work, in this one


@pytest.fixture
def pipes():
    ends = os.pipe()
    for end in ends:
        os.set_blocking(end, False)
    yield ends
    for end in ends:
        os.close(end)


def lines_of(*commands):
    return [json.dumps(command).encode() for command in commands]


def start(estimator=COUNTING):
    about = {"estimator": estimator, "targets": {"ticks": 1.0}, "options": OPTIONS}
    return {"do": "start", "run": "r", **about}


def point(*about):
    return {"do": "point", "content": captured(*about)}


def reports_of(reader):
    return [PrecisionReport.model_validate_json(line) for line in reader.read()]


class Worked:
    """An estimation on the ring of a test."""

    def __init__(self, run_dir, pipes):
        reader, writer = pipes
        self._reader = LineReader(reader)
        captures = follow(run_dir)
        self._estimation = process.Estimation(load(), captures, LineWriter(writer, 1 << 20))

    def handle(self, *commands):
        """Return the reports on commands."""
        for line in lines_of(*commands):
            self._estimation.handle(line)
        return self.reports()

    def reports(self):
        return reports_of(self._reader)


@pytest.fixture
def worked(run_dir, ring, pipes):
    return Worked(run_dir, pipes)


def test_each_capture_is_answered_with_what_is_known_by_then(worked, ring):
    publish(ring, 0, [0] * 5 + [-1] * 2 + [1] * 4)
    found = worked.handle(start(), point(0, 4), point(7, 10, 1))
    assert [(f.run, f.captures, f.half_widths) for f in found] == [
        ("r", 1, {"ticks": 5.0}), ("r", 2, {"ticks": 9.0}),
    ]  # fmt: skip


def test_ticks_that_are_gone_are_an_obstacle_and_enter_no_estimate(worked, ring):
    publish(ring, 0, [0] * 100)
    [lost] = worked.handle(start(), point(0, 99))
    assert lost.obstacle == "ticks of point 0 were overwritten before they were read"
    assert not lost.precision.reaches({"ticks": 1e9})
    publish(ring, 100, [1] * 3)
    [found] = worked.handle(point(100, 102, 1))
    assert (found.half_widths, found.obstacle) == ({"ticks": 3.0}, "")


def test_an_estimator_that_fails_is_reported_and_ends_the_process(worked, ring):
    publish(ring, 0, [0] * 5)
    with pytest.raises(ValueError, match="no such point"):
        worked.handle(start(), point(0, 4), point(0, 4, 99))
    _, failed = worked.reports()
    assert (failed.captures, failed.obstacle) == (
        1, "the estimator failed: ValueError: no such point",
    )  # fmt: skip


def test_an_estimator_that_cannot_be_made_is_reported(worked):
    with pytest.raises(ImportError):
        worked.handle(start("motord.no_such:Thing"))
    [failed] = worked.reports()
    assert "No module named 'motord.no_such'" in failed.obstacle


def test_it_goes_on_until_the_commands_end_and_takes_all_of_them(run_dir, ring, pipes):
    publish(ring, 0, [0] * 5)
    commands = lines_of(start(), *[point(0, 4)] * 50)
    captures = follow(run_dir)
    estimation = process.Estimation(load(), captures, LineWriter(pipes[1], 1 << 20))
    process.run(estimation, captures, [line + b"\n" for line in commands] + [b'{"do": "poi'])
    assert len(reports_of(LineReader(pipes[0]))) == 50


def test_the_ring_is_followed_while_an_estimate_takes_longer_than_it_holds(
    run_dir, ring, pipes, monkeypatch
):
    monkeypatch.setattr(process, "LOOK_S", 0.001)
    captures = follow(run_dir)

    class Slow(Counting):
        def captured(self, point):
            for first in range(5, 205, 40):  # the ring holds 63
                publish(ring, first, [1] * 40)
                end_s = time.monotonic() + PATIENCE_S
                while captures._newest < first + 39:
                    assert time.monotonic() < end_s
                    time.sleep(0.001)
            return super().captured(point)

    monkeypatch.setattr(process, "resolve_name", lambda name: Slow)
    publish(ring, 0, [0] * 5)
    estimation = process.Estimation(load(), captures, LineWriter(pipes[1], 1 << 20))
    process.run(estimation, captures, [line + b"\n" for line in lines_of(start(), point(0, 4))])
    assert len(captures.of(captured(5, 204, 1))) == 200


def test_a_report_is_bounded(worked):
    long = Precision(1, {}, "x" * 5000)
    assert len(PrecisionReport.of("r", long).obstacle) == 1000


# --- the supervisor's end


class Played(PlayedProcess):
    """An estimator process that the test plays."""

    def report(self, run, captures=1, **more):
        about = {"run": run, "captures": captures, "half_widths": {}, "obstacle": "", **more}
        self.say(json.dumps(about).encode())


class Linked(LinkedProcess):
    """The estimator's link, and processes that are played."""

    def __init__(self):
        super().__init__(ESTIMATOR, EstimatorLink, lambda row: Played())

    def begin(self, *about):
        """Begin a plan; return its process and the run that it is to report."""
        self.link.begin(plan(*about))
        assert self.step() == []
        [start] = self.started[-1].received()
        assert start["estimator"] == COUNTING
        assert start["targets"] == {"ticks": 1.0}
        assert start["options"] == OPTIONS
        return self.started[-1], start["run"]


@pytest.fixture
def linked():
    made = Linked()
    yield made
    made.close()


def test_a_plan_without_an_estimator_starts_nothing(linked):
    linked.link.begin(plan(""))
    assert linked.step() == []
    assert linked.started == []
    assert linked.children.views() == {}


def test_captures_that_are_not_asked_of_an_estimator_want_no_answer(linked):
    """Of a plan without one, and of one that is over."""
    linked.link.begin(plan(""))
    linked.link.captured(captured(0, 4))
    linked.step()
    linked.step(ANSWER_MAX_NS / 1e9 + 0.02)
    assert linked.link.precision is None
    linked.begin()
    linked.link.captured(captured(0, 4))
    linked.link.end()
    linked.step()
    linked.step(ANSWER_MAX_NS / 1e9 + 0.02)
    assert linked.link.precision is None


def test_captures_go_to_the_process_and_its_precision_comes_back(linked):
    played, run = linked.begin()
    linked.link.captured(captured(0, 4))
    assert played.received() == [{"do": "point", "content": captured(0, 4)}]
    assert linked.link.precision is None
    played.report(run, 1, half_widths={"ticks": 5.0})
    linked.step()
    assert linked.link.precision == Precision(1, {"ticks": 5.0})
    assert linked.children.views()[ESTIMATOR].running


def test_the_process_ends_with_the_plan_without_a_word(linked):
    played, run = linked.begin()
    linked.link.end()
    played.report(run, 7)
    assert linked.step() == []
    assert linked.step() == []
    assert played.code == -signal.SIGKILL
    assert linked.link.precision is None  # what came after the end
    assert linked.children.views() == {}
    assert linked.events.recent() == []


def test_what_one_run_has_found_never_reaches_the_next(linked):
    first, run = linked.begin()
    first.report(run, 7, half_widths={"ticks": 0.0})
    linked.step()
    linked.link.end()
    linked.link.begin(plan())  # in the same step
    assert linked.link.precision is None
    first.report(run, 8)
    linked.step()
    assert len(linked.started) == 2
    assert linked.link.precision is None
    second = linked.started[-1]
    [start] = second.received()
    second.report(run, 9)  # of the run before
    second.report("", 9)
    linked.step()
    assert linked.link.precision is None
    second.report(start["run"], 1)
    linked.step()
    assert linked.link.precision == Precision(1)


def test_a_process_that_dies_is_an_obstacle_and_no_other_is_started(linked):
    played, run = linked.begin()
    played.report(run, 3, half_widths={"ticks": 0.1})
    played.code = -signal.SIGKILL
    assert linked.step() == [("killed by SIGKILL", None)]
    known = linked.link.precision
    assert (known.captures, known.half_widths, known.obstacle) == (3, {"ticks": 0.1}, ENDED)
    assert not known.reaches({"ticks": 1.0})
    linked.link.captured(captured(0, 4))
    for _ in range(200):
        assert linked.step() == []
    assert len(linked.started) == 1
    assert linked.children.views()[ESTIMATOR].exit == "killed by SIGKILL"
    linked.link.end()
    linked.step()
    assert linked.children.views() == {}
    linked.begin()


def test_one_that_does_not_answer_a_capture_is_said_until_it_does(linked):
    played, run = linked.begin()
    linked.step(ANSWER_MAX_NS / 1e9)  # asked nothing
    assert linked.link.precision is None
    linked.link.captured(captured(0, 4))
    linked.link.captured(captured(4, 8))
    linked.step(ANSWER_MAX_NS / 1e9)
    played.report(run, 1, half_widths={"ticks": 5.0})
    linked.step()
    assert linked.link.precision == Precision(1, {"ticks": 5.0})
    linked.step(ANSWER_MAX_NS / 1e9 + 0.02)
    assert linked.link.precision == Precision(1, {"ticks": 5.0}, SILENT)
    assert linked.children.views()[ESTIMATOR].running
    played.report(run, 2, half_widths={"ticks": 4.0})
    linked.step()
    linked.step(ANSWER_MAX_NS / 1e9)
    assert linked.link.precision == Precision(2, {"ticks": 4.0})


def test_one_that_does_not_answer_and_ends_has_ended(linked):
    played, _ = linked.begin()
    linked.link.captured(captured(0, 4))
    linked.step(ANSWER_MAX_NS / 1e9 + 0.02)
    assert linked.link.precision == Precision(0, obstacle=SILENT)
    played.code = -signal.SIGKILL
    linked.step()
    assert linked.link.precision == Precision(0, obstacle=ENDED)


def test_why_it_failed_stays_when_it_has_ended(linked):
    played, run = linked.begin()
    played.report(run, 0, obstacle="the estimator failed: because")
    played.code = 1
    linked.step()
    assert linked.link.precision.obstacle == "the estimator failed: because"


def test_a_process_that_cannot_be_started_is_an_obstacle(linked):
    linked.why = OSError(12, "Cannot allocate memory")
    linked.link.begin(plan())
    linked.step()
    assert linked.link.precision.obstacle == ENDED
    assert linked.step() == [("it cannot be started: Cannot allocate memory", None)]
    linked.link.captured(captured(0, 4))
    linked.link.end()
    assert linked.step() == []


@pytest.mark.parametrize(
    "changes",
    [
        {"half_widths": {"ticks": -1.0}},
        {"half_widths": {"ticks": math.nan}},
        {"half_widths": {"ticks": math.inf}},
        {"half_widths": {"ticks": "0"}},
        {"more": 1},
    ],
)
def test_garbage_is_no_report(changes):
    report = {"run": "R", "captures": 1, "half_widths": {}, "obstacle": ""}
    assert PrecisionReport.model_validate_json(json.dumps(report)).captures == 1
    with pytest.raises(ValidationError):
        PrecisionReport.model_validate_json(json.dumps({**report, **changes}))


# --- the process


@pytest.fixture
def running(run_dir, ring):
    made = LinkedProcess(ESTIMATOR, EstimatorLink, partial(linked_process.running, run_dir))
    yield made
    made.close()


@pytest.mark.system
def test_the_process_reports_steps_back_and_ends_with_the_plan(running, ring):
    running.link.begin(plan())
    running.link.step(0)
    publish(ring, 0, [-1] * 3 + [0] * 5)
    running.link.captured(captured(3, 7))
    running.until(lambda: running.link.precision)
    assert running.link.precision == Precision(1, {"ticks": 5.0}, remark="counted")
    pid = running.started[0].pid
    assert os.getpriority(os.PRIO_PROCESS, pid) == scheduling.BACKGROUND_NICE
    os.kill(pid, signal.SIGSTOP)
    running.link.captured(captured(3, 7))
    running.link.end()
    running.link.step(0)  # waits for nothing
    running.until(lambda: not Path(f"/proc/{pid}").exists())
    assert running.events.recent() == []


@pytest.mark.system
def test_when_the_supervisor_dies_the_process_ends(run_dir, ring):
    alone = spawn_piped(run_dir.command(process.__name__, CONFIG))
    alone.stdin.close()
    assert select.select([alone.stdout], [], [], PATIENCE_S)[0]
    assert (alone.wait(PATIENCE_S), alone.stdout.read()) == (0, b"")
    alone.stdout.close()


@pytest.mark.system
def test_without_a_ring_it_is_one_line_and_exit_1(tmp_path):
    lonely = RunDir("lonely", tmp_path)
    done = subprocess.run(
        lonely.command(process.__name__, CONFIG), check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("motord estimator: ")
    assert done.stderr.count("\n") == 1


def test_it_leaves_the_loop_its_processor(monkeypatch):
    nice, cpus = {}, {}
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2})
    monkeypatch.setattr(os, "sched_setaffinity", cpus.__setitem__)
    monkeypatch.setattr(os, "setpriority", lambda kind, task, value: nice.update({task: value}))
    scheduling.lower_priority(1)
    assert set(nice.values()) == {scheduling.BACKGROUND_NICE}
    assert os.getpid() in nice
    assert all(left == {0, 2} for left in cpus.values())
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {1})
    cpus.clear()
    scheduling.lower_priority(1)
    assert cpus == {}
